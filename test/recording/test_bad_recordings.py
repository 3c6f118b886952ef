# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings with something wrong: the readable part is used, what changed or is missing named."""

import io
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from random import Random

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from rpms_ros.api.loading import as_recording
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import (
    RecordingWriter,
    read_facts,
    read_recording,
    session_hash,
    write_recording,
)
from rpms_ros.recording.rosbag.definitions import FLOAT64, PULSE, WRENCH
from rpms_ros.recording.rosbag.mcap_files import MAGIC, walk
from rpms_ros.recording.rosbag.metadata import write_checksums
from rpms_ros.recording.rosbag.sqlite_files import batches

COMPRESSIONS = ['', 'lz4', 'zstd']


def storage_file(path):
    return next(file for file in path.iterdir() if file.suffix in ('.mcap', '.db3'))


def contents(path):
    return {file.name: file.read_bytes() for file in path.iterdir()}


def short(session, pulse_count, force_count):
    pulses, forces = session
    part = slice(force_count)
    return pulses[:pulse_count], ForceTrace(forces.stamp_ns[part], forces.force[part])


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
@pytest.mark.parametrize(('content', 'found'), [(b'', 'an empty file'), (b'%PDF-1.4', "b'%PDF")])
def test_no_recording_at_all(tmp_path, suffix, content, found):
    path = tmp_path / f'bag{suffix}'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=f'expected an? (mcap|sqlite3) file at .*{found}'):
        read_recording(path)


@pytest.mark.parametrize('storage', [*COMPRESSIONS, 'sqlite3'])
def test_recording_cut_off(session, tmp_path, storage, as_sqlite3):
    path = tmp_path / 'bag'
    write_recording(path, *session, compression='' if storage == 'sqlite3' else storage)
    if storage == 'sqlite3':
        as_sqlite3(path)
    (path / 'metadata.yaml').unlink()
    file = storage_file(path)
    os.truncate(file, int(0.4 * file.stat().st_size))
    recording = read_recording(path)
    assert recording.facts.faults['truncated_file'] > 0
    assert recording.facts.faults['missing_metadata'] == 1
    assert any(file.name in remark for remark in recording.facts.remarks)
    found, forces = recording.forces, session[1]
    count = len(found)
    # Less than 40 %: a compressed block may end before the cut, and there is an index behind it.
    assert 200 <= count < len(forces)
    assert found.stamp_ns.tolist() == forces.stamp_ns[:count].tolist()
    assert found.force.tolist() == forces.force[:count].tolist()


def test_every_cut_of_an_mcap_file_reads_or_says_why(session, tmp_path):
    path, cut = tmp_path / 'bag', tmp_path / 'cut.mcap'
    write_recording(path, *short(session, 2, 60))
    whole = storage_file(path).read_bytes()
    for size in range(0, len(whole), 37):
        cut.write_bytes(whole[:size])
        try:
            recording = read_recording(cut)
        except RecordingError:
            continue
        count = len(recording.forces)
        assert recording.forces.force.tolist() == session[1].force[:count].tolist()
        assert recording.facts.faults or size > len(whole) - 9
        # all is there up to the last sample
        if count > 2 and recording.loss is not None:
            assert 'force may be missing at its beginning or end' in recording.loss


def test_wrong_checksum_leaves_the_chunk_out(bag):
    file = storage_file(bag)
    content = bytearray(file.read_bytes())
    frame, _ = walk(np.frombuffer(content, np.uint8), len(MAGIC))
    # Behind the times and the size of the content.
    place = frame.of_kind(Opcode.CHUNK)[0][0] + 24
    content[place : place + 4] = b'\1\2\3\4'
    file.write_bytes(content)
    with pytest.raises(RecordingError, match=r'expected messages in .*, got none'):
        read_recording(bag)
    assert read_facts(bag).faults == {'damaged_chunk': 1}


KILLED_WRITER = """
import sys, time
from rpms_ros.recording import RecordingWriter
from rpms_ros.recording.rosbag.definitions import PULSE

writer = RecordingWriter(sys.argv[1])
topic = writer.add_topic('/pulses', PULSE)
for index in range(1000):
    writer.append(topic, index, b'as long as a pulse with its header: 50 bytes or so')
    if index % 100 == 99:
        writer.flush()
writer.append(topic, 1000, b'never flushed')
print('ready', flush=True)
time.sleep(60)
"""


