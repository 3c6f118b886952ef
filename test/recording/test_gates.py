# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates as laboratories have them, in tables that begin at rest or amid stimulation, and lists."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.identification import CURVE_INTENSITY, estimator_by_name, identify
from rpms_ros.muscle import Contraction, Subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording.importing import Ambiguous, ImportOptions, import_file
from rpms_ros.recording.importing.gates import gate_pulses, list_unit
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.whole_file import begins_amid

COUNT = 4000
TIME = np.arange(COUNT) / 1000.0
PLACES = np.arange(500, 3500, 50)
NOISE = np.random.default_rng(1).normal(0.0, 0.02, COUNT)


def gate(width=3, level=5.0):
    return level * np.isin(np.arange(COUNT), PLACES[:, None] + np.arange(width))


def imported(path, *values, title='', **options):
    columns = np.column_stack((TIME, np.sin(30.0 * TIME), *values))
    head = f'Time [s],Force [N],Trigger{title}'
    np.savetxt(path, columns, delimiter=',', header=head, comments='')
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


def test_no_pulse_of_a_gate_with_two_phases_is_lost(tmp_path):
    second = np.roll(gate(), 3)
    found = imported(tmp_path / 'a.csv', gate() - second)
    assert places(found) == PLACES.tolist()
    assert found.pulses.sequence[0] == 0
    np.testing.assert_allclose(found.pulses.width, 3e-3)


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


def test_a_trigger_whose_height_is_the_intensity_loses_no_pulse(tmp_path):
    heights = gate(level=1.0)
    heights[heights > 0.0] *= np.repeat(5.0 * SHARES, 3)
    heights += 0.1 * NOISE
    with pytest.raises(Ambiguous, match=r'expected pulses of one height in .* --threshold LEVEL'):
        imported(tmp_path / 'a.csv', heights)
    found = imported(tmp_path / 'a.csv', heights, threshold=0.2)
    assert places(found) == PLACES.tolist()
    told = "is that the intensity? --intensity 'Trigger/5' decides"
    assert dict(found.facts)['warning'].endswith(told)
    found = imported(tmp_path / 'a.csv', heights, threshold=0.2, intensity='Trigger/5.01')
    np.testing.assert_allclose(found.pulses.intensity, SHARES, atol=5e-3)
    assert 'warning' not in dict(found.facts)
    with pytest.raises(RecordingError, match=r"intensities from 0 to 1 in 'Trigger', or in a col"):
        imported(tmp_path / 'a.csv', heights, threshold=0.2, intensity='Trigger')
    with pytest.raises(RecordingError, match=r"NAME/FULL, got 'Trigger/x'"):
        imported(tmp_path / 'a.csv', heights, threshold=0.2, intensity='Trigger/x')


@pytest.mark.parametrize('title', ['intensity', 'Intensity [%]'])
def test_a_column_of_intensities_is_told_and_taken(tmp_path, title):
    held = np.repeat(SHARES, 50) * (100.0 if '%' in title else 1.0)
    held = np.concatenate((np.zeros(PLACES[0]), held, np.zeros(COUNT)))[:COUNT]
    given = tmp_path / 'a.csv', gate(), held
    stated = {'time': 'Time [s]', 'force': 'Force [N]', 'pulse': 'Trigger'}
    found = imported(*given, title=f',{title}', **stated)
    assert set(found.pulses.intensity) == {1.0}
    assert dict(found.facts)['not used'] == repr(title)
    assert f'--intensity {title!r} decides' in dict(found.facts)['warning']
    found = imported(*given, title=f',{title}', intensity=title)
    np.testing.assert_allclose(found.pulses.intensity, SHARES)
    assert 'warning' not in dict(found.facts)


def test_shares_below_a_title_of_per_cent_are_not_divided_by_a_hundred(tmp_path):
    # as a workbook stores what it shows as 80 %
    held = np.repeat(SHARES, 50)
    held = np.concatenate((np.zeros(PLACES[0]), held, np.zeros(COUNT)))[:COUNT]
    title, given = 'Intensity [%]', (tmp_path / 'a.csv', gate(), held)
    with pytest.raises(
        RecordingError, match=r'expected intensities in % .*, got 1 at most: --int'
    ):
        imported(*given, title=f',{title}', intensity=title)
    found = imported(*given, title=f',{title}', intensity=f'{title}/1')
    np.testing.assert_allclose(found.pulses.intensity, SHARES)


