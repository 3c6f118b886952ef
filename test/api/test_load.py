# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is loaded is what was recorded, and can be written again."""

from pathlib import Path

import numpy as np
import pytest

import rpms_ros
from rpms_ros import RpmsError
from rpms_ros.recording import session_hash

SAMPLE = Path(__file__).resolve().parents[2] / 'bags' / 'sample'
COLUMNS = {'time': 't', 'force': 'F', 'pulse': 'gate'}


def table(path):
    rows = [f'{i / 1000},{0.5 * i},{int(i % 50 < 2)}' for i in range(200)]
    (path / 'trial.csv').write_text('\n'.join(('t,F,gate', *rows)) + '\n')
    return path / 'trial.csv'


def test_info_says_what_the_session_holds():
    session = rpms_ros.load(str(SAMPLE))
    assert 'samples: 30000\n' in session._repr_html_()
    info = session.info()
    assert info['path'] == str(SAMPLE)
    numbers = ('samples', 'pulses', 'force_rate_hz', 'pulse_rate_hz')
    assert [info[name] for name in numbers] == [30_000, 600, 1000.0, 20.0]
    assert (info['faults'], info['remarks']) == ({}, [])


def test_a_table_becomes_a_session_of_columns_that_are_named_or_guessed(tmp_path):
    session = rpms_ros.load(table(tmp_path), **COLUMNS, intensity=0.8, sign=-1)
    assert session.info()['storage'] == 'table'
    # the gate is up from the first row on: the first pulse is not known, nor what it acts on
    assert session.pulses.intensity.tolist() == [0.8] * len(session.pulses)
    assert session.force.force.tolist() == [-0.5 * i for i in range(50, 200)]
    session = rpms_ros.load(table(tmp_path))
    named = rpms_ros.load(table(tmp_path), **COLUMNS)
    assert session_hash(session.recording) == session_hash(named.recording)
    told = dict(session.imported)
    assert told['time'] == "'t' in s, for 1000 samples a second then (time_unit= decides)"
    assert "pulses: 'gate'" in session.info()['imported']


def test_a_session_is_written_and_read_again(simulated, tmp_path):
    simulated.save(tmp_path / 'kept', compression='zstd')
    again = rpms_ros.load(tmp_path / 'kept')
    assert session_hash(again.recording) == session_hash(simulated.recording)
    assert {finding.state for finding in again.verify()} == {'ok', 'unknown'}
    with pytest.raises(RpmsError, match='expected'):
        simulated.save(tmp_path / 'kept')


def test_what_is_not_on_the_disk_cannot_be_verified(simulated):
    for session in (simulated, rpms_ros.load(SAMPLE).between(0.0, 1.0)):
        with pytest.raises(RpmsError, match=r'expected a session that was loaded.*save\(\)'):
            session.verify()


def test_a_part_has_the_samples_and_pulses_of_its_time(simulated):
    part = simulated.between(2.0, 5.0)
    assert len(part.force) == 3001
    assert len(part.pulses) == 61
    assert part.duration == pytest.approx(3.0, abs=1e-9)
    before = part.recording.samples_before_pulse
    stamps = part.force.stamp_ns
    np.testing.assert_array_equal(before, np.searchsorted(stamps, part.pulses.onset_ns))
    assert part.subject is simulated.subject


def test_what_cannot_be_guessed_names_the_keyword(tmp_path):
    path = tmp_path / 'trial.csv'
    rows = (f'{k};1;2;{5 * (k % 9 == 5)}' for k in range(40))
    path.write_text('\n'.join(['t;a [N];b [N];gate', *rows]))
    with pytest.raises(RpmsError, match=r"got 'a \[N\]', 'b \[N\]': force= decides"):
        rpms_ros.load(path)
    assert set(rpms_ros.load(path, force='b [N]').force.force) == {2.0}
    assert set(rpms_ros.load(path, force='b [N]', force_scale=-3.0).force.force) == {-6.0}
    assert rpms_ros.load(path, force='a [N]', time_unit='s').duration == 39.0


