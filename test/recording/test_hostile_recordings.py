# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings made to hurt: a clear line within bounds of memory and time, whatever they hold."""

import os
import sqlite3
import struct
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
from backports import zstd
from mcap.opcode import Opcode

from rpms_ros.errors import RecordingError
from rpms_ros.recording import read_facts, read_recording
from rpms_ros.recording.importing import ImportOptions, import_file
from rpms_ros.recording.rosbag.mcap_files import MAGIC

BENCH = Path(__file__).parents[2] / 'bench' / 'hostile_recordings.py'
# About two minutes in CI, whose script sets it; a few seconds otherwise.  The seeds are always the
# same, so that what a change breaks shows with that change; the benches try other ones.
FUZZ_ROUNDS = int(os.environ.get('RPMS_FUZZ_ROUNDS', '10'))


@pytest.fixture(scope='module')
def bench(module_at):
    return module_at(BENCH)


def chunk(content_size, packed, compression):
    name = compression.encode()
    head = struct.pack('<QQQII', 0, 0, content_size, 0, len(name)) + name
    body = head + struct.pack('<Q', len(packed)) + packed
    return struct.pack('<BQ', Opcode.CHUNK, len(body)) + body


@cache
def bomb(size):
    """Return a small zstd frame of so many zeros."""
    compressor = zstd.ZstdCompressor()
    parts = [compressor.compress(bytes(1 << 20)) for _ in range(size >> 20)]
    return b''.join((*parts, compressor.flush()))


def test_what_unpacks_into_more_than_a_memory_or_a_disk_takes_is_refused(tmp_path):
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(MAGIC + chunk(12_400_000_000, bomb(32 << 20), 'zstd'))
    with pytest.raises(RecordingError, match=r'read within 1 GB \(--max-memory .*got a chunk of'):
        read_facts(path)
    # a chunk that states less than it holds is cut
    path.write_bytes(MAGIC + chunk(1000, bomb(64 << 20), 'zstd'))
    assert read_facts(path).faults['truncated_file'] == 1
    path = tmp_path / 'bomb.mcap.zstd'
    path.write_bytes(bomb(64 << 20))
    with pytest.raises(RecordingError, match=r'read within 0\.01 GB .* bomb.mcap.zstd, which'):
        read_facts(path, memory=10_000_000)


def test_more_messages_than_the_memory_takes_are_refused(bag, as_sqlite3):
    with pytest.raises(RecordingError, match=r'read within 0.0001 GB .* got a chunk of'):
        read_recording(bag, memory=100_000)
    as_sqlite3(bag)
    with pytest.raises(RecordingError, match=r'read within 0.0001 GB .* got more messages'):
        read_recording(bag, memory=100_000)
    assert len(read_recording(bag, memory=10_000_000).forces) == 2000


ALIASES = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{name}: &{name} [{", ".join(9 * [f"*{before}"])}]\n'
    for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
)
HOSTILE = {
    'nothing': '',
    'bracket': '[',
    'other': 'a: b',
    'number': 'rosbag2_bagfile_information: 3',
    'control': '\x00',
    'dashes': '- - :',
    'aliases': f'custom_data:\n  {ALIASES}'.replace('\n', '\n  '),
    'of itself': 'a: &a [*a]\n',
    'brackets': '[' * 50_000,
    'custom list': 'rosbag2_bagfile_information: {version: 9, custom_data: [1, 2]}\n',
    'no date': 'rosbag2_bagfile_information: {version: 2001-99-99}\n',
    'digits': f'rosbag2_bagfile_information: {{version: {"9" * 5000}}}\n',
    'bytes': '\udcff',
}


@pytest.mark.parametrize('text', list(HOSTILE.values()), ids=list(HOSTILE))
def test_damaged_and_hostile_metadata_are_left_aside(bag, text):
    (bag / 'metadata.yaml').write_bytes(text.encode('utf-8', 'surrogateescape'))
    recording = read_recording(bag)
    assert len(recording.forces) == 2000
    assert recording.facts.faults == {'damaged_metadata': 1}
    assert len(recording.facts.remarks) == 1


def test_a_pipe_is_not_waited_for(tmp_path):
    for name in ('bag_0.mcap', 'bag_0.db3', 'metadata.yaml', 'SHA256SUMS'):
        os.mkfifo(tmp_path / name)
    for path in (tmp_path, tmp_path / 'bag_0.mcap'):
        with pytest.raises(RecordingError, match=r'expected \.mcap or \.db3 files .*, got none'):
            read_facts(path)
    os.mkfifo(tmp_path / 'trial.csv')
    with pytest.raises(RecordingError, match=r'expected a file at .*, got no regular file'):
        import_file(tmp_path / 'trial.csv', ImportOptions())


def test_a_view_without_end_is_not_read(tmp_path):
    path = tmp_path / 'bag.db3'
    with sqlite3.connect(path) as connection:
        connection.execute('CREATE TABLE topics(id, name, type, serialization_format)')
        connection.execute(
            'CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 '
            "FROM n) SELECT id, 1 AS topic_id, id AS timestamp, 'x' AS data FROM n"
        )
    connection.close()
    with pytest.raises(RecordingError, match=r'expected tables of rosbag2 .* no plain table'):
        read_facts(path)


@pytest.mark.long
def test_mutated_recordings_are_read_or_refused(bench, tmp_path):
    paths = bench.simulated(tmp_path)
    for seed in range(FUZZ_ROUNDS):
        ends = bench.try_mutations(paths, 10, seed)
        assert not ends['traceback'], f'seed {seed}'
        ends = bench.try_flips(paths, 2, seed)
        assert not ends['traceback'] + ends['unnamed'], f'seed {seed}'


@pytest.mark.long
@pytest.mark.skipif(find_spec('openpyxl') is None, reason='formats')
def test_mutated_files_of_every_other_kind_are_read_or_refused():
    """In CI as long as the recordings; here a few of each kind, in processes of their own."""
    count = 2 * FUZZ_ROUNDS
    words = [sys.executable, BENCH.with_name('hostile_files.py'), '--count', str(count)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
