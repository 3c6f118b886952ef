# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms check` and `rpms protocol`: verdicts, exit codes, JSON, faults of the input."""

import json

import pytest

from rpms_ros.stimulation import load_schedule, paper_random, paper_sinusoid

KEYS = [
    *('deliverable', 'violations', 'pulses', 'duration_s', 'energy_j', 'mean_power_w'),
    *('max_rate_hz', 'waits_s', 'highest_temperature'),
]


@pytest.fixture
def written(tmp_path, rpms):
    """Write a protocol; return its file."""

    def write(name, *options):
        path = tmp_path / f'{name}{len(list(tmp_path.iterdir()))}.yaml'
        code, out, err = rpms('protocol', name, '--out', path, *options)
        assert (code, err) == (0, '')
        assert str(path) in out
        return path

    return write


@pytest.mark.parametrize('name', ['uniform_random', 'sinusoid'])
def test_the_paper_is_not_deliverable(written, rpms, name):
    code, out, err = rpms('check', written(name), '--device', 'rapid2-240v')
    assert (code, err) == (1, '')
    assert f'{name} on rapid2-240v: NOT deliverable' in out
    for limit in ('rate_limits_hz', 'continuous_power_w'):
        assert limit in out


@pytest.mark.parametrize(
    ('segments', 'limit', 'said'),
    [
        (
            '{kind: constant, rate_hz: 20.0, duration_s: 2001.0, intensity: 0.1}',
            'schedule_pulses', 'expected at most 40000 pulses in a schedule, got 40020',
        ),
        (
            '{kind: pause, duration_s: 59.97}, {kind: single, intensity: 0.1}',
            'idle_disarm_s', 'expected at most 60 s without a pulse',
        ),
    ],
)  # fmt: skip
def test_what_a_driver_refuses_is_not_deliverable(tmp_path, rpms, segments, limit, said):
    path = tmp_path / 'long.yaml'
    path.write_text(f'name: long\nsegments: [{segments}]\n')
    code, out, _ = rpms('check', path, '--device', 'simulated')
    assert code == 1
    assert f'{limit}: {said}' in out


def test_slow_protocols_have_catch_pulses(written, rpms, tmp_path):
    for name in ('sinusoid', 'staircase'):
        (segment,) = load_schedule(written(name)).segments
        assert segment.catch_share == 0.1
    out = str(tmp_path / 'constant.yaml')
    for share in ('0.2', '0'):
        code, _, err = rpms('protocol', 'constant', '--catch', share, '--out', out)
        assert (code, err) == (2, f'rpms: error: expected no --catch with constant, got {share}\n')


def test_json_is_one_object_with_its_keys(written, rpms):
    code, out, _ = rpms('check', written('uniform_random'), '--device', 'rapid2-240v', '--json')
    document = json.loads(out)
    assert code == 1
    assert list(document) == KEYS
    assert document['deliverable'] is False
    # E[u^2] of one draw is within 1 % of 1/3
    assert document['mean_power_w'] == pytest.approx(1680.0, rel=0.01)
    assert document['energy_j'] == pytest.approx(90 * document['mean_power_w'], rel=1e-9)
    assert document['max_rate_hz'] == 20.0
    assert len(document['waits_s']) == 1
    assert {entry['limit'] for entry in document['violations']} >= {'rate_limits_hz'}
    assert all(entry['reason'].startswith('expected') for entry in document['violations'])


def test_protocols_are_those_of_the_paper_which_options_change(written, rpms, tmp_path):
    assert load_schedule(written('uniform_random')) == paper_random()
    assert load_schedule(written('sinusoid', '--catch', '0')) == paper_sinusoid()
    changed = written('uniform_random', '--rate', '10', '--duration', '5', '--seed', '7')
    assert load_schedule(changed) == paper_random(duration_s=5.0, rate_hz=10.0, seed=7)
    assert load_schedule(written('recruitment', '--rate', '20')).plan.highest_rate_hz == 20.0
    code, _, err = rpms('protocol', 'constant', '--seed', 3, '--out', tmp_path / 'new.yaml')
    assert (code, 'expected no --seed with constant, got 3' in err) == (2, True)


