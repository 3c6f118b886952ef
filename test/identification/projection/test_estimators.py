# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Batch: right curve, independent of blocks; tracking keeps it in a rest."""

import numpy as np
import pytest

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED
from rpms_ros.muscle import Contraction, RecruitmentParameters, average_subject

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))
TRACKING = TrackingSettings(basis=SETTINGS.basis, choose_basis=False)


def test_noise_free_is_exact(record):
    take = record(12.0)
    estimator = BatchEstimator(SETTINGS)
    prediction = take.feed(estimator)
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    # Seven functions hold a twitch of T_a 38.44 ms to 1e-5; the rest is the weak prior.
    assert take.curve_error(estimate) < 1e-3
    late = slice(10_000, None)
    error = np.linalg.norm((take.force - prediction)[late]) / np.linalg.norm(take.force[late])
    assert error < 1e-3
    assert (estimate.nonlinear_identifiability == CONVERGED).all()
    np.testing.assert_allclose(estimate.nonlinear, [0.48, 0.98, 4.0, 6.0], rtol=1e-2)


def test_five_seconds_suffice_in_noise(record):
    take = record(5.0, noise=0.01, seed=1)
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    # One per cent of the maximum: the figure for the median of seeds
    assert take.curve_error(estimator.estimate(0, {})) < 0.01


@pytest.mark.parametrize('block', [1, 37, 999])
def test_block_length_changes_no_bit(block, record):
    take = record(2.5, noise=0.01)
    whole, parts = BatchEstimator(SETTINGS), BatchEstimator(SETTINGS)
    np.testing.assert_array_equal(take.feed(whole), take.feed(parts, block))
    left, right = whole.estimate(0, {}), parts.estimate(0, {})
    np.testing.assert_array_equal(left.nonlinear, right.nonlinear)
    np.testing.assert_array_equal(left.linear, right.linear)
    np.testing.assert_array_equal(left.curve_upper, right.curve_upper)


def test_scale_of_the_force_moves_the_linear_parameters_only(record):
    take = record(4.0, noise=0.01)
    small, large = BatchEstimator(SETTINGS), BatchEstimator(SETTINGS)
    take.feed(small)
    type(take)(take.onset_ns, take.intensity, take.stamp_ns, 1000 * take.force, take.curve).feed(
        large
    )
    left, right = small.estimate(0, {}), large.estimate(0, {})
    # Where the iteration ends may differ by its tolerance.
    np.testing.assert_allclose(left.nonlinear, right.nonlinear, rtol=1e-4)
    np.testing.assert_allclose(1000 * left.curve_force, right.curve_force, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize('start', [(0.2, 0.3, 1.0), (0.7, 1.2, 20.0), (0.68, 0.79, 2.0)])
def test_wide_starts_end_at_the_right_minimum(start, record):
    take = record(8.0, noise=0.01)
    settings = ProjectionSettings(basis=SETTINGS.basis, start=RecruitmentParameters(*start))
    estimator = BatchEstimator(settings)
    take.feed(estimator)
    assert take.curve_error(estimator.estimate(0, {})) < 0.01


def test_changing_rate_is_one_model():
    """The weight of a pulse follows its rate: 15, 20 and 30 Hz in one recording."""
    generator = np.random.default_rng(0)
    rate = np.repeat([15.0, 30.0, 20.0], 60)
    onset = np.cumsum(1e9 / rate).astype(np.int64)
    intensity = generator.uniform(0, 1, len(onset))
    muscle = average_subject()
    contraction = Contraction(muscle)
    contraction.add_pulses(onset, intensity)
    stamp = np.arange(9_000, dtype=np.int64) * 1_000_000
    force = contraction.force(stamp)
    errors = []
    for by_rate in (ProjectionSettings().by_rate, None):
        settings = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 9e-3), by_rate=by_rate)
        estimator = BatchEstimator(settings)
        estimator.add_pulses(onset, intensity)
        estimator.update(stamp, force, np.ones(len(stamp), dtype=bool))
        curve = muscle.steady_force(estimator.estimate(0, {}).curve_intensity, 20.0)
        curve -= curve[0]
        found = estimator.estimate(0, {}).curve_force
        errors.append(np.abs(found - curve).max() / curve.max())
    with_rate, without = errors
    assert with_rate < 2e-3
    assert without > 10 * with_rate


@pytest.mark.parametrize('silence', [50.0, 70.0, 150.0])
def test_a_rest_erases_nothing(record, silence):
    take = record(6.0, noise=0.005, silence=silence)
    estimator = TrackingEstimator(TRACKING)
    take.feed(estimator)
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    assert take.curve_error(estimate) < 0.01
    width = (estimate.curve_upper - estimate.curve_force).max() / take.curve.max()
    assert width < 0.05


def test_follows_a_clock_that_jumps_back(record):
    take = record(6.0, noise=0.005)
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    estimator.forget_pulses()
    again = record(4.0, noise=0.005, seed=8)
    again.feed(estimator)
    assert again.curve_error(estimator.estimate(0, {})) < 0.01