def test_intensities_from_a_file(tmp_path):
    shares = tmp_path / 'shares.txt'
    np.savetxt(shares, SHARES)
    found = imported(tmp_path / 'a.csv', gate(), intensity=str(shares))
    np.testing.assert_array_equal(found.pulses.intensity, SHARES)
    np.savetxt(shares, 60.0 * SHARES)
    with pytest.raises(RecordingError, match=r'--intensity \S+shares.txt/FULL divides by the val'):
        imported(tmp_path / 'a.csv', gate(), intensity=str(shares))
    found = imported(tmp_path / 'a.csv', gate(), intensity=f'{shares}/60')
    np.testing.assert_allclose(found.pulses.intensity, SHARES)
    np.savetxt(shares, SHARES[1:])
    with pytest.raises(RecordingError, match=r'the intensity of each of 60 pulses in .*, got 59'):
        imported(tmp_path / 'a.csv', gate(), intensity=str(shares))
    with pytest.raises(RecordingError, match=r"a column or a file with --intensity, got 'none'; "):
        imported(tmp_path / 'a.csv', gate(), intensity='none')


MILLISECOND = 1_000_000


@given(
    st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=1, max_size=20),
    st.integers(0, 2**32 - 1),
    st.floats(-5.0, 5.0),
    st.floats(0.01, 10.0),
)
def test_pulses_are_found_whatever_the_level_and_noise(spans, seed, rest, height):
    levels = np.concatenate([[0.0] * low + [1.0] * high for low, high in spans] + [[0.0]])
    stamp_ns = np.arange(len(levels), dtype=np.int64) * MILLISECOND
    # A fifth of the height, either way: the two thresholds lie 45 % from either level.
    noise = np.random.default_rng(seed).uniform(-0.2, 0.2, len(levels))
    pulses = gate_pulses(stamp_ns, rest + height * (levels + noise), ImportOptions(intensity=0.4))
    low, high = np.array(spans).T
    onset = np.cumsum(low + high) - high
    assert pulses.onset_ns.tolist() == (onset * MILLISECOND).tolist()
    assert pulses.width.tolist() == (high / 1000).tolist()
    assert set(pulses.intensity) == {0.4}


def test_chatter_at_the_threshold_is_one_pulse():
    gate = np.array([0.0, 0.45, 0.53, 0.6, 0.48, 0.52, 0.49, 1.0, 0.51, 0.2, 0.0])
    stamp_ns = np.arange(len(gate), dtype=np.int64) * MILLISECOND
    pulses = gate_pulses(stamp_ns, gate, ImportOptions())
    assert pulses.onset_ns.tolist() == [3 * MILLISECOND]
    assert pulses.width.tolist() == [0.006]


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ([], 'expected rows of numbers below the header of .*trial.csv, got none'),
        (['0,0,1', '0,8,1'], 'expected rising times in column .Time .s.. of .*, got 0.0 and then'),
        (['0,0,1', 'nan,8,1'], 'expected finite numbers in column .Time .s.. .* got nan in row 2'),
        (['0,0,1', '1,inf,1'], 'expected finite numbers in column .STIM . .. .* got inf in row 2'),
        (['0,0,1', '1,0,1'], 'expected a gate that rises through 0, got levels 0 to 0'),
    ],
)
def test_bad_tables_are_refused(tmp_path, rows, message):
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join(['Time [s],STIM [ ],"fGM [N]"', *rows, '']))
    names = {'time': 'Time [s]', 'force': 'fGM [N]', 'pulse': 'STIM [ ]'}
    with pytest.raises(RecordingError, match=message):
        import_file(path, ImportOptions(**names, time_unit='s', force_unit='N'))


FORCE = 2.0 + np.sin(TIME * 30.0)
ONSETS = TIME[PLACES]


def of_matlab(path, content, **options):
    """A list of times of pulses beside a sampled force."""
    savemat(path, content)
    return import_file(path, ImportOptions(**options))


