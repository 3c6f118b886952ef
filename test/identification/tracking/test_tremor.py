# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A tremor is found, followed and subtracted; noise that a sensor filters is said."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.estimation.tremor import Tremor, line_in
from rpms_ros.identification.quality.doubts import RESIDUALS_ALIKE
from rpms_ros.pulses import ForceTrace, PulseTrain

pytestmark = pytest.mark.long

SECOND = 1_000_000_000
RATES = np.array([20.0])


def samples(seconds, rate=1000):
    return np.arange(int(seconds * rate), dtype=np.int64) * (SECOND // rate)


def wave(stamp_ns, hertz=8.0, amplitude=0.3):
    return amplitude * np.sin(2.0 * np.pi * hertz * 1e-9 * stamp_ns + 0.7)


def followed(tremor, stamp_ns, error, rates=RATES):
    """Return how often a tremor has appeared, looking every quarter of a second."""
    appeared = 0
    for first in range(0, len(stamp_ns), 250):
        part = slice(first, first + 250)
        tremor.add(stamp_ns[part], error[part], 0.0 * error[part], usable(error[part]))
        appeared += tremor.follow(rates)
    return appeared


def usable(error):
    return np.ones(len(error), dtype=bool)


def noise(count, deviation=0.05):
    return deviation * np.random.default_rng(5).standard_normal(count)


@pytest.mark.parametrize('hertz', [4.1, 6.0, 8.0, 11.37])
def test_a_tremor_is_found_and_predicted(hertz):
    stamp_ns = samples(8.0)
    tremor = Tremor()
    assert followed(tremor, stamp_ns, wave(stamp_ns, hertz) + noise(len(stamp_ns))) == 1
    # a line of 16 dB over four seconds is known to some hundredths of a hertz
    assert tremor.frequency == pytest.approx(hertz, abs=0.05)
    assert tremor.amplitude == pytest.approx(0.3, rel=0.05)
    coming = stamp_ns[-1] + samples(0.25)
    # of the next quarter of a second a twentieth is left, and a tenth with the frequency's error
    assert np.abs(tremor.force(coming) - wave(coming, hertz)).max() < 0.1 * 0.3


@pytest.mark.parametrize('kind', ['noise', 'drift', 'effort', 'step'])
def test_what_is_no_tremor_is_left_alone(kind):
    stamp_ns = samples(20.0)
    time = 1e-9 * stamp_ns
    error = noise(len(stamp_ns))
    error += {
        'noise': 0.0 * time,
        'drift': 0.5 * time,
        'effort': 2.0 * np.where(time % 6.0 < 1.5, np.sin(np.pi * (time % 6.0) / 1.5) ** 2, 0.0),
        'step': 5.0 * (time > 10.0),
    }[kind]
    tremor = Tremor()
    assert followed(tremor, stamp_ns, error) == 0
    assert not tremor.force(stamp_ns).any()


@pytest.mark.parametrize('hertz', [8.0, 4.0])
def test_the_lines_of_the_pulses_are_the_muscles(hertz):
    stamp_ns = samples(8.0)
    tremor = Tremor()
    assert followed(tremor, stamp_ns, wave(stamp_ns), np.array([hertz])) == 0
    assert followed(Tremor(), stamp_ns, wave(stamp_ns), np.array([6.5])) == 1


def test_a_tremor_ends():
    stamp_ns = samples(20.0)
    error = noise(len(stamp_ns)) + np.where(stamp_ns < 10 * SECOND, wave(stamp_ns), 0.0)
    tremor = Tremor()
    followed(tremor, stamp_ns, error)
    assert tremor.frequency == 0.0
    assert tremor.amplitude == 0.0


def test_a_gap_and_samples_that_are_not_usable():
    stamp_ns = samples(8.0)
    tremor = Tremor()
    followed(tremor, stamp_ns, wave(stamp_ns))
    assert tremor.frequency > 0.0
    later = stamp_ns + 3600 * SECOND
    error = np.full(len(later), np.nan)
    tremor.add(later, error, error, ~usable(later))
    assert tremor.frequency > 0.0
    tremor.add(later[:10], wave(later[:10]), np.zeros(10), usable(later[:10]))
    # after an hour the phase of the old one says nothing
    assert not tremor.follow(RATES)
    assert not tremor.force(later).any()


def test_the_cut_does_not_matter():
    stamp_ns = samples(6.0)
    error = wave(stamp_ns) + noise(len(stamp_ns))
    one, other = Tremor(), Tremor()
    muscle, every = 0.1 * error, usable(error)
    one.add(stamp_ns, error, muscle, every)
    for part in np.split(np.arange(len(stamp_ns)), [1, 7, 1234, 4321]):
        other.add(stamp_ns[part], error[part], muscle[part], every[part])
    assert one.follow(RATES)
    assert other.follow(RATES)
    assert one.force(stamp_ns).tobytes() == other.force(stamp_ns).tobytes()


def test_a_wild_prediction_of_the_muscle_does_not_hide_it():
    stamp_ns = samples(6.0)
    force = wave(stamp_ns) + noise(len(stamp_ns))
    wild = 20.0 * np.sin(2.0 * np.pi * 5.3 * 1e-9 * stamp_ns) ** 3
    tremor = Tremor()
    tremor.add(stamp_ns, force, wild, usable(force))
    assert tremor.follow(RATES)
    assert tremor.frequency == pytest.approx(8.0, abs=0.05)


def test_a_line_that_is_rejected_is_looked_for_again_after_a_second():
    stamp_ns = samples(8.0)
    force = wave(stamp_ns) + noise(len(stamp_ns))
    tremor = Tremor()
    found = []
    for first in range(0, len(stamp_ns), 250):
        part = slice(first, first + 250)
        tremor.add(stamp_ns[part], force[part], np.zeros(250), usable(force[part]))
        if tremor.follow(RATES):
            found.append(first)
            tremor.reject()
            assert not tremor.force(stamp_ns).any()
    assert len(found) > 1
    assert (np.diff(found) == 1000).all()


def test_a_line_found_elsewhere_is_followed_at_once():
    stamp_ns = samples(4.0)
    muscle = 5.0 * np.sin(2.0 * np.pi * 1.3 * 1e-9 * stamp_ns) ** 2
    rest = wave(stamp_ns) + noise(len(stamp_ns))
    hertz = line_in(stamp_ns, rest, RATES)
    # two lines of four seconds are a quarter of a hertz apart
    assert hertz == pytest.approx(8.0, abs=0.05)
    tremor = Tremor()
    tremor.accept(hertz, stamp_ns, muscle + rest, rest)
    coming = stamp_ns[-1] + samples(0.1)
    assert np.abs(tremor.force(coming) - wave(coming)).max() < 0.1 * 0.3
    assert line_in(stamp_ns, noise(len(stamp_ns)), RATES) == 0.0
    assert line_in(stamp_ns[:1000], rest[:1000], RATES) == 0.0
    assert line_in(stamp_ns[:0], rest[:0], RATES) == 0.0


def last(what, force):
    """Return the last estimate of `tracking`."""
    pulses = PulseTrain.regular(what.intensity, 20.0, 1_000)
    forces = ForceTrace(what.stamp_ns, force)
    return identify(
        estimator_by_name('tracking'), pulses, forces, StreamSettings(estimate_period=5.0)
    ).last


def test_noise_that_the_sensor_filters_is_held_in_the_band(living_sessions):
    what = living_sessions.session('steady', 'random', 1, 18.0)
    estimate = last(what, lfilter(*butter(2, 20.0, fs=1000.0), what.force))
    assert RESIDUALS_ALIKE not in estimate.doubts
    away = abs(estimate.curve_force - what.curve[-1])
    assert away.max() < 0.005 * what.curve[-1].max()
    assert (away < estimate.curve_upper - estimate.curve_force).mean() > 0.9


def test_noise_of_an_ordinary_sensor_is_not_doubted(living_sessions):
    what = living_sessions.session('bursts', 'random', 1, 18.0)
    assert RESIDUALS_ALIKE not in last(what, what.force).doubts