@pytest.mark.long
def test_killed_writer_leaves_what_it_flushed(tmp_path):
    path = tmp_path / 'bag'
    with subprocess.Popen(
        [sys.executable, '-c', KILLED_WRITER, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(signal.SIGKILL)
    before = contents(path)
    facts = read_facts(path)
    assert [(topic.name, topic.count) for topic in facts.topics] == [('/pulses', 1000)]
    assert 'missing_metadata' in facts.faults
    assert facts.faults['truncated_file'] == 1
    # The recording itself stays as it was.
    assert contents(path) == before


@pytest.mark.parametrize('mode', ['WAL', 'DELETE'])
def test_a_journal_beside_a_database_is_used_on_a_copy(bag, tmp_path, as_sqlite3, mode):
    killed = tmp_path / 'killed'
    with closing(sqlite3.connect(as_sqlite3(bag))) as connection:
        connection.execute(f'PRAGMA journal_mode = {mode}')
        # changed pages go into the file before they are committed
        connection.execute('PRAGMA cache_size = 1')
        connection.execute('DELETE FROM messages WHERE id > 1000')
        if mode == 'WAL':
            connection.commit()
        # as a writer leaves it that is killed
        shutil.copytree(bag, killed)
    before = contents(killed)
    facts = read_facts(killed)
    assert facts.faults['hot_journal'] == 1
    assert sum(topic.count for topic in facts.topics) == (1000 if mode == 'WAL' else 2040)
    assert contents(killed) == before


def test_split_recording(session, tmp_path):
    pulses, forces = session
    whole = tmp_path / 'whole'
    whole.mkdir()
    for part in range(12):
        span = slice(part * 100, part * 100 + 100)
        some = ForceTrace(forces.stamp_ns[span], forces.force[span])
        write_recording(tmp_path / 'part', pulses if part == 0 else PulseTrain.of([]), some)
        shutil.move(tmp_path / 'part/part_0.mcap', whole / f'whole_{part}.mcap')
        shutil.rmtree(tmp_path / 'part')
    recording = read_recording(whole)
    assert recording.forces.force.tolist() == forces.force[:1200].tolist()
    assert recording.pulses.onset_ns.tolist() == pulses.onset_ns.tolist()
    (whole / 'whole_3.mcap').write_bytes(b'')
    recording = read_recording(whole)
    assert len(recording.forces) == 1100
    assert recording.facts.faults == {'missing_metadata': 1, 'unreadable_file': 1}


def test_definition_that_is_another_one_is_used_and_named(session, bag, as_sqlite3):
    change = 'UPDATE message_definitions SET encoded_message_definition = replace('
    with sqlite3.connect(as_sqlite3(bag)) as connection:
        connection.execute(change + "encoded_message_definition, 'float64 width', 'int64 width')")
    connection.close()
    recording = read_recording(bag)
    assert recording.facts.faults == {'other_definition': 1}
    assert recording.pulses.intensity.tolist() == session[0].intensity.tolist()
    assert recording.pulses.width[0] == np.array(1e-4).view(np.int64)


def test_forces_without_stamps_count_from_reception(write_with_rosbags, make):
    for name, kind, axis, value in (
        ('wrench', WRENCH, '0.6,0,0.8', make.wrench(3.0, float('nan'), 4.0)),
        ('number', FLOAT64, 'z', make.of(FLOAT64, 5.0)),
    ):
        messages = [('/pulses', PULSE, 1, make.pulse(1))]
        messages += [('/force', kind, time_ns, value) for time_ns in (30, 40, 50)]
        recording = read_recording(write_with_rosbags(messages, name=name), axis=axis)
        assert recording.forces.stamp_ns.tolist() == [30, 40, 50]
        # 0.6 * 3 + 0.8 * 4, each rounded once.
        np.testing.assert_allclose(recording.forces.force, 5.0, rtol=1e-15)
    with pytest.raises(RecordingError, match=r'expected no axis for std_msgs/msg/Float64, got -z'):
        read_recording(recording.facts.path, axis='-z')


@pytest.mark.parametrize('value', ["'Käthe'", 'NULL'])
def test_rows_come_in_the_order_of_their_ids_and_without_data_they_are_empty(value):
    connection = sqlite3.connect(':memory:')
    connection.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data)'
    )
    rows = [(20_000, 3, 1, b''), (-(2**63), 1, 9, b'abc'), (2, 2, 0, b'de'), (1, 1, 6, b'f')]
    connection.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
    connection.execute(f'UPDATE messages SET data = {value} WHERE id = 2')
    found = [
        (int(topic[index]), int(records.time_ns[index]), records.message(index))
        for topic, records in batches(connection)
        for index in range(len(records))
    ]
    assert found == [(1, 9, b'abc'), (1, 6, b'f'), (2, 0, b''), (3, 1, b'')]