def expect_the_session(found, late_s=0.0):
    np.testing.assert_allclose(found.forces.force, FORCE)
    np.testing.assert_allclose(found.pulses.onset_ns, 1e9 * (ONSETS + late_s), atol=2.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ('content', 'unit'),
    [
        ({'stim_times': ONSETS}, 's'),
        ({'stim_times': ONSETS[:, None]}, 's'),
        ({'events': ONSETS}, 's'),
        ({'x': ONSETS}, 's'),
        ({'stim_times': 1e3 * ONSETS}, 'ms'),
        ({'trigger_ms': 1e3 * ONSETS}, 'ms'),
        ({'stim': 1e3 * ONSETS + 0.0}, 'ms'),
        ({'stim_times': 1e6 * ONSETS}, 'us'),
    ],
)
def test_a_short_rising_vector_is_a_list_of_times(tmp_path, content, unit):
    found = of_matlab(tmp_path / 'a.mat', {'force': FORCE, 'fs': 1000.0, **content})
    expect_the_session(found)
    name = next(iter(content))
    assert dict(found.facts)['pulses'].startswith(f"'{name}', {len(ONSETS)} times in {unit}, ")
    assert found.guessed


@pytest.mark.parametrize(
    ('name', 'rate'), [('stim_idx', 1000.0), ('stim_samples', 1000.0), ('stim', 4000.0)]
)
def test_numbers_of_samples_are_counted_from_1(tmp_path, name, rate):
    content = {'force': FORCE, 'fs': rate, name: PLACES + 1}
    found = of_matlab(tmp_path / 'a.mat', content)
    np.testing.assert_array_equal(found.pulses.onset_ns, found.forces.stamp_ns[PLACES])
    told = f'{len(PLACES)} numbers of samples, counted from 1, '
    assert told in dict(found.facts)['pulses']


def test_a_list_beside_a_column_of_times(tmp_path):
    content = {'force': FORCE, 'stim_times': ONSETS + 7.0}
    for scale, options in ((1.0, {}), (1.0, {'time': 'time'}), (1e3, {})):
        content['time'] = scale * (TIME + 7.0)
        expect_the_session(of_matlab(tmp_path / 'a.mat', content, **options), 7.0)
    content = {'force': FORCE, 'time': TIME, 'stim_idx': PLACES + 1}
    expect_the_session(of_matlab(tmp_path / 'a.mat', content))


def test_a_pulse_after_the_end_of_the_force_changes_no_unit(tmp_path):
    seconds = np.append(TIME[PLACES], 4.5)
    found = of_matlab(tmp_path / 'a.mat', {'t': TIME, 'force': FORCE, 'stim': seconds})
    assert found.pulses.onset_ns.tolist() == (1e9 * seconds).round().astype(int).tolist()


@pytest.mark.parametrize('late', [8, 30])
def test_a_list_that_goes_on_for_long_after_the_force_is_not_read_in_a_smaller_unit(
    tmp_path, late
):
    seconds = np.append(TIME[PLACES], 4.0 + 0.05 * np.arange(1, late))
    with pytest.raises(Ambiguous, match=r'in no unit: --pulse-unit decides'):
        of_matlab(tmp_path / 'a.mat', {'t': TIME, 'force': FORCE, 'stim': seconds})


@pytest.mark.parametrize('rate', [1024.0, 1050.0])
def test_numbers_of_samples_near_1_khz_are_not_taken_for_milliseconds(tmp_path, rate):
    numbers = np.arange(205, COUNT, 50)
    content = {'force': FORCE, 'fs': rate, 'stim_times': numbers}
    found = of_matlab(tmp_path / 'a.mat', content)
    np.testing.assert_array_equal(found.pulses.onset_ns, found.forces.stamp_ns[numbers - 1])


def test_the_unit_can_be_decided(tmp_path):
    content = {'force': FORCE, 'fs': 1000.0, 'stim': PLACES + 1}
    expect_the_session(of_matlab(tmp_path / 'a.mat', content, pulse_unit='samples'))
    expect_the_session(of_matlab(tmp_path / 'a.mat', content, pulse_unit='ms'), 1e-3)
    expect_the_session(of_matlab(tmp_path / 'a.mat', content, time_unit='ms'), 1e-3)
    # at another rate milliseconds and numbers of samples are far apart
    content['fs'] = 500.0
    with pytest.raises(Ambiguous, match=r"'stim' .* ms or samples: --pulse-unit decides"):
        of_matlab(tmp_path / 'a.mat', content)
    found = of_matlab(tmp_path / 'a.mat', content, pulse_unit='samples')
    np.testing.assert_array_equal(found.pulses.onset_ns, found.forces.stamp_ns[PLACES])


