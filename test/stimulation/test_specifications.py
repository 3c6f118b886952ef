# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of devices and patients: nothing is assumed or read loosely, the tighter limit counts."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.limits import device_specification, patient as patient_module
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.forecast import forecast
from rpms_ros.stimulation.limits.limiter import DoseLimits, Limits, PulseLimiter, Rest
from rpms_ros.stimulation.limits.patient import for_session, load_patient
from rpms_ros.stimulation.schedule.fields import bounded_names

SECOND = 1_000_000_000
FOLDER = Path(device_specification.__file__).with_name('device_specifications')
# the example of the module is the one that is tested
PATIENT = patient_module.__doc__.partition('\n\n')[2]
DEVICE = load_device_specification('rapid2-240v')
SIMULATED = load_device_specification('simulated')
DAY = date(2026, 11, 21)
RAPID = (FOLDER / 'rapid2-240v.yaml').read_text(encoding='utf-8')


@pytest.fixture
def written(tmp_path):
    """Write a text to a file; return its path."""

    def write(text):
        path = tmp_path / 'mine.yaml'
        path.write_text(text, encoding='utf-8')
        return path

    return write


def without(text, *starts):
    return '\n'.join(line for line in text.splitlines() if not line.startswith(starts))


@pytest.mark.parametrize('name', bounded_names(Limits))
def test_every_limit_of_a_real_device_is_required(written, name):
    with pytest.raises(StimulationError, match=rf'limits\.{name}: expected every limit of a real'):
        load_device_specification(written(without(RAPID, f'  {name}:')))
    with pytest.raises(StimulationError, match=rf'limits\.{name}: expected '):
        load_device_specification(written(RAPID.replace(f'  {name}: ', f'  {name}:  # ', 1)))


@pytest.mark.parametrize('said', ['', 'simulated_only: false\n'])
def test_no_limits_are_none(written, said):
    text = 'name: mine\ndescription: mine\nlimits: {}\nsources: {}\n'
    with pytest.raises(StimulationError, match=r'limits\.maximum_intensity: expected every limit'):
        load_device_specification(written(text + said))
    assert load_device_specification(written(f'{text}simulated_only: true')).simulated_only


def test_a_coil_that_gets_warm_needs_thermal_figures(written):
    # the figures, and their sources
    figures = ('thermal', '  ambient', '  coil_share', '  heat_capacity', '  time_', '  cutout')
    with pytest.raises(StimulationError, match='thermal: expected thermal figures of a real dev'):
        load_device_specification(written(without(RAPID, *figures)))


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
        ('pulse_energy_j: 252.0', 'pulse_energy_j: 0',
         r'pulse_energy_j: expected a number in \(0, 10000\] J, got 0'),
        ('maximum_rate_hz: 50.0', 'maximum_rate_hz: 1000',
         r'maximum_rate_hz: expected a number in \(0, 100\] Hz, got 1000'),
        ('maximum_intensity_rise: 0.1', 'maximum_intensity_rise: 1.0',
         r'maximum_intensity_rise: expected a number in \[0, 0\.5\], got 1'),
        ('minimum_pause_s: 0.5', 'minimum_pause_s: 0.04',
         r'minimum_pause_s: expected a number in \[0\.5, 86400\] s, got 0\.04'),
        ('ambient: 22.0', 'ambient: -1',
         r'thermal\.ambient: expected a number in \[0, 50\] Celsius, got -1'),
        ('cutout: 40.0', 'cutout: -1',
         r'thermal\.cutout: expected a number in \[0, 150\] Celsius, got -1'),
        ('cutout: 40.0', 'cutout: 22', 'cutout: expected more than ambient, 22, got 22'),
        ('limits:\n', 'simulated_only: "true"\nlimits:\n',
         "simulated_only: expected true or false, got 'true'"),
        ('limits:\n', 'simulated_only: yes\nlimits:\n', "expected true or false, got 'yes'"),
        ('maximum_rate_hz: 50.0', 'maximum_rate_hz: "50.0"',
         r"limits\.maximum_rate_hz: expected a number in .* Hz, got '50.0'"),
        ('energy_window_s: 60.0', 'energy_window_s:', r'limits\.energy_window_s: expected '),
        ('cutout: public figures of the class', 'cutout: ""',
         r"sources\.cutout: expected a text of 1 to 500 printable characters, got ''"),
        ('  cutout: public figures of the class', '', r'sources\.cutout: .* got nothing'),
        ('  cutout: public', '  coutout: a\n  cutout: public',
         r'sources\.coutout: expected one of'),
        ('maximum_rate_hz: 50.0', 'maximum_rate_hz: 50.0\n  fastest: 1',
         r'limits\.fastest: expected one of'),
        ('0.7, 1.0]', '0.7, 0.9]', 'limits: expected a rate limit up to the maximum intensity'),
        ('name: rapid2-240v', 'nme: a\nname: rapid2-240v', 'nme: expected one of'),
        ('name: rapid2-240v', 'name: 3', 'name: expected a text of 1 to 64 .*, got 3'),
        ('name: rapid2-240v', 'name: "\\u202e"', 'name: expected|expected printable text'),
    ],
)  # fmt: skip
def test_what_limits_nothing_or_is_written_loosely_is_refused_with_file_line_and_key(
    written, old, new, fault
):
    assert old in RAPID
    with pytest.raises(StimulationError, match=rf'mine\.yaml: line \d+.*({fault})'):
        load_device_specification(written(RAPID.replace(old, new, 1)))


