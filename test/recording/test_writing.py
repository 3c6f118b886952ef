# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing: what is refused, what a full device leaves, how raw messages come together."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import FurtherTopic, RecordingWriter, read_facts, write_recording
from rpms_ros.recording.rosbag.definitions import PULSE
from rpms_ros.recording.rosbag.scan import Scan

# A limit of the file size is met like the end of a device, at the same calls.
FULL_DEVICE = """
import resource, signal, sys
import numpy as np
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import write_recording

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
stamp_ns = np.arange(50_000, dtype=np.int64) * 1_000_000
pulses = PulseTrain.regular(np.full(1000, 0.5), 20.0)
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, resource.RLIM_INFINITY))
forces = ForceTrace(stamp_ns, np.ones(50_000))
try:
    write_recording(sys.argv[1], pulses, forces)
except RecordingError as error:
    print(error)
"""


@pytest.mark.long
def test_full_device_is_told_and_what_fits_is_kept(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    done = subprocess.run(
        [sys.executable, '-c', FULL_DEVICE, str(path)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.stderr == ''
    assert done.stdout.startswith(f'expected room and permission to write {path}, got ')
    assert done.stdout.count('\n') == 1
    facts = read_facts(path)
    force = next(topic for topic in facts.topics if topic.name == '/force')
    # 3 MB hold 25,000 messages of 119 bytes; what is behind the last whole chunk of 8192 is lost.
    assert 8_000 < force.count < 26_000


def test_a_failure_of_the_caller_still_closes_the_recording(tmp_path: Path) -> None:
    path = tmp_path / 'bag'

    def fail() -> None:
        with RecordingWriter(path) as writer:
            writer.append(writer.add_topic('/pulses', PULSE), 1, b'x')
            raise KeyError('mine')

    with pytest.raises(KeyError, match='mine'):
        fail()
    facts = read_facts(path)
    assert facts.faults == {}
    assert facts.topics[0].count == 1


def test_unknown_compression(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="expected compression lz4 or zstd, got 'gz'"):
        RecordingWriter(tmp_path / 'bag', 'gz')
    assert not (tmp_path / 'bag').exists()


def test_further_topics_are_merged_by_time(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    text = FurtherTopic('/notes', 'std_msgs/msg/String', [5, 25], [b'one', b'two'])
    forces = ForceTrace(np.array([0, 10, 20, 30]), np.zeros(4))
    write_recording(path, PulseTrain.of([]), forces, further=[text])
    counts = {topic.name: topic.count for topic in read_facts(path).topics}
    assert counts == {'/pulses': 0, '/force': 4, '/notes': 2}
    places = {
        channel.topic: records.place.tolist()
        for channel, records in Scan(path).blocks()
        if records.place is not None
    }
    assert places['/notes'] == [1, 4]
