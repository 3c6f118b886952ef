# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that the documentation states about the muscle, computed."""

import math

import numpy as np
import pytest

from rpms_ros.muscle import (
    RateRecruitment,
    random_subject,
    steady_mean,
    summed_twitches,
    twitch,
    twitch_area,
)

T_A = 38.44e-3
T_S = 1e-3


def test_sum_of_a_twitch():
    total = twitch(T_S * np.arange(1001), T_A).sum()
    # Three decimals, as stated.
    assert total == pytest.approx(142.018, abs=5e-4)
    assert twitch_area(T_A) / T_S == pytest.approx(142.018, abs=5e-4)
    assert T_A * math.e**2 / (2 * T_S) == pytest.approx(142.018, abs=5e-4)


def test_mean_of_the_summed_response_at_20_hz():
    # Four decimals, as stated.
    assert steady_mean(20.0, T_A) == pytest.approx(2.8404, abs=5e-5)
    last_period = summed_twitches(2.0 + 0.05 * np.arange(50) / 50, 20.0, T_A)
    assert last_period.mean() == pytest.approx(2.8404, abs=5e-5)


def test_the_extrapolated_weight_of_a_slow_pulse_is_spoiled_by_rounding():
    rate = RateRecruitment()
    raw = [float(rate(value) / value) for value in (1.0, 0.01, 0.001)]
    # In thousandths of a second: at 15 Hz it is 52.3, below it is lost, then negative.
    np.testing.assert_allclose(1e3 * np.array(raw), [55.55, 11.57, -389.61], atol=0.005)
    kept = rate.per_pulse([1.0, 0.01, 0.001])
    np.testing.assert_allclose(1e3 * kept, 52.33, atol=0.005)


def test_weights_of_the_first_pulse_of_a_train_and_of_a_doublet():
    rate = RateRecruitment()
    assert rate.per_pulse(0.0) / rate.per_pulse(20.0) == pytest.approx(1.048, abs=5e-4)
    # The share of a lone pulse's weight that a second one has a millisecond later.
    assert rate.per_pulse(1000.0) / rate.per_pulse(0.0) == pytest.approx(0.0297, abs=5e-5)


def test_share_of_random_shapes_that_are_drawn_again():
    class Counting:
        """A generator that counts its uniform draws."""

        def __init__(self, seed: int) -> None:
            self.draws = 0
            self._generator = np.random.default_rng(seed)

        def uniform(self, low: float, high: float) -> float:
            self.draws += 1
            return float(self._generator.uniform(low, high))

    generators = [Counting(seed) for seed in range(1000)]
    for generator in generators:
        random_subject(generator)  # type: ignore[arg-type]
    shapes = sum((generator.draws - 3) // 4 for generator in generators)
    # Five standard deviations of a share near 0.1 out of 1000.
    assert 1.0 - 1000 / shapes == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / 1000))
