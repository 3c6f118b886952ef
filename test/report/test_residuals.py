# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Residual analysis: laws of the correlations, and what white and coloured noise must give."""

import numpy as np
import pytest

from rpms_ros.errors import ReportError
from rpms_ros.pulses import PulseTrain
from rpms_ros.report.residuals import (
    analyse_residuals,
    ljung_box,
    stimulation_at,
)

SAMPLES = 6000
STAMPS = np.arange(SAMPLES, dtype=np.int64) * 1_000_000
PULSES = PulseTrain.regular(np.random.default_rng(3).uniform(0.0, 1.0, 120), 20.0)


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(SAMPLES)


def test_white_residuals_look_white_as_often_as_the_band_says() -> None:
    found = [analyse_residuals(STAMPS, noise(seed), PULSES) for seed in range(40)]
    # 5 % of 400 lags in 40 runs: its standard deviation is 0.2 %, the tolerance is five of them
    outside = np.mean([one.autocorrelation_outside for one in found])
    assert outside == pytest.approx(0.05, abs=0.01)
    outside = np.mean([one.cross_correlation_outside for one in found])
    assert outside == pytest.approx(0.05, abs=0.01)
    # p is uniform: fewer than 12 of 40 below 0.1 but for one case in ten thousand
    assert sum(one.ljung_box_p < 0.1 for one in found) < 12


def test_a_coloured_residual_is_found() -> None:
    coloured = np.convolve(noise(1), [1.0, 0.5], mode='same')
    found = analyse_residuals(STAMPS, coloured, PULSES)
    assert found.ljung_box_p < 1e-12
    # r(1) of that filter is 0.5 / 1.25; its deviation over 6000 samples is 0.01
    assert found.autocorrelation[1] == pytest.approx(0.4, abs=0.05)


def test_muscle_that_the_model_lacks_shows_after_its_delay() -> None:
    echo = np.zeros(SAMPLES)
    index = np.searchsorted(STAMPS, PULSES.onset_ns) + 40
    inside = index < SAMPLES
    echo[index[inside]] = PULSES.intensity[inside] - 0.5
    found = analyse_residuals(STAMPS, 0.02 * noise(4) + echo, PULSES)
    peak = int(np.argmax(found.cross_correlation))
    assert found.cross_lag_s[peak] == pytest.approx(0.04)
    assert found.cross_correlation[peak] > 3 * found.cross_correlation_band


def test_ljung_box_is_the_published_sum() -> None:
    # Q = 100 * 102 * (0.04 / 99 + 0.01 / 98); for two degrees of freedom p = exp(-Q / 2)
    statistic, p_value = ljung_box(np.array([0.2, 0.1]), 100)
    assert statistic == pytest.approx(100 * 102 * (0.04 / 99 + 0.01 / 98))
    assert p_value == pytest.approx(np.exp(-statistic / 2))


def test_a_pulse_counts_for_the_first_sample_that_it_can_act_on() -> None:
    train = PulseTrain(
        np.array([-1, 0, 1, 2_000_000, 9_000_000_000]),
        np.array([0.1, 0.2, 0.3, np.nan, 0.5]),
        np.arange(5),
        np.full(5, 1e-4),
    )
    assert stimulation_at(STAMPS, train)[:4].tolist() == [0.2, 0.3, 0.0, 0.0]


@pytest.mark.parametrize(
    ('stamps', 'residual', 'expected'),
    [
        (STAMPS[:49], noise(0)[:49], 'at least 50 residuals, got 49'),
        (STAMPS, np.zeros(SAMPLES), 'residuals that differ, got 0.0 only'),
        (STAMPS[::-1], noise(0), 'ascending stamps, got a clock that jumped'),
    ],
)
def test_residuals_that_tell_nothing_are_refused(
    stamps: np.ndarray, residual: np.ndarray, expected: str
) -> None:
    with pytest.raises(ReportError, match=expected):
        analyse_residuals(stamps, residual, PULSES)