def test_files_that_are_none(tmp_path):
    known = 'expected a device of rapid2-240v, simulated or'
    for name in ('absent.yaml', '\x00.yaml', '/dev/zero'):
        with pytest.raises(StimulationError, match=known):
            load_device_specification(name)
    path = tmp_path / 'mine.yaml'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(StimulationError, match='expected a readable device specification, got'):
        load_device_specification(str(path))
    path.write_bytes(b' ' * 1_000_000)
    with pytest.raises(StimulationError, match='expected at most 200000 characters of YAML'):
        load_device_specification(str(path))


def test_a_patient_is_read_and_the_tighter_limit_counts(written):
    patient = load_patient(written(PATIENT))
    assert (patient.identifier, patient.device) == ('P01', 'rapid2-240v')
    assert (patient.motor_threshold, patient.largest_comfortable) == (0.32, 0.55)
    assert patient.dose == DoseLimits(4000, 200_000.0, 24.0)
    assert (patient.set_on, patient.expires) == (date(2026, 11, 2), date(2026, 12, 31))
    limits = for_session(DEVICE, patient, DAY).limits
    assert limits.maximum_intensity == 0.55
    assert limits.rest == Rest(1800, 30.0)
    loose = PATIENT.replace('0.55', '1.0').replace('30.0', '0.1')
    unchanged = for_session(DEVICE, load_patient(written(loose)), DAY).limits
    assert unchanged == replace(DEVICE.limits, rest=Rest(1800, DEVICE.limits.minimum_pause_s))


