# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stream of Eq. (11) against the direct sum over all pulses."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import Contraction, Subject, average_subject, twitch
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, PulseTrain

MILLISECOND = 1_000_000

subjects = st.builds(
    Subject,
    time_constant=st.floats(5e-3, 0.1),
    latency=st.floats(0.0, 0.03),
    order=st.integers(1, 6),
    maximum_force=st.floats(1.0, 100.0),
)
onsets = st.lists(st.integers(0, 3 * NANOSECONDS_PER_SECOND), min_size=1, max_size=30, unique=True)
stamps = st.lists(st.integers(0, 4 * NANOSECONDS_PER_SECOND), min_size=1, max_size=30)


def intensities_of(onset_ns) -> FloatArray:
    """Return some intensity for each onset, the same one in every call."""
    return np.asarray(onset_ns % 1009 / 1009)


def superposition(subject, onset_ns, intensity, stamp_ns, rate_hz) -> FloatArray:
    """Return Eq. (11) as it stands: a sum of twitches over every pulse there has been."""
    rates = np.full(len(onset_ns), rate_hz)
    if rate_hz is None:
        interval = np.diff(onset_ns) / NANOSECONDS_PER_SECOND
        rates = np.concatenate(([0.0], 1.0 / np.maximum(interval, 1e-3)))
    weights = subject.pulse_weight(intensity, rates)
    latency_ns = round(subject.latency * NANOSECONDS_PER_SECOND)
    total = np.zeros(len(stamp_ns))
    for onset, weight in zip(onset_ns, weights, strict=True):
        lag = (stamp_ns - onset - latency_ns) / NANOSECONDS_PER_SECOND
        total += weight * twitch(lag, subject.time_constant, subject.order)
    return total


def regular_train(seconds, start_ns=0) -> PulseTrain:
    """Return pulses of varied intensity at 20 Hz."""
    generator = np.random.default_rng(3)
    return PulseTrain.regular(generator.uniform(size=round(20 * seconds)), 20.0, start_ns)


def grid(start_s, stop_s) -> IntArray:
    """Return stamps at 1 kHz."""
    return MILLISECOND * np.arange(round(1000 * start_s), round(1000 * stop_s), dtype=np.int64)


@given(subjects, onsets, stamps, st.sampled_from([None, 12.0, 20.0, 35.0]))
def test_force_is_the_sum_of_all_twitches(subject, onset, stamp, rate_hz):
    onset_ns = np.sort(np.array(onset))
    intensity = intensities_of(onset_ns)
    contraction = Contraction(subject, rate_hz)
    contraction.add_pulses(onset_ns, intensity)
    measured = contraction.force(stamp)
    expected = superposition(subject, onset_ns, intensity, np.array(stamp), rate_hz)
    # Every term is positive, so rounding is relative: 30 moves of a few ulp each, at most.
    np.testing.assert_allclose(measured, expected, rtol=1e-12, atol=1e-12)


@given(subjects, st.lists(st.integers(1, 2000), max_size=8))
def test_block_length_changes_no_bit(subject, cuts):
    train = regular_train(2.0)
    stamp_ns = grid(0.0, 2.0)
    whole = Contraction(subject, window=0.3)
    whole.add_pulses(train.onset_ns, train.intensity)
    expected = whole.force(stamp_ns)
    stream = Contraction(subject, window=0.3)
    stream.add_pulses(train.onset_ns, train.intensity)
    edges = [0, *sorted(cuts), len(stamp_ns)]
    pieces = [stream.force(stamp_ns[low:high]) for low, high in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(pieces), expected)


@given(onsets, st.lists(st.integers(0, 290 * MILLISECOND), min_size=30, max_size=30))
def test_pulses_that_arrive_late_change_no_bit(onset, delays):
    onset_ns = np.array(onset)
    arrival_ns = onset_ns + np.array(delays[: len(onset)])
    intensity = intensities_of(onset_ns)
    stream = Contraction(average_subject(), window=0.3)
    for now_ns in range(0, 3500 * MILLISECOND, 10 * MILLISECOND):
        arrived = (arrival_ns <= now_ns) & (arrival_ns > now_ns - 10 * MILLISECOND)
        stream.add_pulses(onset_ns[arrived], intensity[arrived])
        stream.force(now_ns)
    punctual = Contraction(average_subject(), window=0.3)
    punctual.add_pulses(onset_ns, intensity)
    stamp_ns = grid(3.5, 3.6)
    np.testing.assert_array_equal(stream.force(stamp_ns), punctual.force(stamp_ns))


def test_reading_before_the_first_pulse_does_not_close_the_past():
    stream = Contraction(average_subject())
    stream.force(grid(1.0, 1.001))
    onset_ns = np.array([960, 1010]) * MILLISECOND
    stream.add_pulses(onset_ns, [0.8, 0.9])
    expected = superposition(
        average_subject(), onset_ns, np.array([0.8, 0.9]), grid(0.95, 1.2), None
    )
    # As above; the second pulse has its rate of 20 Hz only if the first one is still known.
    np.testing.assert_allclose(stream.force(grid(0.95, 1.2)), expected, rtol=1e-12, atol=1e-12)


def test_a_pulse_from_before_the_window_acts_at_its_own_time():
    train = regular_train(3.0)
    late = np.array([512 * MILLISECOND + 77])
    stream = Contraction(average_subject(), fixed_rate_hz=20.0, window=0.5)
    stream.add_pulses(train.onset_ns, train.intensity)
    stream.force(grid(0.0, 1.2))
    stream.add_pulses(late, [0.9])
    onset_ns = np.concatenate((train.onset_ns, late))
    intensity = np.concatenate((train.intensity, [0.9]))
    stamp_ns = grid(1.2, 2.0)
    expected = superposition(average_subject(), onset_ns, intensity, stamp_ns, 20.0)
    # As above.
    np.testing.assert_allclose(stream.force(stamp_ns), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('rate_hz', [15.0, 20.0, 25.0, 35.0])
def test_a_long_train_reaches_the_steady_mean_force(rate_hz):
    subject = average_subject()
    train = PulseTrain.regular(np.full(200, 0.9), rate_hz)
    contraction = Contraction(subject)
    contraction.add_pulses(train.onset_ns, train.intensity)
    period_ns = NANOSECONDS_PER_SECOND / rate_hz
    start_ns = train.onset_ns[-1]
    # The last pulse acts after its latency: these are the 400 phases of the period before.
    phase = start_ns + np.rint(np.arange(400) / 400 * period_ns).astype(np.int64)
    mean = contraction.force(phase + round(subject.latency * 1e9)).mean()
    # The mean of a periodic smooth function over equal steps; the rounding to 1 ns remains.
    assert mean == pytest.approx(float(subject.steady_force(0.9, rate_hz)), rel=1e-6)


@pytest.mark.parametrize('intensity', [-0.01, 1.01, float('nan'), float('inf')])
def test_a_bad_intensity_adds_nothing(intensity):
    contraction = Contraction(average_subject())
    with pytest.raises(MuscleError, match='expected intensities from 0 to 1, got'):
        contraction.add_pulses([0, 1], [1.0, intensity])
    np.testing.assert_array_equal(contraction.force(50 * MILLISECOND), 0.0)


def test_force_cannot_be_read_from_before_the_window():
    contraction = Contraction(average_subject(), window=0.1)
    contraction.add_pulses([0, 50 * MILLISECOND], [1.0, 1.0])
    contraction.force(NANOSECONDS_PER_SECOND)
    with pytest.raises(MuscleError, match='expected times from 59450000 ns on, got 1 ns'):
        contraction.force([NANOSECONDS_PER_SECOND, 1])
