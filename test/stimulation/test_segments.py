# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Segments: when their pulses come and how strong they are."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import (
    Constant,
    Doublet,
    MultilevelPRBS,
    Pause,
    PulseBurst,
    Ramp,
    Schedule,
    Single,
    Sinusoid,
    Staircase,
    UniformRandom,
)
from rpms_ros.stimulation.schedule.segments import maximal_sequence

RATES = st.floats(0.5, 200.0)
DURATIONS = st.floats(0.01, 20.0)


def intensities(segment):
    return Schedule((segment,)).plan.intensity


@given(rate=RATES, final=RATES, duration=DURATIONS)
def test_pulses_begin_at_zero_ascend_and_end_within_the_segment(rate, final, duration):
    onset = Constant(rate_hz=rate, duration_s=duration, final_rate_hz=final).onsets_ns()
    assert onset[0] == 0
    assert np.all(np.diff(onset) > 0)
    assert onset[-1] < round(duration * 1e9) or len(onset) == 1


@given(rate=RATES, final=RATES, duration=DURATIONS)
def test_sweep_fires_when_its_phase_is_whole(rate, final, duration):
    onset = Constant(rate_hz=rate, duration_s=duration, final_rate_hz=final).onsets_ns() / 1e9
    phase = rate * onset + (final - rate) * onset**2 / (2 * duration)
    # onsets are rounded to 1 ns: at 200 Hz that is 1e-7 of a period
    assert phase == pytest.approx(np.arange(len(onset)), abs=1e-6)


def test_ramp_meets_its_ends():
    values = intensities(Ramp(rate_hz=100.0, duration_s=1.0, start=0.2, end=0.7))
    assert values[0] == 0.2
    assert values[50] == pytest.approx(0.45, abs=1e-12)
    assert values[-1] == pytest.approx(0.7 - 0.5 / 100, abs=1e-12)


@pytest.mark.parametrize('rate', [3.0, 7.0, 20.0, 30.0])
def test_staircase_gives_every_level_as_often(rate):
    levels = (0.1, 0.5, 0.3)
    values = intensities(Staircase(rate_hz=rate, duration_s=9.0, levels=levels))
    assert np.array_equal(values, np.repeat(levels, round(3 * rate)))


def test_sinusoid_of_nine_seconds_starts_low_and_peaks_in_the_middle():
    values = intensities(Sinusoid(rate_hz=20.0, duration_s=9.0))
    assert values[0] == 0.0
    assert values[90] == 1.0
    assert np.argmax(values) == 90
    assert np.mean(values**2) == pytest.approx(3 / 8, abs=1e-12)


@given(low=st.floats(0.0, 1.0), high=st.floats(0.0, 1.0))
def test_random_intensities_stay_between_low_and_high(low, high):
    low, high = sorted((low, high))
    values = intensities(UniformRandom(rate_hz=20.0, duration_s=5.0, low=low, high=high))
    assert values.min() >= low
    assert values.max() <= high


def test_own_seed_wins_over_the_schedule():
    fixed = UniformRandom(rate_hz=20.0, duration_s=1.0, seed=5)
    free = UniformRandom(rate_hz=20.0, duration_s=1.0)

    def drawn(segment, seed):
        return Schedule((segment,), seed=seed).plan.intensity

    assert np.array_equal(drawn(fixed, 1), drawn(fixed, 2))
    assert not np.array_equal(drawn(free, 1), drawn(free, 2))
    assert np.array_equal(drawn(free, 1), drawn(free, 1))


@pytest.mark.parametrize('symbols', [2, 3, 5, 7])
@pytest.mark.parametrize('order', [1, 2, 3, 4])
def test_maximal_sequence_visits_every_level_alike(symbols, order):
    sequence = maximal_sequence(symbols, order)
    counts = Counter(sequence)
    each = symbols ** (order - 1)
    assert len(sequence) == symbols**order - 1
    assert counts[0] == each - 1
    assert all(counts[symbol] == each for symbol in range(1, symbols))


def test_multilevel_holds_its_levels():
    segment = MultilevelPRBS(
        rate_hz=20.0, duration_s=31.0, low=0.2, high=1.0, hold_pulses=5, level_count=5
    )
    blocks = intensities(segment).reshape(124, 5)
    assert np.all(blocks == blocks[:, :1])
    assert np.allclose(np.unique(blocks), [0.2, 0.4, 0.6, 0.8, 1.0], atol=1e-12)


def test_volleys():
    assert Single(intensity=0.3).onsets_ns().tolist() == [0]
    assert Doublet(interval_s=0.005).onsets_ns().tolist() == [0, 5_000_000]
    assert PulseBurst(count=4, interval_s=0.02).onsets_ns().tolist() == [
        0, 20_000_000, 40_000_000, 60_000_000,
    ]  # fmt: skip
    assert intensities(PulseBurst(count=4, intensity=0.3)).tolist() == [0.3] * 4


@pytest.mark.parametrize(
    ('build', 'fault'),
    [
        (
            lambda: Constant(rate_hz=0.0, duration_s=1.0),
            r'rate_hz: expected .*\[0\.001, 1000\].* 0',
        ),
        (lambda: Constant(rate_hz=20.0, duration_s=-1.0), r'duration_s: expected .* got -1'),
        (lambda: Constant(20.0, 1.0, intensity=1.01), r'intensity: expected .* got 1.01'),
        (lambda: Staircase(20.0, 1.0, levels=()), r'levels: expected a list, each .* got \(\)'),
        (lambda: Sinusoid(20.0, 1.0, low=0.5, high=0.2), r'expected low <= high, got 0.5 and'),
        (
            lambda: MultilevelPRBS(20.0, 1.0, low=0.5, high=0.2),
            r'expected low <= high, got 0.5 and',
        ),
        (lambda: MultilevelPRBS(20.0, 1.0, level_count=6), r'level_count of 2, 3, 5 or 7, got 6'),
        (lambda: Doublet(count=3), r'count: expected a whole number in \[2, 2\], got 3'),
        (lambda: PulseBurst(count=1.5), r'count: expected a whole number .* got 1.5'),
        (lambda: PulseBurst(count=5, interval_s=0.25), r'expected a duration above 1 s, .* got 1'),
        (lambda: Pause(True), r'duration_s: expected a number .* got True'),
    ],
)
def test_impossible_segments_are_refused(build, fault):
    with pytest.raises(StimulationError, match=fault):
        build()