def test_a_list_in_an_unknown_unit_is_refused():
    hours = Signal('stim [h]', ONSETS / 3600, unit='h')
    with pytest.raises(Ambiguous, match=r"in s, .*, got 'stim \[h\]' in h: --pulse-unit decides"):
        list_unit(hours, TIME, None, None)
    assert list_unit(hours, TIME, 's', None)[0] == 's'
    assert list_unit(Signal('stim [MS]', 1e3 * ONSETS, unit='MS'), TIME, None, None)[0] == 'ms'


@pytest.mark.long
@pytest.mark.parametrize(
    ('content', 'options', 'message'),
    [
        (
            {'stim_times': ONSETS[::-1].copy()},
            {'pulse': 'stim_times'},
            r"got 'stim_times' with 60 values, 'force' with 4000",
        ),
        ({'stim': np.zeros(COUNT - 1)}, {}, r"got 'stim' with 3999 values, 'force' with 4000"),
        ({'time': TIME[1:], 'stim': FORCE}, {'time': 'time'}, r"got 'time' with 3999 values, "),
        ({'stim': FORCE}, {'pulse_unit': 's'}, r"expected rising times in column 'stim'"),
        ({'stim': PLACES}, {'pulse_unit': 'h'}, r'a unit of pulses of s, ms, us, min, samples'),
        (
            {'stim': ONSETS},
            {'pulse_unit': 'samples'},
            r"expected numbers of the force's 4000 samples in 'stim', got 0\.5",
        ),
    ],
)
def test_other_lengths_and_units_are_refused(tmp_path, content, options, message):
    with pytest.raises(RecordingError, match=message):
        of_matlab(tmp_path / 'a.mat', {'force': FORCE, 'fs': 1000.0, **content}, **options)


RATE = 20.0
# pulses come with samples, 500 ms after the beginning
STAMP_NS = np.arange(15_000, dtype=np.int64) * 1_000_000
PULSES = PulseTrain.regular(np.random.default_rng(5).uniform(size=290), RATE, 500_000_000)


def session(first, sign=1.0):
    """The session from a sample on."""
    muscle = Contraction(Subject())
    muscle.add_pulses(PULSES.onset_ns, PULSES.intensity)
    noise = 0.02 * np.random.default_rng(6).standard_normal(len(STAMP_NS))
    force = sign * muscle.force(STAMP_NS) + noise + 3.0
    pulses = PULSES[PULSES.onset_ns >= STAMP_NS[first]]
    return pulses, ForceTrace(STAMP_NS[first:], force[first:])


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(
    ('first', 'amid'), [(0, False), (480, False), (499, False), (5020, True), (8030, True)]
)
def test_a_beginning_amid_stimulation_is_seen(first, amid, sign):
    assert begins_amid(*session(first, sign)) is amid


def test_nothing_is_learnt_from_the_force_of_pulses_that_are_not_in_the_file(tmp_path):
    path, (pulses, forces) = tmp_path / 'late.csv', session(5020)
    up = np.isin(forces.stamp_ns, pulses.onset_ns)
    rows = np.column_stack((1e-9 * forces.stamp_ns, forces.force, up))
    np.savetxt(path, rows, delimiter=',', header='time,force,gate', comments='', fmt='%.6f')
    found = import_file(path, ImportOptions(time='time', force='force', pulse='gate'))
    assert found.pulses.sequence[0] == 1
    assert any('the force is not at rest there' in text for _, text in found.facts)
    # the intensities are not in the table
    known = PulseTrain(pulses.onset_ns, pulses.intensity, found.pulses.sequence, pulses.width)
    last = identify(estimator_by_name('recursive'), known, found.forces).last
    truth = Subject().steady_force(CURVE_INTENSITY, RATE)
    assert last.faults.keys() == {'samples_excluded'}
    assert np.abs(last.curve_force - truth).max() < 0.005 * truth.max()
    # as it is not without that (`batch` leaves them out by itself)
    from_0 = PulseTrain.numbered(known.onset_ns, known.intensity, known.width)
    worse = identify(estimator_by_name('recursive'), from_0, found.forces).last
    assert np.abs(worse.curve_force - truth).max() > 0.005 * truth.max()