@pytest.mark.parametrize(
    ('path', 'change', 'message'),
    [
        ('nowhere', {}, 'expected .*nowhere'),
        (SAMPLE, {'sign': 2}, 'expected sign 1 or -1, got 2'),
        (SAMPLE, {'axis': 'w'}, 'expected .*axis.*w'),
        (SAMPLE, {'axis': 5}, 'expected axis x, y, z.* got 5'),
        (SAMPLE, {'sheet': 'a'}, 'expected sheet with a table or another file'),
        (SAMPLE, {'force_topic': 'torque'}, 'expected .*torque'),
        (None, {'axis': '-z'}, 'expected axis with a recording'),
        (None, {'force_topic': 'torque'}, 'expected force_topic with a recording'),
        (None, {'sign': 0}, 'expected sign 1 or -1, got 0'),
        (None, {'time_unit': 'hours'}, "a unit of time of s, ms, us, min, got 'hours'"),
        (None, {'force_unit': 'oz'}, "expected a unit of force of N, .*, got 'oz'"),
        (None, {'force': 'x'}, "expected column 'x'"),
        (None, {'sampling_rate': -1.0}, 'finite sampling rate above 0 Hz, got -1.0'),
        (None, {'sampling_rate': 0.0}, 'finite sampling rate above 0 Hz, got 0.0'),
        (None, {'force_scale': 0.0}, 'finite force_scale that is not 0, got 0.0'),
        (None, {'intensity': 1.5}, 'intensity from 0 to 1'),
    ],
)
def test_a_wrong_option_of_a_recording_or_a_file_is_named(tmp_path, path, change, message):
    with pytest.raises(RpmsError, match=message):
        rpms_ros.load(path or table(tmp_path), **change)


@pytest.mark.parametrize(
    ('start', 'end', 'message'),
    [
        (5.0, 5.0, 'expected a start before the end, got 5.0 s and 5.0 s'),
        (float('nan'), 1.0, 'expected a start before the end'),
        ('1', 2.0, "expected a time in s, got '1'"),
        (20.0, 30.0, r'expected force between 20.0 s and 30.0 s, got 14.999 s of it'),
    ],
)
def test_a_part_without_samples_is_refused(simulated, start, end, message):
    with pytest.raises(RpmsError, match=message):
        simulated.between(start, end)


def test_arrays_become_a_session(simulated):
    pulses, begin = simulated.pulses, simulated.force.stamp_ns[0]
    time = 1e-9 * (simulated.force.stamp_ns - begin)
    onset = 1e-9 * (pulses.onset_ns - begin)
    session = rpms_ros.from_arrays(
        time, simulated.force.force, onset, pulses.intensity, name='leg'
    )
    assert session.name == 'leg'
    np.testing.assert_array_equal(session.pulses.onset_ns, pulses.onset_ns - begin)
    np.testing.assert_array_equal(session.force.stamp_ns, simulated.force.stamp_ns - begin)
    assert set(rpms_ros.from_arrays(time, time, [1.0, 2.0]).pulses.intensity) == {1.0}
    # what a program has masked is missing
    seen = np.ma.masked_greater(time, time[1])
    assert np.isfinite(rpms_ros.from_arrays(time, seen, [1.0, 2.0]).force.force).sum() == 2


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'force': [1.0]}, r'expected a force for each of 3 times, got \(1,\)'),
        ({'force': ['1', '2', 'x']}, r'expected numbers, got others: .* .x.'),
        ({'time': np.arange(3).astype('m8[ms]')}, r'expected numbers, .*\[ms\], times are in s'),
        ({'time': [0.0, 0.0, 1.0]}, r'expected rising time, got 0\.0 and then 0\.0'),
        ({'time': [0.0, np.nan, 1.0]}, r'expected finite times in s in time, got'),
        ({'pulse_times': [500.0, 1000.0]}, r'those of the force, 0 to 2 s, got 500 to 1000'),
        ({'pulse_times': []}, r'expected finite times in s in pulse_times, got'),
        ({'intensity': [0.5]}, r'expected an intensity for each of 2 pulses, or one, got \(1,\)'),
        ({'intensity': 80.0}, r'expected intensities from 0 to 1, got 80\.0'),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, message):
    given = {'time': [0.0, 1.0, 2.0], 'force': [0.0, 1.0, 2.0], 'pulse_times': [0.5, 1.0]}
    with pytest.raises(RpmsError, match=message):
        rpms_ros.from_arrays(**{**given, **change})
