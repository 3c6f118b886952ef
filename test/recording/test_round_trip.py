# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written and read again, by the package and by rosbags, both ways."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import Topics, read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED

Session = tuple[PulseTrain, ForceTrace]
WriteWithRosbags = Callable[..., Path]
COMPRESSIONS = ['', 'lz4', 'zstd']


def assert_same(path: Path, session: Session, **options: Any) -> None:
    recording = read_recording(path, **options)
    pulses, forces = session
    for name in ('onset_ns', 'intensity', 'sequence', 'width'):
        assert getattr(recording.pulses, name).tobytes() == getattr(pulses, name).tobytes()
    assert recording.forces.stamp_ns.tobytes() == forces.stamp_ns.tobytes()
    assert recording.forces.force.tobytes() == forces.force.tobytes()
    assert recording.forces.frame_id == forces.frame_id


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_what_was_written_is_read(session: Session, tmp_path: Path, compression: str) -> None:
    path = tmp_path / 'bag'
    write_recording(path, *session, compression=compression)
    assert_same(path, session)
    recording = read_recording(path)
    assert recording.facts.storage == 'mcap'
    assert recording.facts.faults == {}
    assert recording.force_received_ns.tolist() == session[1].stamp_ns.tolist()


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_rosbags_reads_what_was_written(
    session: Session, tmp_path: Path, compression: str
) -> None:
    path = tmp_path / 'bag'
    write_recording(path, *session, compression=compression)
    pulses, forces = session
    with AnyReader([path]) as reader:
        assert reader.message_count == len(pulses) + len(forces)
        counts = {topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
        assert counts == {'/pulses': (PULSE, len(pulses)), '/force': (WRENCH_STAMPED, len(forces))}
        messages = [
            (time_ns, connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, time_ns, raw in reader.messages()
        ]
    force = [message.wrench.force.z for _, topic, message in messages if topic == '/force']
    assert force == forces.force.tolist()
    # The first pulse comes before the sample of the same time.
    assert [topic for _, topic, _ in messages[:2]] == ['/pulses', '/force']


@pytest.mark.parametrize('storage', list(StoragePlugin))
@pytest.mark.parametrize('compression', list(CompressionMode))
def test_what_rosbags_wrote_is_read(
    write_with_rosbags: WriteWithRosbags, make: Any, storage: Any, compression: Any
) -> None:
    if storage is StoragePlugin.SQLITE3 and compression is CompressionMode.STORAGE:
        compression = CompressionMode.NONE
    messages = [('/pulses', PULSE, 10, make.pulse(5, 3, 0.25))]
    messages += [
        ('/force', WRENCH_STAMPED, 10 + i, make.wrench_stamped(7 + i, 0.5 * i)) for i in range(50)
    ]
    recording = read_recording(write_with_rosbags(messages, storage, compression))
    assert recording.pulses.onset_ns.tolist() == [5]
    assert recording.pulses.sequence.tolist() == [3]
    assert recording.pulse_received_ns.tolist() == [10]
    assert recording.forces.force.tolist() == [0.5 * i for i in range(50)]
    assert recording.forces.stamp_ns.tolist() == list(range(7, 57))
    assert recording.facts.faults == {}


def test_topics_below_a_namespace(write_with_rosbags: WriteWithRosbags, make: Any) -> None:
    messages = [
        ('/left/pulses', PULSE, 1, make.pulse(1, 1)),
        ('/left/pulses_commanded', PULSE, 1, make.pulse(1, 2)),
        ('/left/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 4.0)),
        ('/right/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 8.0)),
    ]
    path = write_with_rosbags(messages)
    with pytest.raises(RecordingError, match=r'expected one topic force in .*, got /left/force, '):
        read_recording(path)
    recording = read_recording(path, Topics(force='/right/force'))
    assert recording.pulses.sequence.tolist() == [1]
    assert recording.forces.force.tolist() == [8.0]
