# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Device specifications: for a real device nothing is assumed, and nothing is read loosely."""

from pathlib import Path

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.limits import device_specification
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.limits import Limits
from rpms_ros.stimulation.schedule.fields import bounded_names

FOLDER = Path(device_specification.__file__).with_name('device_specifications')
RAPID = (FOLDER / 'rapid2-240v.yaml').read_text(encoding='utf-8')


@pytest.fixture
def load(tmp_path):
    def load_text(text):
        path = tmp_path / 'mine.yaml'
        path.write_text(text, encoding='utf-8')
        return load_device_specification(str(path))

    return load_text


def without(name):
    lines = RAPID.splitlines(keepends=True)
    return ''.join(line for line in lines if not line.startswith(f'  {name}:'))


@pytest.mark.parametrize('name', bounded_names(Limits))
def test_every_limit_of_a_real_device_is_required(load, name):
    with pytest.raises(StimulationError, match=rf'limits\.{name}: expected every limit of a real'):
        load(without(name))
    with pytest.raises(StimulationError, match=rf'limits\.{name}: expected '):
        load(RAPID.replace(f'  {name}: ', f'  {name}:  # ', 1))


@pytest.mark.parametrize(
    'text',
    [
        'name: mine\ndescription: mine\nlimits: {}\nsources: {}',
        'name: mine\ndescription: mine\nsimulated_only: false\nlimits: {}\nsources: {}',
    ],
)
def test_no_limits_are_none(load, text):
    with pytest.raises(StimulationError, match=r'limits\.maximum_intensity: expected every limit'):
        load(text)
    assert load(text.replace('limits', 'simulated_only: true\nlimits', 1).replace(
        'simulated_only: false\n', ''
    )).simulated_only  # fmt: skip


def test_a_coil_that_gets_warm_needs_thermal_figures(load):
    begin, end = RAPID.index('thermal:'), RAPID.index('sources:')
    text = RAPID[:begin] + RAPID[end:]
    for figure in ('ambient', 'coil_share', 'heat_capacity', 'time_constant', 'cutout'):
        text = '\n'.join(line for line in text.splitlines() if not line.startswith(f'  {figure}:'))
    with pytest.raises(StimulationError, match='thermal: expected thermal figures of a real dev'):
        load(text)


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
        ('pulse_energy_j: 252.0', 'pulse_energy_j: 0',
         r'pulse_energy_j: expected a number in \(0, 10000\] J, got 0'),
        ('maximum_rate_hz: 50.0', 'maximum_rate_hz: 1000',
         r'maximum_rate_hz: expected a number in \(0, 100\] Hz, got 1000'),
        ('maximum_intensity_rise: 0.1', 'maximum_intensity_rise: 1.0',
         r'maximum_intensity_rise: expected a number in \[0, 0\.5\], got 1'),
        ('ambient: 22.0', 'ambient: -1',
         r'thermal\.ambient: expected a number in \[0, 50\] Celsius, got -1'),
        ('cutout: 40.0', 'cutout: -1',
         r'thermal\.cutout: expected a number in \[0, 150\] Celsius, got -1'),
        ('cutout: 40.0', 'cutout: 22', 'cutout: expected more than ambient, 22, got 22'),
    ],
)  # fmt: skip
def test_limits_that_limit_nothing_are_refused_for_a_real_device(load, old, new, fault):
    assert old in RAPID
    with pytest.raises(StimulationError, match=fault):
        load(RAPID.replace(old, new, 1))


@pytest.mark.parametrize(
    ('old', 'new', 'fault'),
    [
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
def test_loose_writing_is_refused_with_file_line_and_key(load, old, new, fault):
    assert old in RAPID
    changed = RAPID.replace(old, new, 1)
    with pytest.raises(StimulationError, match=rf'mine\.yaml: line \d+.*({fault})'):
        load(changed)


def test_the_specification_that_is_shipped_bounds_steps(load):
    limits = load(RAPID).limits
    assert limits.maximum_intensity_step < 1.0


def test_files_that_are_none(tmp_path):
    for name in ('absent.yaml', '\x00.yaml', '/dev/zero'):
        with pytest.raises(
            StimulationError, match='expected a device of rapid2-240v, simulated or'
        ):
            load_device_specification(name)
    path = tmp_path / 'mine.yaml'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(StimulationError, match='expected a readable device specification, got'):
        load_device_specification(str(path))
    path.write_bytes(b' ' * 1_000_000)
    with pytest.raises(StimulationError, match='expected at most 200000 characters of YAML'):
        load_device_specification(str(path))
