# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process at 5 kHz: nothing is lost, what was flushed not even by a kill."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.pulses import Pulse
from rpms_ros.recording import Recording, read_recording

RATE = 5000
SAMPLES_PER_PULSE = 250


class Source(Node):
    """Publishes numbered samples at 5 kHz, as far as the machine keeps up, and pulses."""

    def __init__(self, context) -> None:
        super().__init__('source', context=context, use_global_arguments=False)
        self._force = self.create_publisher(WrenchStamped, 'force', qos.FORCE)
        self._pulses = self.create_publisher(PulseMessage, 'pulses', qos.PULSES)
        self.sent: list[float] = []

    def is_heard(self) -> bool:
        both = (self._force, self._pulses)
        return all(publisher.get_subscription_count() == 1 for publisher in both)

    def send_what_is_due(self, elapsed: float) -> None:
        for index in range(len(self.sent), int(elapsed * RATE)):
            if index % SAMPLES_PER_PULSE == 0:
                pulse = Pulse(index, 0.5, index // SAMPLES_PER_PULSE)
                self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
            sample = messages.force_message(index, float(index), messages.AXES['z'], MESSAGE_TYPES)
            self._force.publish(sample)
            self.sent.append(time.monotonic())

    def send_for(self, duration: float, wait_for: Callable[..., None]) -> None:
        begun = time.monotonic()

        def done() -> bool:
            self.send_what_is_due(min(time.monotonic() - begun, duration))
            return len(self.sent) == int(duration * RATE)

        wait_for(done)


@contextmanager
def recorder(path: Path, domain: int) -> Iterator[subprocess.Popen[bytes]]:
    code = 'import sys; from rpms_ros.nodes.recorder import main; sys.exit(main())'
    arguments = ['--ros-args', '-p', f'path:={path}']
    with subprocess.Popen(
        [sys.executable, '-c', code, *arguments],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def source(context) -> Iterator[Source]:
    node = Source(context)
    yield node
    node.destroy_node()


@pytest.fixture
def recorded(written_so_far) -> Callable[[Path], int]:
    """Number of samples in a recording that is still being written, 0 before the first pulse."""

    def count(path: Path) -> int:
        if not any(file.stat().st_size > 100_000 for file in path.glob('*.mcap')):
            return 0
        recording = written_so_far(path)
        return 0 if recording is None else len(recording.forces)

    return count


def check_order(recording: Recording) -> None:
    samples, pulses = len(recording.forces), len(recording.pulses)
    np.testing.assert_array_equal(recording.forces.force, np.arange(samples))
    np.testing.assert_array_equal(recording.pulses.onset_ns, SAMPLES_PER_PULSE * np.arange(pulses))


def test_a_kill_costs_nothing_that_was_flushed(
    source: Source,
    domain: int,
    tmp_path: Path,
    wait_for: Callable[..., None],
    recorded: Callable[[Path], int],
) -> None:
    path = tmp_path / 'session'
    with recorder(path, domain) as process:
        wait_for(source.is_heard, 60.0)
        begun = time.monotonic()

        def flushed_while_more_comes() -> bool:
            # no more than a recorder that is held up may leave waiting
            source.send_what_is_due(min(time.monotonic() - begun, qos.FORCE.depth / RATE))
            return recorded(path) > 0

        wait_for(flushed_while_more_comes, 60.0)
        # and with nothing more to come: how long it takes is measured in bench/recorder.py
        wait_for(lambda: recorded(path) == len(source.sent), 60.0)
        process.send_signal(signal.SIGKILL)
        process.wait(60.0)
    assert not (path / 'metadata.yaml').exists()
    recording = read_recording(path)
    check_order(recording)
    assert len(recording.forces) == len(source.sent)
