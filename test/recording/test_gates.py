# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates as laboratories have them: low while a pulse lasts, without levels, bouncing."""

import numpy as np
import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import (
    Ambiguous,
    ImportOptions,
    import_file,
)

COUNT = 4000
TIME = np.arange(COUNT) / 1000.0
PLACES = np.arange(500, 3500, 50)
NOISE = np.random.default_rng(1).normal(0.0, 0.02, COUNT)


def gate(width=3, level=5.0):
    high = np.zeros(COUNT)
    for place in PLACES:
        high[place : place + width] = level
    return high


def imported(path, values, **options):
    columns = np.column_stack((TIME, np.sin(30.0 * TIME), values))
    np.savetxt(path, columns, delimiter=',', header='Time [s],Force [N],Trigger', comments='')
    return import_file(path, ImportOptions(**options))


def places(found):
    return (found.pulses.onset_ns // 1_000_000).tolist()


def test_a_gate_that_rests_high_falls_with_a_pulse(tmp_path):
    found = imported(tmp_path / 'a.csv', 5.0 - gate() + NOISE)
    assert places(found) == PLACES.tolist()
    np.testing.assert_allclose(found.pulses.width, 3e-3)
    told = "'Trigger', falling edges, as it is high 96 % of the time (--edge decides)"
    assert dict(found.facts)['pulses'] == told
    assert found.guessed
    found = imported(tmp_path / 'a.csv', 5.0 - gate() + NOISE, edge='rising')
    assert places(found) == (PLACES + 3).tolist()
    assert dict(found.facts)['pulses'] == "'Trigger', rising edges (--edge)"


def test_noise_is_no_gate(tmp_path):
    with pytest.raises(
        Ambiguous,
        match=r"expected a gate with two levels in .*, got 'Trigger', \d+ % of it half-way "
        r'between -0\.0\d+ and 0\.0\d+: --threshold LEVEL or --pulse COL decides',
    ):
        imported(tmp_path / 'a.csv', NOISE)
    with pytest.raises(Ambiguous, match='two levels'):
        imported(tmp_path / 'a.csv', NOISE, pulse='Trigger')
    assert len(imported(tmp_path / 'a.csv', NOISE, threshold=0.04).pulses)


def test_hum_does_not_hide_a_gate(tmp_path):
    hum = 1.5 * np.sin(100.0 * np.pi * TIME)
    assert places(imported(tmp_path / 'a.csv', gate(1) + hum)) == PLACES.tolist()


def test_a_trigger_that_bounces_is_told(tmp_path):
    bouncing = np.maximum(gate(1), np.roll(gate(1), 2))
    found = imported(tmp_path / 'a.csv', bouncing, time='Time [s]', force='Force [N]')
    assert len(found.pulses) == 120
    warning = '60 of 120 pulses begin less than 4 ms after the one before: '
    assert dict(found.facts)['warning'].startswith(warning)
    assert found.guessed
    assert 'warning' not in dict(imported(tmp_path / 'a.csv', gate()).facts)


def test_a_gate_that_is_up_in_the_first_row_is_a_pulse_that_is_not_known(tmp_path):
    values = gate()
    values[:2] = 5.0
    found = imported(tmp_path / 'a.csv', values)
    assert places(found) == PLACES.tolist()
    assert found.pulses.sequence[0] == 1
    # what it acts on is left out
    assert found.forces.stamp_ns[0] == found.pulses.onset_ns[0]
    assert dict(found.facts)['warning'].startswith('the gate is up in the first row: ')


@pytest.mark.parametrize(('begin', 'end'), [(500, 3500), (0, 1500)])
def test_a_gate_of_a_whole_train_is_refused(tmp_path, begin, end):
    values = gate()
    values[begin:end] = 5.0
    with pytest.raises(RecordingError, match=r'expected a gate that marks each pulse, for at mos'):
        imported(tmp_path / 'a.csv', values)


SHARES = np.random.default_rng(2).uniform(0.1, 1.0, len(PLACES))
SHARES[0] = 1.0


def heights():
    values = gate()
    for place, share in zip(PLACES, SHARES, strict=True):
        values[place : place + 3] = 5.0 * share
    return values + 0.1 * NOISE


def test_a_trigger_whose_height_is_the_intensity_loses_no_pulse(tmp_path):
    with pytest.raises(Ambiguous, match=r'expected pulses of one height in .* --threshold LEVEL'):
        imported(tmp_path / 'a.csv', heights())
    found = imported(tmp_path / 'a.csv', heights(), threshold=0.2)
    assert places(found) == PLACES.tolist()
    told = "is that the intensity? --intensity 'Trigger/5' decides"
    assert dict(found.facts)['warning'].endswith(told)
    found = imported(tmp_path / 'a.csv', heights(), threshold=0.2, intensity='Trigger/5.01')
    np.testing.assert_allclose(found.pulses.intensity, SHARES, atol=5e-3)
    assert 'warning' not in dict(found.facts)
    with pytest.raises(RecordingError, match=r"intensities from 0 to 1 in 'Trigger', or in a col"):
        imported(tmp_path / 'a.csv', heights(), threshold=0.2, intensity='Trigger')
    with pytest.raises(RecordingError, match=r"COLUMN/FULL, got 'Trigger/x'"):
        imported(tmp_path / 'a.csv', heights(), threshold=0.2, intensity='Trigger/x')


@pytest.mark.parametrize('title', ['intensity', 'Intensity [%]'])
def test_a_column_of_intensities_is_told_and_taken(tmp_path, title):
    held = np.repeat(SHARES, 50) * (100.0 if '%' in title else 1.0)
    held = np.concatenate((np.zeros(PLACES[0]), held, np.zeros(COUNT)))[:COUNT]
    path = tmp_path / 'a.csv'
    columns = np.column_stack((TIME, np.sin(30.0 * TIME), gate(), held))
    head = f'Time [s],Force [N],Trigger,{title}'
    np.savetxt(path, columns, delimiter=',', header=head, comments='')
    stated = {'time': 'Time [s]', 'force': 'Force [N]', 'pulse': 'Trigger'}
    found = import_file(path, ImportOptions(**stated))
    assert set(found.pulses.intensity) == {1.0}
    assert dict(found.facts)['not used'] == repr(title)
    assert f'--intensity {title!r} decides' in dict(found.facts)['warning']
    found = import_file(path, ImportOptions(intensity=title))
    np.testing.assert_allclose(found.pulses.intensity, SHARES)
    assert 'warning' not in dict(found.facts)


def test_intensities_from_a_file(tmp_path):
    shares = tmp_path / 'shares.txt'
    np.savetxt(shares, SHARES)
    found = imported(tmp_path / 'a.csv', gate(), intensity=str(shares))
    np.testing.assert_array_equal(found.pulses.intensity, SHARES)
    np.savetxt(shares, SHARES[1:])
    with pytest.raises(RecordingError, match=r'the intensity of each of 60 pulses in .*, got 59'):
        imported(tmp_path / 'a.csv', gate(), intensity=str(shares))
    with pytest.raises(RecordingError, match=r"a column or a file with --intensity, got 'none'; "):
        imported(tmp_path / 'a.csv', gate(), intensity='none')
