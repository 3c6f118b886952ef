# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An hour in simulated time with all nodes and random faults: nothing lost, memory flat.

Plant, identifier and recorder follow a clock that moves on as fast as they are; the driver, which
refuses simulated time, works beside them in real time, with console, stop button, plant and
recorder of its own.  All of them are in one process, on one executor and real DDS.  Every message
that was sent must have been heard by the identifier, and be in a recording; and each estimate must
be, bit for bit, the one that `rpms identify` makes of the recording.

Ctrl-C ends it early, with the figures of what was done.

python bench/soak.py [--hours 1] [--rate 200] [--estimator recursive] [--seed 1]
"""

import argparse
import contextlib
import gc
import math
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test'))

import graphs
from soak_clinic import Clinic
from soak_laboratory import FAULTS, STEP_NS, Laboratory

from rpms_ros.identification import StreamSettings
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.recording import read_recording
from rpms_ros.report.recorded import differences, recorded_messages
from rpms_ros.report.result import IdentificationOptions, identified

FAULT_SHARE = 0.1
RESTART_EVERY_S = 300.0
LARGEST_SLOPE_MB = 30.0
_SAMPLE_STEPS = 20
_STREAM = StreamSettings()
_WAITING = 2 + math.ceil(_STREAM.reorder_delay / _STREAM.estimate_period)
_NODE_ONLY = (faults.FORCE_PUBLISHERS, faults.PULSE_PUBLISHERS)


class Graph(graphs.Graph):
    """Nodes in one persistent executor, which come and go."""

    def __init__(self, context):
        super().__init__(context)
        self.between = []

    def wait_for(self, predicate, timeout=120.0):
        def looked():
            for call in self.between:
                call()
            return predicate()

        super().wait_for(looked, timeout)


@contextlib.contextmanager
def running_graph():
    """A graph in a private domain."""
    with (
        graphs.private_domain() as domain,
        graphs.private_context(domain) as context,
        contextlib.closing(Graph(context)) as graph,
    ):
        yield graph


def resident_mb():
    """Memory of this process [MB]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def simulate(laboratory, seconds, restart_every_s, fault_share):
    """Let the time pass; return time [s] and memory [MB] of the process, (samples, 2)."""
    memory = []
    steps = round(seconds * 1e9 / STEP_NS)
    restart_steps = round(restart_every_s * 1e9 / STEP_NS)
    generator, interrupted = laboratory.generator, []
    before = signal.signal(signal.SIGINT, lambda *_: interrupted.append(True))
    for step in range(steps):
        if interrupted:
            # What was done by now counts as well.
            break
        fault = generator.choice(FAULTS) if generator.random() < fault_share else ''
        laboratory.step(fault)
        if step % restart_steps == restart_steps - 1 and step < steps - 1:
            laboratory.restart_recording()
        elif step % restart_steps == restart_steps // 2:
            laboratory.start_plant()
        if step % _SAMPLE_STEPS == 0:
            gc.collect()
            memory.append(((step + 1) * STEP_NS / 1e9, resident_mb()))
    signal.signal(signal.SIGINT, before)
    laboratory.end_recording()
    return np.array(memory)


def slope_mb(memory):
    """Slope of the memory over simulated time [MB/h], without the first fifth."""
    kept = memory[len(memory) // 5 :]
    return float(np.polyfit(kept[:, 0] / 3600.0, kept[:, 1], 1)[0]) if len(kept) > 1 else 0.0


def without_publishers(estimate):
    """The estimate without what only a node can say of the publishers on the graph."""
    return replace(
        estimate,
        doubts=tuple(name for name in estimate.doubts if name not in _NODE_ONLY),
        faults={name: n for name, n in estimate.faults.items() if name not in _NODE_ONLY},
    )


def check_recordings(paths, estimator):
    """Return what is in the recordings, and how many estimates are not the same off line."""
    found = Counter()
    for path in paths:
        recording = read_recording(path)
        found['faults of recordings'] += sum(recording.facts.faults.values())
        found['pulses recorded'] += len(recording.pulses)
        found['force recorded'] += len(recording.forces)
        live = recorded_messages(recording).estimates
        found['estimates recorded'] += len(live)
        found['estimates made again off line'] += len(live)
        session = identified(recording, IdentificationOptions(estimator))
        # Off line more are made of what still waited at the end, and a last one.
        found['estimates that differ'] += not 1 <= len(session.estimates) - len(live) <= _WAITING
        found['estimates that differ'] += sum(
            bool(differences(without_publishers(here), without_publishers(there)))
            for here, there in zip(live, session.estimates, strict=False)
        )
    return found


def soak(
    folder,
    seconds,
    rate,
    seed,
    estimator='recursive',
    restart_every_s=RESTART_EVERY_S,
    fault_share=FAULT_SHARE,
):
    """Run everything; return counts and memory over simulated time."""
    with running_graph() as graph:
        clinic = Clinic(graph, folder, seed)
        graph.between.append(clinic.poll)
        laboratory = Laboratory(graph, folder, rate, estimator, seed)
        memory = simulate(laboratory, seconds, restart_every_s, fault_share)
        graph.between.clear()
        clinic.end()
    counts = laboratory.totals + check_recordings(laboratory.recordings, estimator)
    for name, count in clinic.counts.items():
        counts[f'driver: {name}'] = count
    for name, count in laboratory.restarts.items():
        counts[f'restarts of {name}'] = count
    return counts, laboratory.link.injected, laboratory.named, memory


def failures(counts):
    """Return what does not fit, as sentences."""
    same = [
        ('force sent', 'force heard', 'force recorded'),
        ('pulses sent', 'pulses heard', 'pulses recorded'),
        ('estimates said', 'estimates recorded'),
        ('driver: delivered', 'driver: pulses recorded'),
        ('driver: runs', 'driver: schedules recorded'),
    ]
    wrong = [
        ', '.join(f'{name} {counts[name]}' for name in names)
        for names in same
        if len({counts[name] for name in names}) > 1
    ]
    none = ('estimates that differ', 'faults of recordings')
    return wrong + [f'{name} {counts[name]}' for name in none if counts[name]]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--hours', type=float, default=1.0)
    parser.add_argument('--rate', type=float, default=200.0, help='force samples a second')
    parser.add_argument('--estimator', default='recursive')
    parser.add_argument('--seed', type=int, default=1)
    arguments = parser.parse_args()
    seconds = 3600.0 * arguments.hours
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        counts, injected, named, memory = soak(
            Path(folder), seconds, arguments.rate, arguments.seed, arguments.estimator
        )
    span, seconds = time.monotonic() - begun, memory[-1, 0]
    slope = slope_mb(memory)
    print(
        f'{seconds:g} s simulated in {span:.0f} s ({seconds / span:.2g} times real time), '
        f'{arguments.rate:g} Hz, {arguments.estimator}, load {os.getloadavg()[0]:.1f}'
    )
    print(f'  injected: {dict(sorted(injected.items()))}')
    print(f'  named by the identifier: {dict(sorted(named.items()))}')
    for name, count in sorted(counts.items()):
        print(f'  {name:<38}{count:>10}')
    tenths = memory[np.linspace(0, len(memory) - 1, 11).astype(int), 1]
    print(f'  memory at every tenth: {", ".join(f"{value:.0f}" for value in tenths)} MB')
    print(f'  slope {slope:.1f} MB an hour after a fifth (target below {LARGEST_SLOPE_MB:g})')
    wrong = failures(counts)
    for line in wrong:
        print(f'  LOST: {line}')
    return 0 if not wrong and slope < LARGEST_SLOPE_MB else 1


if __name__ == '__main__':
    sys.exit(main())