def test_what_is_deliverable_says_so(tmp_path, rpms):
    path = tmp_path / 'mild.yaml'
    path.write_text(
        'name: mild\nsegments:\n- {kind: ramp, rate_hz: 10.0, duration_s: 20.0, end: 0.4}\n'
        '- {kind: pause, duration_s: 3.0}\n- {kind: single, intensity: 0.45}\n'
    )
    code, out, err = rpms('check', path, '--device', 'rapid2-240v')
    assert (code, err) == (0, '')
    assert 'mild on rapid2-240v: deliverable' in out
    code, out, _ = rpms('check', path, '--device', 'rapid2-240v', '--json')
    document = json.loads(out)
    assert code == 0
    assert document['violations'] == []
    assert document['waits_s'] == [0.5, 0.5]
    assert 22.0 < document['highest_temperature'] < 40.0


@pytest.mark.parametrize(
    ('text', 'device', 'fault'),
    [
        ('segments: [', 'rapid2-240v', 'expected a YAML document'),
        ('segments: [{kind: pause}]', 'rapid2-240v', 'line 1, segments[0].duration_s: expected'),
        (
            'segments: [{kind: single, intensity: 1}]',
            'oracle',
            'expected a device of rapid2-240v, simulated',
        ),
    ],
)
def test_unusable_input_is_one_line(tmp_path, rpms, text, device, fault):
    path = tmp_path / 'schedule.yaml'
    path.write_text(text)
    code, out, err = rpms('check', path, '--device', device, '--json')
    assert (code, out) == (2, '')
    assert err.startswith('rpms: error: ')
    assert err.count('\n') == 1
    assert fault in err


def test_files_that_cannot_be_read_or_written(tmp_path, rpms):
    (tmp_path / 'bytes').write_bytes(b'segments: \xff\xfe')
    (tmp_path / 'mine').write_text('mine')
    check = ('check', '--device', 'simulated')
    protocol = ('protocol', 'uniform_random', '--out')
    for command, fault in (
        ((*check, tmp_path / 'absent.yaml'), 'expected a readable schedule file'),
        ((*check, tmp_path), ': no regular file\n'),
        ((*check, tmp_path / 'bytes'), 'bytes: no text in UTF-8 at byte 10\n'),
        ((*protocol, tmp_path / 'no' / 'x.yaml'), 'expected a file to write'),
        ((*protocol, tmp_path / 'mine'), f'a new file for the schedule, got {tmp_path / "mine"}'),
        ((*protocol, tmp_path / 'x.yaml', '--rate', '0'), 'expected a number in [0.001, 1000] Hz'),
    ):
        code, out, err = rpms(*command)
        assert (code, out, fault in err) == (2, '', True), err
    assert (tmp_path / 'mine').read_text() == 'mine'


def test_a_patient_bounds_what_a_device_could_do(rpms, tmp_path, patient_file):
    path, figures = tmp_path / 's.yaml', patient_file.read_text()
    path.write_text(
        'segments:\n- {kind: ramp, rate_hz: 10.0, duration_s: 20.0, end: 0.6}\n'
        '- {kind: constant, rate_hz: 10.0, duration_s: 170.0, intensity: 0.1}\n'
    )
    check = ('check', path, '--device', 'rapid2-240v')
    code, out, _ = rpms(*check)
    assert code == 0
    assert "patient      none: the device's limits alone" in out
    code, out, _ = rpms(*check, '--patient', patient_file)
    assert code == 1
    assert 'maximum_intensity: expected an intensity in [0, 0.55]' in out
    assert 'rest: expected a pause of 30 s after at most 1800 pulses' in out
    assert 'for patient P01: NOT deliverable' in out
    assert 'pulses above the motor threshold 0.32' in out
    for before, after, reason in (
        (
            'pulses: 4000',
            'pulses: 100',
            'dose_pulses: expected at most 100 pulses in 24 h, got 19',
        ),
        ('200.0e+3', '10.0', 'dose_energy_j: expected at most 10 J in 24 h, got'),
    ):
        patient_file.write_text(figures.replace(before, after))
        assert reason in rpms(*check, '--patient', patient_file)[1]


def test_patients_that_do_not_fit(rpms, tmp_path, patient_file):
    path = tmp_path / 's.yaml'
    path.write_text('segments: [{kind: single, intensity: 0.1}]')
    code, _, err = rpms('check', path, '--device', 'simulated', '--patient', patient_file)
    assert code == 2
    assert "patient P01: expected figures found with 'simulated'" in err
    figures, _ = patient_file.read_text().split('set_on: ')
    patient_file.write_text(f'{figures}set_on: 2020-01-01\nexpires: 2020-01-01\n')
    code, _, err = rpms('check', path, '--device', 'rapid2-240v', '--patient', patient_file)
    assert code == 2
    assert 'expected a day from 2020-01-01 to 2020-01-01' in err
