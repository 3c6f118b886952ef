# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings with little or no information: finite numbers, right flags, no exception."""

import dataclasses

import numpy as np

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED, NOT_INFORMED

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))


def outcome(take):
    """Return the estimate after a recording, every number of it finite."""
    estimator = BatchEstimator(SETTINGS)
    prediction = take.feed(estimator, 500)
    assert np.isfinite(prediction).all()
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    for field in dataclasses.fields(estimate):
        value = getattr(estimate, field.name)
        if isinstance(value, np.ndarray | float):
            assert np.isfinite(value).all(), field.name
    return estimate


def test_constant_intensity_shows_no_curve(record):
    estimate = outcome(record(6.0, np.full(120, 0.8), noise=0.01))
    assert not estimate.curve_known
    assert (estimate.nonlinear_identifiability == NOT_INFORMED).all()
    # Noise of 1 % of the maximum, and the batch predicts by a fit of 3 s before.
    assert estimate.output_error < 0.1


def test_below_threshold_informs_of_nothing(record):
    generator = np.random.default_rng(0)
    take = record(6.0, generator.uniform(0, 0.1, 120), noise=0.0)
    take.force[:] = 0.01 * generator.standard_normal(len(take.force))
    estimate = outcome(take)
    assert (estimate.nonlinear_identifiability == NOT_INFORMED).all()


def test_single_pulse(record):
    estimate = outcome(record(1.0, [1.0], rate_hz=1.0, noise=0.01))
    assert not estimate.curve_known
    assert (estimate.nonlinear_identifiability == NOT_INFORMED).all()


def test_saturated_force_has_wide_intervals(record):
    take = record(8.0, noise=0.002)
    free = outcome(take)
    np.clip(take.force, None, 0.4 * take.force.max(), out=take.force)
    estimate = outcome(take)
    # The sensor's limit looks like an early saturation; correlated residuals widen the intervals.
    half = np.max(estimate.curve_upper - estimate.curve_force) / estimate.curve_force.max()
    assert half > 3 * np.max(free.curve_upper - free.curve_force) / free.curve_force.max()


def test_no_force_at_all(record):
    take = record(5.0)
    take.force[:] = 0.0
    estimate = outcome(take)
    assert (estimate.nonlinear_identifiability == NOT_INFORMED).all()
    np.testing.assert_allclose(estimate.curve_force, 0.0, atol=1e-6)
    assert not len(estimate.physiology)


def test_noise_as_large_as_the_force(record):
    take = record(8.0, noise=1.0, seed=2)
    estimate = outcome(take)
    assert not (estimate.nonlinear_identifiability == CONVERGED).any()
    held = (estimate.curve_lower <= take.curve) & (take.curve <= estimate.curve_upper)
    assert held.mean() > 0.9


def test_step_of_the_baseline(record):
    take = record(10.0, noise=0.005)
    take.force[5_000:] += 0.2 * take.force.max()
    estimate = outcome(take)
    # No baseline of the model follows a step: nothing may be flagged as converged.
    assert not (estimate.nonlinear_identifiability == CONVERGED).any()
    assert (estimate.curve_upper - estimate.curve_force).max() > 0.05 * take.curve.max()


def test_nothing_at_all():
    estimate = BatchEstimator(SETTINGS).estimate(0, {})
    assert estimate.samples == 0
    assert estimate.confidence == 0.0
    assert not estimate.curve_known


def test_unusable_samples_are_predicted_only(record):
    take = record(3.0)
    estimator = BatchEstimator(SETTINGS)
    estimator.add_pulses(take.onset_ns, take.intensity)
    usable = np.zeros(len(take.stamp_ns), dtype=bool)
    estimator.update(take.stamp_ns, np.full(len(take.stamp_ns), 1e9), usable)
    assert estimator.estimate(0, {}).samples == 0
    assert estimator.parameters == SETTINGS.start
