# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Patient files: every figure required, tighter than the device, and only as long as they hold."""

from datetime import date

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.limits import patient as patient_module
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.limits import DoseLimits
from rpms_ros.stimulation.limits.patient import for_session, load_patient, patient_from_mapping

# the example of the module is the one that is tested
PATIENT = patient_module.__doc__.partition('\n\n')[2]
RAPID = load_device_specification('rapid2-240v')
SIMULATED = load_device_specification('simulated')
DAY = date(2026, 11, 21)


@pytest.fixture
def load(tmp_path):
    def load_text(text):
        path = tmp_path / 'p01.yaml'
        path.write_text(text, encoding='utf-8')
        return load_patient(path)

    return load_text


def test_a_patient_is_read(load):
    patient = load(PATIENT)
    assert (patient.identifier, patient.device) == ('P01', 'rapid2-240v')
    assert (patient.motor_threshold, patient.largest_comfortable) == (0.32, 0.55)
    assert patient.dose == DoseLimits(4000, 200_000.0, 24.0)
    assert patient.rest.pause_s == 30.0
    assert (patient.set_on, patient.expires) == (date(2026, 11, 2), date(2026, 12, 31))


def test_the_tighter_limit_counts(load):
    limits = for_session(RAPID, load(PATIENT), DAY).limits
    assert limits.maximum_intensity == 0.55
    assert limits.minimum_pause_s == 30.0
    assert limits.maximum_train_pulses == 1800
    loose = PATIENT.replace('0.55', '1.0').replace('1800', '9000').replace('30.0', '0.1')
    unchanged = for_session(RAPID, load(loose), DAY).limits
    assert unchanged == RAPID.limits


def test_a_real_device_needs_a_patient():
    with pytest.raises(StimulationError, match="expected a patient file for the real device 'rap"):
        for_session(RAPID, None, DAY)
    assert for_session(SIMULATED, None, DAY) is SIMULATED


@pytest.mark.parametrize('day', [date(2026, 11, 1), date(2027, 1, 1), date(1970, 1, 1)])
def test_figures_that_do_not_hold_today_are_refused(load, day):
    with pytest.raises(StimulationError, match=f'2026-11-02 to 2026-12-31, got {day}'):
        for_session(RAPID, load(PATIENT), day)
    for good in (date(2026, 11, 2), date(2026, 12, 31)):
        for_session(RAPID, load(PATIENT), good)


def test_figures_of_another_device_are_refused(load):
    with pytest.raises(
        StimulationError, match="found with 'simulated', got those of 'rapid2-240v"
    ):
        for_session(SIMULATED, load(PATIENT), DAY)


@pytest.mark.parametrize(
    'key',
    [
        'identifier', 'device', 'motor_threshold', 'largest_comfortable', 'dose', 'rest',
        'set_by', 'set_on', 'expires',
    ],
)  # fmt: skip
def test_nothing_may_be_left_out(load, key):
    lines = [line for line in PATIENT.splitlines() if not line.startswith(f'{key}:')]
    with pytest.raises(StimulationError, match=rf'p01\.yaml: line 1, {key}: expected '):
        load('\n'.join(lines))


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
        ('P01', '../P01', 'line 1, identifier: expected a pseudonym of at most 64 letters'),
        ('P01', 'Jane Doe', "line 1, identifier: expected a pseudonym .* got 'Jane Doe'"),
        ('0.32', '0.6', 'line 4, largest_comfortable: expected at least the motor threshold 0.6'),
        ('0.32', '0', r'line 3, motor_threshold: expected a number in \(0, 1\], got 0'),
        ('0.55', '55', r'line 4, largest_comfortable: expected a number in \(0, 1\], got 55'),
        ('4000', '4000.5', r'line 5, dose\.pulses: expected a whole number'),
        ('window_h: 24.0', 'window_h: 1000.0', r'dose\.window_h: expected a number in \(0, 168\]'),
        ('window_h: 24.0', 'hours: 24.0', r'dose\.hours: expected one of'),
        (', window_h: 24.0', '', r'dose\.window_h: expected .* got nothing'),
        ('2026-12-31', '2026-13-31', "line 9, expires: expected a day such as .*'2026-13-31'"),
        ('2026-12-31', '31.12.2026', 'line 9, expires: expected a day such as'),
        ('2026-12-31', '2026-11-01', 'line 9, expires: expected a day within 366 days after'),
        ('2026-12-31', '2028-11-01', 'line 9, expires: expected a day within 366 days after'),
        ('A. Physician', '""', 'line 7, set_by: expected a text of 1 to 64'),
    ],
)
def test_faults_are_named_by_file_line_and_key(load, old, new, fault):
    assert old in PATIENT
    with pytest.raises(StimulationError, match=rf'p01\.yaml: .*{fault}'):
        load(PATIENT.replace(old, new))


def test_a_patient_is_a_mapping():
    with pytest.raises(StimulationError, match='expected a mapping of names to values, got None'):
        patient_from_mapping(None)
