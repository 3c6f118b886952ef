# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms audit`: what it says of whole, broken and cut files."""

import time
from contextlib import closing

import pytest

from rpms_ros.stimulation.limits.limiter import BookedPulse
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, ChainedFile
from rpms_ros.stimulation.records.dose_ledger import DoseLedger


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'audit.jsonl'


def write(path):
    with closing(ChainedFile(path, AUDIT_LOG)) as log:
        log.append('session', {'who': 'operator-a', 'device': 'rapid2-240v', 'patient': 'P01'})
        log.append('limits', {'figures': {'maximum_intensity': 0.55, 'maximum_rate_hz': 50.0}})
        log.append('arm', {'who': 'operator-a'})
        log.append('refusal', {'limit': 'maximum_rate_hz', 'reason': '\x1b[2Jexpected\n\ud800'})
        log.append('reset', {'who': 'operator-b'})


def test_a_whole_log(path, rpms):
    write(path)
    code, out, err = rpms('audit', path)
    assert (code, err) == (0, '')
    assert f'{path}: 6 records, whole' in out
    assert 'arm 1, limits 1, refusal 1, reset 1, session 1' in out
    assert 'UTC: {"who": "operator-a", "device": "rapid2-240v", "patient": "P01"}' in out
    assert '"figures": {"maximum_intensity": 0.55, "maximum_rate_hz": 50.0}' in out
    # nothing that is logged reaches the terminal as it came
    assert r'"reason": "\u001b[2Jexpected\n\ud800"' in out
    assert 'newest hash  ' in out
    assert '"who": "operator-b"' in out


def test_the_first_broken_record_is_named(path, rpms):
    write(path)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[3] = lines[3].replace(b'operator-a', b'operator-b')
    path.write_bytes(b''.join(lines))
    code, out, _ = rpms('audit', path)
    assert code == 1
    assert f'{path}: 3 records, BROKEN' in out
    assert 'line 4: expected the next record of the chain, got a line that is not record 3' in out


def test_a_log_cut_off_by_a_kill(path, rpms):
    write(path)
    path.write_bytes(path.read_bytes()[:-20])
    code, out, _ = rpms('audit', path)
    assert code == 1
    assert 'bytes at the end: a process was killed' in out
    write(path)
    code, out, _ = rpms('audit', path)
    assert code == 0
    assert 'cut off      1 times before, and continued' in out


def test_a_ledger_is_verified_too(tmp_path, rpms):
    with closing(DoseLedger(tmp_path, 'coil', 'P01')) as ledger:
        pulses = [BookedPulse(time.monotonic_ns(), 0.5, 10.0)] * 4
        ledger.take(ledger.reserve(pulses)[0])
    path = tmp_path / 'patient-p01.ledger'
    code, out, _ = rpms('audit', path)
    assert code == 0
    assert 'of patient P01' in out
    assert '4 pulses and 40 J reserved, 3 pulses given back' in out
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert rpms('audit', path)[0] == 1


def test_what_is_no_log(tmp_path, rpms):
    code, _, err = rpms('audit', tmp_path / 'absent')
    assert code == 2
    assert 'expected an audit log or a dose ledger, got' in err
    path = tmp_path / 'other'
    path.write_bytes(bytes(range(256)) * 10)
    code, out, _ = rpms('audit', path)
    assert code == 1
    assert '0 records, BROKEN' in out
    path.write_bytes(b'')
    code, out, _ = rpms('audit', path)
    assert code == 1
    assert 'expected at least one record, got none' in out
