# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables 1 to 6 as far as the package holds them, and numbers that the documentation states."""

import math
from unittest.mock import Mock

import numpy as np
import pytest

from rpms_ros.identification import TABLE_4, TABLE_5
from rpms_ros.muscle import (
    IntensityRecruitment,
    Modality,
    RateRecruitment,
    RecruitmentParameters,
    average_subject,
    identified_recruitment,
    random_subject,
    steady_mean,
    summed_twitches,
    twitch,
    twitch_area,
)

MANY = 400
# Of 400 uniform draws the extremes come this close to the ends of the range, in parts of it:
# the chance of missing a strip of 2 % at one end is 0.98^400 = 3e-4, and the seeds are fixed.
STRIP = 0.02

TABLE_6 = [
    (0.657, 0.855, 13.9),
    (0.647, 0.869, 13.7),
    (0.647, 0.875, 16.2),
    (0.688, 0.875, 10.7),
    (0.637, 0.817, 8.7),
    (0.662, 0.874, 3.8),
    (0.672, 0.839, 10.4),
    (0.648, 0.931, 13.2),
]


def assert_fills(values, low, high):
    """Values lie within a range and use all of it."""
    strip = STRIP * (high - low)
    assert low <= min(values) <= low + strip
    assert high - strip <= max(values) <= high


@pytest.mark.parametrize(
    ('name', 'modality', 'low', 'high', 'mean'),
    [
        ('latency', Modality.ELECTRICAL, 20.83, 28.24, 24.4),
        ('latency', Modality.MAGNETIC, 6.28, 14.63, 9.45),
        ('time_constant', Modality.ELECTRICAL, 22.58, 53.22, 36.62),
        ('time_constant', Modality.MAGNETIC, 26.71, 49.81, 38.44),
    ],
)
def test_tables_1_and_2_latency_and_time_constant(name, modality, low, high, mean):
    # Milliseconds to seconds rounds.
    assert getattr(average_subject(modality), name) == pytest.approx(1e-3 * mean, rel=1e-15)
    drawn = [random_subject(np.random.default_rng(seed), modality) for seed in range(MANY)]
    assert_fills([1e3 * getattr(subject, name) for subject in drawn], low, high)


@pytest.mark.parametrize(
    ('settings', 'forgetting', 'form_factor'), [(TABLE_4, 0.99, 120.0), (TABLE_5, 0.999, 45.0)]
)
def test_tables_4_and_5(settings, forgetting, form_factor):
    assert settings.damping == 0.001
    assert settings.hessian_scale == 0.0001
    assert settings.forgetting == forgetting
    assert settings.damping_factor == 1.002
    assert settings.gain_ratio_margin == 0.02
    assert settings.condition_limit == 1000.0
    assert settings.damping_increment == 0.01
    assert settings.basis.form_factor == form_factor
    assert settings.basis.memory_taps == 350
    assert settings.basis.functions == 8
    assert settings.basis.tap == 1e-3


def test_one_row_of_table_6_dips_below_zero():
    intensity = np.linspace(0.0, 1.0, 1001)
    depths = []
    for row in TABLE_6:
        curve = identified_recruitment(RecruitmentParameters(*row), intensity)
        depths.append(float(curve.min() / curve[-1]))
        assert IntensityRecruitment(row[0], row[1], 6.0, row[2]).rises == (depths[-1] == 0.0)
    assert [index for index, depth in enumerate(depths) if depth < 0.0] == [5]
    # Two digits, as docs/model.md has it.
    assert depths[5] == pytest.approx(-0.0032, abs=5e-5)


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
    generators = [Mock(wraps=np.random.default_rng(seed)) for seed in range(1000)]
    for generator in generators:
        random_subject(generator)
    # four numbers a shape, and three of the subject
    shapes = sum((generator.uniform.call_count - 3) // 4 for generator in generators)
    # Five standard deviations of a share near 0.1 out of 1000.
    assert 1.0 - 1000 / shapes == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / 1000))
