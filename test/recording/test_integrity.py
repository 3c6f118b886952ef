# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksums and ends of recordings: what changed or is missing never passes unnamed."""

import subprocess
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import (
    Recording,
    RecordingWriter,
    read_facts,
    read_recording,
    session_hash,
    write_recording,
)
from rpms_ros.recording.rosbag.definitions import PULSE

Session = tuple[PulseTrain, ForceTrace]
COMPRESSIONS = ['', 'lz4', 'zstd']
FLIPS = 40


def storage_file(path: Path) -> Path:
    return path / f'{path.name}_0.mcap'


def shown(recording: Recording) -> tuple[Any, ...]:
    """Return everything that a command could print of a recording."""
    facts = recording.facts
    return session_hash(recording), facts.topics, dict(facts.frame_ids), dict(facts.custom)


def short(session: Session) -> Session:
    pulses, forces = session
    return pulses[:5], ForceTrace(forces.stamp_ns[:250], forces.force[:250])


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_a_flipped_bit_is_named_or_changes_nothing(
    session: Session, tmp_path: Path, compression: str
) -> None:
    path = tmp_path / 'bag'
    custom = {'operator': 'somebody', 'seed': '7'}
    write_recording(path, *short(session), compression=compression, custom=custom)
    before = shown(read_recording(path))
    generator = Random(3)
    for file in (storage_file(path), path / 'metadata.yaml'):
        whole = file.read_bytes()
        for _ in range(FLIPS):
            content = bytearray(whole)
            content[generator.randrange(len(content))] ^= 1 << generator.randrange(8)
            file.write_bytes(content)
            try:
                recording = read_recording(path)
            except RecordingError:
                continue
            assert recording.facts.faults or shown(recording) == before
        file.write_bytes(whole)


def test_every_checksum_of_the_format_is_written(session: Session, tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    write_recording(path, *session)
    with storage_file(path).open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 2040
        summary = reader.get_summary()
    content = storage_file(path).read_bytes()
    assert summary is not None
    # The last field of the footer, before the closing magic.
    assert content[-12:-8] != bytes(4)
    # The checksum of the data, before the schemas of the summary.
    first = min(content.rindex(b'\x0f' + (4).to_bytes(8, 'little')), len(content))
    assert content[first + 9 : first + 13] != bytes(4)


def test_checksums_are_those_of_sha256sum(session: Session, tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    write_recording(path, *session)
    subprocess.run(['sha256sum', '--check', '--strict', 'SHA256SUMS'], cwd=path, check=True)


def test_the_hash_is_that_of_the_session(session: Session, tmp_path: Path) -> None:
    found = set()
    for compression in COMPRESSIONS:
        path = tmp_path / f'mcap{compression}'
        write_recording(path, *session, compression=compression)
        found.add(session_hash(read_recording(path)))
    assert len(found) == 1
    pulses, forces = session
    changes = [
        (pulses, ForceTrace(forces.stamp_ns + 1, forces.force)),
        (pulses, ForceTrace(forces.stamp_ns, np.nextafter(forces.force, 1e9))),
        (PulseTrain(pulses.onset_ns, pulses.intensity, pulses.sequence + 1, pulses.width), forces),
        (pulses[:-1], forces),
    ]
    for number, changed in enumerate(changes):
        path = tmp_path / f'changed{number}'
        write_recording(path, *changed)
        found.add(session_hash(read_recording(path)))
    assert len(found) == 1 + len(changes)


def test_cut_metadata_of_other_writers_are_named(write_with_rosbags: Any, make: Any) -> None:
    path = write_with_rosbags([('/pulses', PULSE, 1, make.pulse(1))])
    file = path / 'metadata.yaml'
    lines = file.read_text().splitlines(keepends=True)
    assert read_facts(path).faults == {}
    unnamed = []
    for count in range(len(lines)):
        file.write_text(''.join(lines[:count]))
        if 'damaged_metadata' not in read_facts(path).faults:
            unnamed.append(''.join(lines[count:]))
    # Nothing is missing without a trace.
    assert unnamed == []


def test_a_count_that_does_not_fit_is_named(write_with_rosbags: Any, make: Any) -> None:
    path = write_with_rosbags([('/pulses', PULSE, 1, make.pulse(1))])
    file = path / 'metadata.yaml'
    file.write_text(file.read_text().replace('message_count: 1', 'message_count: 2'))
    assert read_facts(path).faults == {'wrong_count': 1}


def test_a_recording_that_the_device_refused_has_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'bag'
    writer = RecordingWriter(path)
    topic = writer.add_topic('/pulses', PULSE)
    writer.append(topic, 1, b'abc')
    writer.flush()

    def refuse() -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(writer._writer, 'flush', refuse)
    with pytest.raises(RecordingError, match=r'expected room and permission .* No space left'):
        writer.flush()
    writer.close()
    facts = read_facts(path)
    assert facts.faults['truncated_file'] == 1
    assert [topic.count for topic in facts.topics] == [1]
    with pytest.raises(RecordingError, match=r'expected an open recording, got .* that is closed'):
        writer.append(topic, 2, b'abc')
