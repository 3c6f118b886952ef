# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms info and rpms verify: facts, one line a finding, and the exit code."""

import json
import re
import shutil

import numpy as np

from rpms_ros import load
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, session_hash, write_recording
from rpms_ros.recording.rosbag.verifying import LOST_KEY, PUBLISHERS_KEY


def test_text(rpms, short_session):
    code, out, err = rpms('info', short_session)
    assert (code, err) == (0, '')
    lines = out.splitlines()
    assert lines[0] == f'{short_session}  (mcap)'
    force = '/force geometry_msgs/msg/WrenchStamped 10000 9.999 s 1000.0 Hz'
    assert lines[2].split() == force.split()
    pulses = '/pulses rpms_msgs/msg/Pulse 200 9.950 s 20.0 Hz'
    assert lines[3].split() == pulses.split()
    assert '  schedule: uniform_random' in lines
    assert max(map(len, lines)) <= 100


MILLISECOND = 1_000_000
CHECKS = ['structure', 'checksums', 'publishers', 'lost', 'schedule', 'hash']


def session():
    stamp_ns = 10**18 + np.arange(1000, dtype=np.int64) * MILLISECOND
    pulses = PulseTrain.regular(np.full(20, 0.5), 20.0, 10**18)
    return pulses, ForceTrace(stamp_ns, np.ones(1000))


def lines_of(out):
    """Return what was found by check; several findings of one check are joined."""
    found: dict[str, str] = {}
    for line in out.splitlines():
        check, text = line.split(maxsplit=1)
        found[check] = f'{found.get(check, "")}{text}\n'
    return found


def test_a_good_recording(rpms, short_session):
    code, out, err = rpms('verify', short_session)
    assert (code, err) == (0, '')
    assert [line.split()[0] for line in out.splitlines()] == CHECKS
    found = lines_of(out)
    assert found['hash'].split() == ['ok', session_hash(read_recording(short_session))]
    assert found['checksums'].startswith('ok       SHA-256 of short_0.mcap, metadata.yaml')
    # as of a recorder that was killed
    assert found['lost'] == 'unknown  the recording does not tell\n'
    code, out, _ = rpms('verify', short_session, '--json')
    findings = json.loads(out)['findings']
    assert code == 0
    assert [finding['check'] for finding in findings] == CHECKS


def test_what_the_recorder_noted_and_what_was_changed_since_are_faults(rpms, tmp_path):
    custom = {
        PUBLISHERS_KEY: json.dumps({'/force': 2, '/pulses': 1}),
        LOST_KEY: json.dumps({'/force': 3}),
    }
    write_recording(tmp_path / 'bag', *session(), custom=custom)
    sums = tmp_path / 'bag' / 'SHA256SUMS'
    sums.write_text(sums.read_text().replace('a', 'b'))
    code, out, _ = rpms('verify', tmp_path / 'bag')
    found = lines_of(out)
    assert code == 1
    assert 'FAULT    /force had 2 publishers' in found['publishers']
    assert 'FAULT    3 messages of /force were lost' in found['lost']
    assert found['checksums'].startswith('FAULT')


def test_pulses_on_another_clock_are_a_fault(rpms, tmp_path):
    pulses, forces = session()
    late = PulseTrain.regular(pulses.intensity, 20.0, 10**18 + 3_600_000 * MILLISECOND)
    write_recording(tmp_path / 'bag', late, forces)
    text = 'pulses are from 3600.0 s to 3600.9 s, force from 0.0 s to 1.0 s: they do not overlap'
    code, out, _ = rpms('verify', tmp_path / 'bag')
    assert code == 1
    assert lines_of(out)['clock'] == f'FAULT    {text}\n'
    assert load(tmp_path / 'bag').info()['remarks'] == [text]


def test_a_recording_without_checksums_is_told_by_identify_too(rpms, short_session, tmp_path):
    path = tmp_path / 'bag'
    shutil.copytree(short_session, path)
    text = 'the recording has no checksums: a change of its numbers would not be noticed'
    whole = rpms('identify', path)
    assert text not in whole[2]
    (path / 'SHA256SUMS').unlink()
    code, out, err = rpms('identify', path)
    assert text in err
    assert (code, out) == whole[:2]
    assert 'unknown  there is no SHA256SUMS' in rpms('verify', path)[1]


def test_what_cannot_be_read(rpms, tmp_path):
    code, out, err = rpms('verify', tmp_path)
    assert (code, out) == (2, '')
    assert err.startswith('rpms: error: expected .mcap or .db3 files at ')
    (tmp_path / 'trial.csv').write_text('time,force,gate\n')
    _, _, err = rpms('verify', tmp_path / 'trial.csv')
    assert '; `rpms import` makes a recording of a table' in err
    pulses, _ = session()
    write_recording(tmp_path / 'bag', pulses, ForceTrace(np.empty(0, np.int64), np.empty(0)))
    code, out, _ = rpms('verify', tmp_path / 'bag')
    assert code == 1
    assert 'FAULT    expected messages on topic /force' in lines_of(out)['session']
    code, out, err = rpms('info', tmp_path / 'bag', '--max-memory', '1e-9')
    assert (code, out) == (2, '')
    assert 'read within 1e-09 GB (--max-memory allows more), got a chunk of' in err


def test_a_damaged_chunk_is_told_by_every_command(rpms, tmp_path):
    path = tmp_path / 'session'
    rpms('simulate', '--out', path, '--duration', 30, '--quiet')
    (storage,) = path.glob('*.mcap')
    content = bytearray(storage.read_bytes())
    content[len(content) // 2] ^= 0xFF
    storage.write_bytes(content)
    code, out, _ = rpms('verify', path)
    assert code == 1
    assert 'FAULT    ' in lines_of(out)['hash']
    assert 'of what could be read' in lines_of(out)['hash']
    (line,) = (line for line in rpms('info', path)[1].splitlines() if '/force ' in line)
    assert re.search(r' (9\d\d|1000)\.\d Hz, \d+\.\d{3} s without', line), line
    code, out, _ = rpms('identify', path)
    assert code != 0
    said = ' '.join(out.split())
    assert re.search(r'the recording is damaged: \d+ % of the time .* has no force', said)
    assert 'verdict good' not in said
