# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The audit log: it only grows, nobody can change it unseen, and nothing hostile breaks it."""

import itertools
import json
import os
from contextlib import closing

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, FIRST, ChainedFile, verify_log


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'logs' / 'audit.jsonl'


def filled(path, count=3):
    with closing(ChainedFile(path, AUDIT_LOG)) as log:
        for number in range(count):
            log.append('refusal', {'who': 'operator', 'limit': 'maximum_rate_hz', 'pulse': number})
    return path.read_bytes().splitlines(keepends=True)


def test_every_line_is_json_with_number_time_and_boot_and_chained(path):
    lines = [json.loads(line) for line in filled(path)]
    assert [line['number'] for line in lines] == [0, 1, 2, 3]
    assert [line['kind'] for line in lines] == ['begin', 'refusal', 'refusal', 'refusal']
    assert lines[0]['purpose'] == 'audit log'
    assert lines[0]['previous'] == FIRST
    for before, line in itertools.pairwise(lines):
        assert line['previous'] == before['hash']
        assert line['time'].endswith('Z')
        assert len(line['boot_id'].rpartition('/')[2]) == 36
    assert lines[3]['pulse'] == 2
    found = verify_log(path)
    assert not found.fault
    assert [record.content for record in found.records] == lines
    assert found.hash == lines[-1]['hash']


@pytest.mark.parametrize(
    ('change', 'line'),
    [
        (lambda lines: [lines[0], lines[2], lines[3]], 2),
        (lambda lines: [lines[0], lines[2], lines[1], lines[3]], 2),
        (lambda lines: [*lines[:2], lines[2].replace(b'operator', b'somebody'), lines[3]], 3),
        (lambda lines: [*lines, lines[3]], 5),
        (lambda lines: [b'\n', *lines], 1),
        (lambda lines: lines[1:], 1),
        (lambda lines: [*lines, b'{}\n'], 5),
        (lambda lines: [*lines[:3], lines[3].replace(b'"pulse":2', b'"pulse":1')], 4),
    ],
)
def test_a_change_is_found_at_its_first_record_and_nothing_is_added(path, change, line):
    lines = filled(path)
    path.write_bytes(b''.join(change(lines)))
    found = verify_log(path)
    assert found.fault
    assert len(found.records) == line - 1
    assert f'line {line}: expected the next record of the chain' in found.fault
    with pytest.raises(StimulationError, match=f'line {line}: expected the next record'):
        ChainedFile(path, AUDIT_LOG)


@pytest.mark.parametrize('cut', [1, 10, 200])
def test_a_line_cut_off_by_a_kill_is_marked_and_the_log_goes_on(path, cut):
    filled(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    assert verify_log(path).torn > 0
    filled(path, 1)
    found = verify_log(path)
    assert not found.fault
    kinds = [record.content['kind'] for record in found.records]
    # only the end of the line was missing: the record itself is whole
    kept = 3 if cut == 1 else 2
    marks = [] if cut == 1 else ['torn']
    assert kinds == ['begin', *['refusal'] * kept, *marks, 'refusal']
    assert path.read_bytes().startswith(whole[:-cut])
    # what was cut off cannot be changed afterwards either
    data = bytearray(path.read_bytes())
    data[len(whole) - cut - 5] ^= 1
    path.write_bytes(data)
    assert 'line 4: ' in verify_log(path).fault


def test_on_a_full_disk_nothing_is_written_behind_a_line_cut_off(path, monkeypatch):
    """The end of the line was, without what explains it: no later opener took the file."""
    filled(path)
    path.write_bytes(cut := path.read_bytes()[:-10])
    with monkeypatch.context() as patch:
        full = os.statvfs_result((4096, 4096, 1000, 10, 10, 0, 0, 0, 0, 255))
        patch.setattr('rpms_ros.stimulation.records.append_only.os.fstatvfs', lambda _: full)
        with pytest.raises(StimulationError, match='a disk with less than 1000000 bytes left'):
            ChainedFile(path, AUDIT_LOG)
    assert path.read_bytes() == cut
    filled(path, 1)
    assert not verify_log(path).fault


def test_a_first_line_cut_off_begins_again(path):
    path.parent.mkdir()
    path.write_bytes(b'{"number":0,"ki')
    filled(path, 1)
    assert not verify_log(path).fault
    assert [record.line for record in verify_log(path).records] == [2, 3]


def test_a_file_of_another_kind_is_refused(path):
    path.parent.mkdir()
    path.write_text('{"not": "ours"}\n')
    with pytest.raises(StimulationError, match='line 1: expected the next record'):
        ChainedFile(path, AUDIT_LOG)
    assert path.read_text() == '{"not": "ours"}\n'
    path.write_text('')
    assert 'expected at least one record, got none' in verify_log(path).fault
    assert 'expected a readable file' in verify_log(path.parent / 'absent').fault
    (path.parent / 'long').write_bytes(b'x' * 2_000_000)
    assert 'expected a shorter line' in verify_log(path.parent / 'long').fault


def test_anything_printable_or_not_is_kept_and_what_json_cannot_hold_is_refused(path):
    with closing(ChainedFile(path, AUDIT_LOG)) as log:
        log.append('refusal', {'reason': '\ud800\n\x00"'})
        for wrong in (float('nan'), object()):
            with pytest.raises(StimulationError, match='expected a record that JSON can hold'):
                log.append('wrong', {'value': wrong})
        with pytest.raises(StimulationError, match='expected a record of less than 1000000 bytes'):
            log.append('wrong', {'value': 'x' * 1_000_000})
    found = verify_log(path)
    assert not found.fault
    assert [record.content.get('reason') for record in found.records] == [None, '\ud800\n\x00"']


def test_a_log_that_cannot_be_written_says_so(path, tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(StimulationError, match=r'expected .* to write and lock, got'):
        ChainedFile(tmp_path / 'file' / 'audit.jsonl', AUDIT_LOG)
    log = ChainedFile(path, AUDIT_LOG)
    log.look()
    path.unlink()
    for write in (log.look, lambda: log.append('arm', {})):
        with pytest.raises(StimulationError, match=r'expected a writable .*No such file'):
            write()
    log.close()
    log = ChainedFile(path, AUDIT_LOG)
    log.close()
    with pytest.raises(StimulationError, match=r'expected a writable .*, got a closed file'):
        log.append('arm', {})


def test_an_interruption_after_a_record_was_written_costs_no_record_behind_it(path, monkeypatch):
    with closing(ChainedFile(path, AUDIT_LOG)) as log:
        sync = os.fsync

        def interrupted(file):
            sync(file)
            raise KeyboardInterrupt

        monkeypatch.setattr(os, 'fsync', interrupted)
        with pytest.raises(KeyboardInterrupt):
            log.append('session', {})
        monkeypatch.undo()
        with pytest.raises(StimulationError, match='got KeyboardInterrupt'):
            log.append('end', {})
    assert not verify_log(path).fault
    with closing(ChainedFile(path, AUDIT_LOG)) as log:
        log.append('session', {})
    assert [one.content['kind'] for one in verify_log(path).records] == [
        'begin',
        'session',
        'session',
    ]
