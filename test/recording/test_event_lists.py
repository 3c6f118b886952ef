# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Lists of times of pulses beside a sampled force, as in MATLAB files."""

import numpy as np
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import Ambiguous, ImportOptions, import_file

COUNT = 4000
TIME = np.arange(COUNT) / 1000.0
FORCE = 2.0 + np.sin(TIME * 30.0)
PLACES = np.arange(500, 3500, 50)
ONSETS = TIME[PLACES]


def imported(path, content, **options):
    savemat(path, content)
    return import_file(path, ImportOptions(**options))


def told(found):
    return dict(found.facts)['pulses']


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
    found = imported(tmp_path / 'a.mat', {'force': FORCE, 'fs': 1000.0, **content})
    expect_the_session(found)
    name = next(iter(content))
    assert told(found).startswith(f"'{name}', {len(ONSETS)} times in {unit}, ")
    assert found.guessed


@pytest.mark.parametrize(('name', 'first'), [('stim_idx', 1), ('stim_samples', 1), ('stim', 1)])
def test_numbers_of_samples_are_counted_from_1(tmp_path, name, first):
    rate = 1000.0 if name != 'stim' else 4000.0
    content = {'force': FORCE, 'fs': rate, name: PLACES + first}
    found = imported(tmp_path / 'a.mat', content)
    np.testing.assert_array_equal(found.pulses.onset_ns, found.forces.stamp_ns[PLACES])
    assert f'{len(PLACES)} numbers of samples, counted from 1, ' in told(found)


def test_a_list_beside_a_column_of_times(tmp_path):
    content = {'force': FORCE, 'stim_times': ONSETS + 7.0, 'time': TIME + 7.0}
    expect_the_session(imported(tmp_path / 'a.mat', content), 7.0)
    expect_the_session(imported(tmp_path / 'a.mat', content, time='time'), 7.0)
    content['time'] = 1e3 * content['time']
    expect_the_session(imported(tmp_path / 'a.mat', content), 7.0)
    content = {'force': FORCE, 'time': TIME, 'stim_idx': PLACES + 1}
    expect_the_session(imported(tmp_path / 'a.mat', content))


def test_the_unit_can_be_decided(tmp_path):
    content = {'force': FORCE, 'fs': 1000.0, 'stim': PLACES + 1}
    expect_the_session(imported(tmp_path / 'a.mat', content, pulse_unit='samples'))
    expect_the_session(imported(tmp_path / 'a.mat', content, pulse_unit='ms'), 1e-3)
    expect_the_session(imported(tmp_path / 'a.mat', content, time_unit='ms'), 1e-3)
    # at another rate milliseconds and numbers of samples are far apart
    content['fs'] = 500.0
    with pytest.raises(Ambiguous, match=r"'stim' .* ms or samples: --pulse-unit decides"):
        imported(tmp_path / 'a.mat', content)
    found = imported(tmp_path / 'a.mat', content, pulse_unit='samples')
    np.testing.assert_array_equal(found.pulses.onset_ns, found.forces.stamp_ns[PLACES])


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
        imported(tmp_path / 'a.mat', {'force': FORCE, 'fs': 1000.0, **content}, **options)
