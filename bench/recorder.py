# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder node as a separate process at 5 kHz: losses, and losses after a kill.

First WrenchStamped for 60 s at 5 kHz, and pulses at 20 Hz, after which the recording has to hold
every one of them in order.  Then short recordings whose recorder is killed with SIGKILL at a
random moment: every one has to open and to contain all messages up to one second before
the kill.

python bench/recorder.py [--duration 60] [--kills 20] [--rate 5000] [--seed 1]
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.node import Node

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.runner import free_domain, use_fast_discovery
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, Pulse
from rpms_ros.recording import read_recording

PATIENCE = 30.0
# Largest loss by a kill [s].
MAY_BE_LOST = 1.0
SHORTEST, LONGEST = 1.5, 4.0
SAMPLES_PER_PULSE = 250
_LEAST_PAUSE = 2e-4
# Several flush periods without a byte: nothing more is expected.
_QUIET = 2.0


@dataclass(frozen=True)
class Kept:
    """Published and recorded messages.

    Attributes
    ----------
    published, recorded : int
        Samples of force.
    in_order : bool
        Whether samples and pulses were recorded in order and without a gap up to the last one.
    lost_time : float
        From the first sample that is missing to the end of publishing [s].
    duration : float
        Of publishing [s].
    load : float
        Processors that the recorder took.
    """

    published: int
    recorded: int
    in_order: bool
    lost_time: float
    duration: float
    load: float


def wait_for(predicate: Callable[[], object], what: str) -> None:
    """Wait until `predicate` holds.

    Raises
    ------
    TimeoutError
        If it does not hold after `PATIENCE`.
    """
    end = time.monotonic() + PATIENCE
    while not predicate():
        if time.monotonic() > end:
            raise TimeoutError(f'expected {what} within {PATIENCE} s, got nothing')
        time.sleep(1e-3)


class Source(Node):
    """Publishes samples and pulses, numbered by their stamps."""

    def __init__(self, context: Context) -> None:
        super().__init__('source', context=context, use_global_arguments=False)
        self._force = self.create_publisher(WrenchStamped, 'force', qos.FORCE)
        self._pulses = self.create_publisher(PulseMessage, 'pulses', qos.PULSES)

    @property
    def is_heard(self) -> bool:
        """Whether somebody listens to both topics."""
        both = (self._force, self._pulses)
        return all(publisher.get_subscription_count() for publisher in both)

    def send(self, rate: float, duration: float) -> list[int]:
        """Publish samples at this rate [Hz]; return when each was sent [ns]."""
        sent: list[int] = []
        begun = time.monotonic()
        for index in range(round(rate * duration)):
            due = begun + index / rate
            while (left := due - time.monotonic()) > 0.0:
                time.sleep(max(left, _LEAST_PAUSE))
            if index % SAMPLES_PER_PULSE == 0:
                pulse = Pulse(index, 0.5, index // SAMPLES_PER_PULSE)
                self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
            self._force.publish(
                messages.force_message(index, float(index), messages.AXES['z'], MESSAGE_TYPES)
            )
            sent.append(time.monotonic_ns())
        return sent


@contextmanager
def source() -> Iterator[tuple[Source, int]]:
    """Yield a source in a domain of its own, and the domain."""
    use_fast_discovery()
    context = Context()
    with free_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        node = Source(context)
        try:
            yield node, domain
        finally:
            node.destroy_node()
            context.try_shutdown()


def start_recorder(path: Path, domain: int) -> subprocess.Popen[bytes]:
    code = 'import sys; from rpms_ros.nodes.recorder import main; sys.exit(main())'
    arguments = ['--ros-args', '-p', f'path:={path}']
    return subprocess.Popen(
        [sys.executable, '-c', code, *arguments], env={**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    )


def processor_time(process: int) -> float:
    """Processor time of a process so far, user and system [s]."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def wait_until_quiet(path: Path) -> None:
    """Wait until the recording has not grown for a while."""
    size, since = -1, time.monotonic()
    while time.monotonic() - since < _QUIET:
        now = sum(file.stat().st_size for file in path.glob('*.mcap'))
        if now != size:
            size, since = now, time.monotonic()
        time.sleep(0.05)


def record(path: Path, rate: float, duration: float, kill: bool) -> Kept:
    """Record one publication, killed at its end or not."""
    with source() as (node, domain), start_recorder(path, domain) as process:
        try:
            wait_for(lambda: node.is_heard, 'a recorder')
            before = processor_time(process.pid)
            sent = node.send(rate, duration)
            load = (processor_time(process.pid) - before) / duration
            if kill:
                process.send_signal(signal.SIGKILL)
            else:
                wait_until_quiet(path)
                process.send_signal(signal.SIGINT)
            process.wait(PATIENCE)
        finally:
            process.kill()
    return kept(path, sent, load)


def kept(path: Path, sent: list[int], load: float) -> Kept:
    """Compare what was sent with the recording."""
    recording = read_recording(path)
    recorded = len(recording.forces)
    in_order = np.array_equal(recording.forces.force, np.arange(recorded))
    onsets = SAMPLES_PER_PULSE * np.arange(len(recording.pulses))
    in_order &= np.array_equal(recording.pulses.onset_ns, onsets)
    missing_ns = sent[-1] - sent[recorded] if recorded < len(sent) else 0
    duration = (sent[-1] - sent[0]) / NANOSECONDS_PER_SECOND
    return Kept(len(sent), recorded, in_order, missing_ns / NANOSECONDS_PER_SECOND, duration, load)


def run_whole(folder: Path, rate: float, duration: float) -> bool:
    """Record without a kill; print and judge it."""
    found = record(folder / 'whole', rate, duration, kill=False)
    lost = found.published - found.recorded
    print(f'{found.published} samples at {rate:g} Hz, published in {found.duration:.2f} s')
    print(f'  recorded {found.recorded}, lost {lost} (target 0), order kept: {found.in_order}')
    print(f'  recorder {found.load:.2f} cores')
    return not lost and found.in_order


def run_kills(folder: Path, rate: float, kills: int, seed: int) -> bool:
    """Kill recorders at random moments; print and judge the recordings."""
    generator = random.Random(seed)
    found = [
        record(folder / f'killed_{number}', rate, generator.uniform(SHORTEST, LONGEST), kill=True)
        for number in range(kills)
    ]
    worst = max((one.lost_time for one in found), default=0.0)
    good = [one for one in found if one.in_order and one.recorded]
    print(f'{kills} kills after {SHORTEST:g} to {LONGEST:g} s at {rate:g} Hz')
    print(f'  opened, without a hole: {len(good)} (target {kills})')
    print(f'  missing at the end at most {worst:.3f} s (target {MAY_BE_LOST:g} s)')
    return len(good) == kills and worst <= MAY_BE_LOST


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=60.0)
    parser.add_argument('--kills', type=int, default=20)
    parser.add_argument('--rate', type=float, default=5000.0)
    parser.add_argument('--seed', type=int, default=1)
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = run_whole(folder, arguments.rate, arguments.duration)
        killed = run_kills(folder, arguments.rate, arguments.kills, arguments.seed)
    return 0 if whole and killed else 1


if __name__ == '__main__':
    sys.exit(main())
