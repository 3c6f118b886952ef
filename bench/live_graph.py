# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Three nodes as three processes at 1 kHz on real DDS: samples lost, processor time.

The targets are no lost sample and less than one and a half cores for the three together.  With
another rate it tells where samples are lost: between plant and recorder, by the numbers of the
publisher, and between plant and identifier, by what it has processed.

python bench/live_graph.py [--duration 60] [--rate 1000]
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from rpms_ros.nodes.recorder import LOST_KEY
from rpms_ros.nodes.simulation_launcher import SimulationLauncher, SimulationSettings
from rpms_ros.recording import read_facts
from rpms_ros.stimulation import paper_random

LARGEST_LOAD = 1.5
TAIL = 1.5


def processor_time(process: int) -> float:
    """Processor time of a process so far, user and system [s]."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(launcher: SimulationLauncher) -> dict[str, float]:
    """Run the schedule to its end; return cores by process while it ran."""
    while not launcher.monitor.has_run:
        launcher.step(0.05)
    begun = time.monotonic()
    before = {name: processor_time(one) for name, one in launcher.processes.items()}
    while not launcher.monitor.done:
        launcher.step(0.05)
    span = time.monotonic() - begun
    after = {name: processor_time(one) for name, one in launcher.processes.items()}
    launcher.step(TAIL)
    launcher.stop()
    return {name: (after[name] - before[name]) / span for name in before}


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--duration', type=float, default=60.0, help='seconds of stimulation')
    parser.add_argument('--rate', type=float, default=1000.0, help='force samples a second')
    arguments = parser.parse_args(argv)
    rate = arguments.rate
    settings = SimulationSettings(
        plant={'rate': rate, 'noise': 0.02, 'publication_delay': 0.05},
        driver={},
        schedule=paper_random(arguments.duration),
        identifier={},
    )
    with tempfile.TemporaryDirectory() as folder:
        with SimulationLauncher(Path(folder) / 'session', settings) as launcher:
            cores = measure(launcher)
        counts = launcher.recorder.counts
        last = launcher.monitor.estimates[-1]
        custom = read_facts(next(Path(folder).rglob('metadata.yaml')).parent).custom
    lost = counts['force'].missing(rate)
    total = sum(cores.values())
    print(f'live graph, {rate:.0f} Hz for {arguments.duration:g} s, three processes')
    for name, load in cores.items():
        print(f'  {name:<18} {load:6.3f} cores')
    print(f'  {"together":<18} {total:6.3f} cores (target < {LARGEST_LOAD})')
    print(f'  samples {counts["force"].messages}, lost {lost} (target 0)')
    waiting = counts['force'].messages + lost - last.samples
    print(f'  lost by the numbers of the publishers {custom[LOST_KEY]}')
    print(f'  samples of the identifier {last.samples}, {waiting} after its last estimate or lost')
    print(f'  pulses {counts["pulses"].messages}, faults {dict(last.faults) or "none"}')
    return 0 if not lost and not last.faults and total < LARGEST_LOAD else 1


if __name__ == '__main__':
    sys.exit(main())