FLIPS = 40


def shown(recording):
    """Return everything that a command could print of a recording."""
    facts = recording.facts
    return session_hash(recording), facts.topics, dict(facts.frame_ids), dict(facts.custom)


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_a_flipped_bit_is_named_or_changes_nothing(session, tmp_path, compression):
    path = tmp_path / 'bag'
    custom = {'operator': 'somebody', 'seed': '7'}
    write_recording(path, *short(session, 5, 250), compression=compression, custom=custom)
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


def test_every_checksum_of_the_format_is_written_and_that_of_every_file(bag):
    with storage_file(bag).open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 2040
        assert reader.get_summary() is not None
    content = storage_file(bag).read_bytes()
    # The last field of the footer, before the closing magic.
    assert content[-12:-8] != bytes(4)
    # The checksum of the data, before the schemas of the summary.
    first = min(content.rindex(b'\x0f' + (4).to_bytes(8, 'little')), len(content))
    assert content[first + 9 : first + 13] != bytes(4)
    subprocess.run(['sha256sum', '--check', '--strict', 'SHA256SUMS'], cwd=bag, check=True)


def test_the_hash_is_that_of_the_session(session, tmp_path):
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
    found |= {session_hash(as_recording(*one, tmp_path, 'changed')) for one in changes}
    assert len(found) == 1 + len(changes)


def test_metadata_of_other_writers_that_are_cut_or_count_wrongly_are_named(
    write_with_rosbags, make
):
    path = write_with_rosbags([('/pulses', PULSE, 1, make.pulse(1))])
    file = path / 'metadata.yaml'
    text = file.read_text()
    assert read_facts(path).faults == {}
    file.write_text(text.replace('message_count: 1', 'message_count: 2'))
    assert read_facts(path).faults == {'wrong_count': 1}
    lines = text.splitlines(keepends=True)
    unnamed = []
    for count in range(len(lines)):
        file.write_text(''.join(lines[:count]))
        if 'damaged_metadata' not in read_facts(path).faults:
            unnamed.append(''.join(lines[count:]))
    # Nothing is missing without a trace.
    assert unnamed == []


def test_a_recording_that_the_device_refused_has_no_end(tmp_path, monkeypatch):
    path = tmp_path / 'bag'
    writer = RecordingWriter(path)
    topic = writer.add_topic('/pulses', PULSE)
    writer.append(topic, 1, b'abc')
    writer.flush()

    class Full(io.FileIO):
        def write(self, _content):
            raise OSError(28, 'No space left on device')

    with writer._file._file, Full(path / 'bag_0.mcap', 'a') as full:
        monkeypatch.setattr(writer._file, '_file', full)
        writer.append(topic, 2, b'never written')
        with pytest.raises(RecordingError, match=r'expected room and permission .* No space left'):
            writer.flush()
    writer.close()
    facts = read_facts(path)
    assert facts.faults['truncated_file'] == 1
    assert [topic.count for topic in facts.topics] == [1]
    with pytest.raises(RecordingError, match=r'expected an open recording, got .* that is closed'):
        writer.append(topic, 2, b'abc')


def test_a_number_of_a_sqlite3_file_that_was_changed_is_named(bag, as_sqlite3):
    file = as_sqlite3(bag)
    write_checksums(bag, (file.name, 'metadata.yaml'))
    assert read_facts(bag).faults == {}
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    assert read_facts(bag).faults == {'wrong_checksum': 1}