@pytest.mark.parametrize('pause', ['0.5', '2.0', '30.0', '600.0'])
def test_a_rest_loosens_no_limit_of_the_device(written, pause):
    patient = load_patient(written(PATIENT.replace('30.0', pause).replace('0.55', '0.8')))
    for limits in (DEVICE.limits, for_session(DEVICE, patient, DAY).limits):
        limiter = PulseLimiter(replace(limits, maximum_intensity_rise=1.0))
        for index in range(100):
            assert limiter.refusal(index * SECOND // 20, 0.65, 1e-4) is None
            limiter.book(index * SECOND // 20, 0.65)
        last = 99 * SECOND // 20
        refused = limiter.refusals(last + SECOND, 0.65, 1e-4)
        assert [one.limit for one in refused] == ['wait']
        refused = limiter.refusals(last + 10 * SECOND, 0.75, 1e-4)
        assert [one.limit for one in refused] == ['maximum_intensity_step']


def test_a_rest_is_due_after_so_many_pulses_whatever_pauses_are_between():
    limiter = PulseLimiter(replace(SIMULATED.limits, rest=Rest(4, 30.0)))
    for seconds in (0, 1, 10, 20):
        assert limiter.refusal(seconds * SECOND, 0.5, 1e-4) is None
        limiter.book(seconds * SECOND, 0.5)
    refusal = limiter.refusal(49 * SECOND, 0.5, 1e-4)
    assert refusal == (
        'rest',
        'expected a pause of 30 s after at most 4 pulses, got one pulse more',
    )
    for seconds in (50, 51):
        assert limiter.refusal(seconds * SECOND, 0.5, 1e-4) is None
        limiter.book(seconds * SECOND, 0.5)


def test_a_real_device_needs_a_patient_whose_figures_were_found_with_it(written):
    with pytest.raises(StimulationError, match="expected a patient file for the real device 'rap"):
        for_session(DEVICE, None, DAY)
    assert for_session(SIMULATED, None, DAY) is SIMULATED
    others = "found with 'simulated', got those of 'rapid2-240v"
    with pytest.raises(StimulationError, match=others):
        for_session(SIMULATED, load_patient(written(PATIENT)), DAY)


@pytest.mark.parametrize('day', [date(2026, 11, 1), date(2027, 1, 1), date(1970, 1, 1)])
def test_figures_that_do_not_hold_today_are_refused(written, day):
    with pytest.raises(StimulationError, match=f'2026-11-02 to 2026-12-31, got {day}'):
        for_session(DEVICE, load_patient(written(PATIENT)), day)
    for good in (date(2026, 11, 2), date(2026, 12, 31)):
        for_session(DEVICE, load_patient(written(PATIENT)), good)


@pytest.mark.parametrize(
    'key',
    [
        'identifier', 'device', 'motor_threshold', 'largest_comfortable', 'dose', 'rest',
        'set_by', 'set_on', 'expires',
    ],
)  # fmt: skip
def test_nothing_may_be_left_out(written, key):
    with pytest.raises(StimulationError, match=rf'mine\.yaml: line 1, {key}: expected '):
        load_patient(written(without(PATIENT, f'{key}:')))


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
        ('P01', '../P01', 'line 1, identifier: expected a pseudonym of at most 64 letters'),
        ('P01', 'Jane Doe', "line 1, identifier: expected a pseudonym .* got 'Jane Doe'"),
        ('0.32', '0.6', 'line 4, largest_comfortable: expected at least the motor threshold 0.6'),
        ('0.32', '0', r'line 3, motor_threshold: expected a number in \(0, 1\], got 0'),
        ('0.55', '55', r'line 4, largest_comfortable: expected a number in \(0, 1\], got 55'),
        ('4000', '4000.5', r'line 5, dose\.pulses: expected a whole number'),
        ('window_h: 24.0', 'window_h: 1000.0', r'dose\.window_h: expected a number in \[1, 168\]'),
        ('window_h: 24.0', 'hours: 24.0', r'dose\.hours: expected one of'),
        (', window_h: 24.0', '', r'dose\.window_h: expected .* got nothing'),
        ('2026-12-31', '2026-13-31', "line 9, expires: expected a day such as .*'2026-13-31'"),
        ('2026-12-31', '31.12.2026', 'line 9, expires: expected a day such as'),
        ('2026-12-31', '2026-11-01', 'line 9, expires: expected a day within 366 days after'),
        ('2026-12-31', '2028-11-01', 'line 9, expires: expected a day within 366 days after'),
        ('A. Physician', '""', 'line 7, set_by: expected a text of 1 to 64'),
    ],
)
def test_faults_are_named_by_file_line_and_key(written, old, new, fault):
    assert old in PATIENT
    with pytest.raises(StimulationError, match=rf'mine\.yaml: .*{fault}'):
        load_patient(written(PATIENT.replace(old, new)))


def test_a_forecast_knows_the_rest_that_follows():
    train, limits = constant(0.1, 0.5, 20.0), replace(SIMULATED.limits, rest=Rest(10, 30.0))
    assert forecast(train, replace(SIMULATED, limits=limits)).waits_s == (30.0,)
