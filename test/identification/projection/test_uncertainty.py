# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Intervals contain the truth as often as stated, flags follow their rules."""

import numpy as np
import pytest

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.uncertainty import identifiability
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED, INFORMED, NOT_INFORMED
from rpms_ros.identification.model.physiology import PHYSIOLOGY_NAMES
from rpms_ros.muscle import Subject, simulation_subject

pytestmark = pytest.mark.long

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))


def test_intervals_hold_the_truth(record):
    """Thirty sessions; the 200 of the benchmark give 95 % within a per cent or two."""
    parameters, curve = [], []
    for seed in range(30):
        take = record(6.0, noise=0.01, seed=seed)
        estimator = BatchEstimator(SETTINGS)
        take.feed(estimator)
        estimate = estimator.estimate(0, {})
        width = 1.96 * np.sqrt(np.diag(estimate.nonlinear_covariance))
        parameters.append(np.abs(estimate.nonlinear - [0.48, 0.98, 4.0, 6.0]) <= width)
        held = (estimate.curve_lower <= take.curve) & (take.curve <= estimate.curve_upper)
        curve.append(held[5:].mean())
    # 95 % of 120 parameters, and of 30 curves whose points hang together: 4 sigma below
    assert np.mean(parameters) > 0.87
    assert np.mean(curve) > 0.82


def test_intervals_shrink_with_the_root_of_the_time(record):
    widths = []
    for seconds in (4.0, 16.0):
        take = record(seconds, noise=0.02)
        estimator = BatchEstimator(SETTINGS)
        take.feed(estimator)
        estimate = estimator.estimate(0, {})
        widths.append(float(np.mean(estimate.curve_upper - estimate.curve_lower)))
    # A half, give or take what the random intensities of 4 s happen to tell
    assert 1.5 < widths[0] / widths[1] < 3.0


def test_identifiability_flags_follow_their_rules():
    prior = np.full(4, 0.2)
    deviation = np.array([0.19, 0.1, 0.001, 0.001])
    flags = [NOT_INFORMED, INFORMED, CONVERGED, CONVERGED]
    np.testing.assert_array_equal(identifiability(deviation, prior, 0.0), flags)
    np.testing.assert_array_equal(
        identifiability(np.full(4, 0.001), prior, 0.05), [INFORMED, INFORMED, CONVERGED, CONVERGED]
    )


@pytest.mark.parametrize(
    ('time_constant', 'latency'), [(30e-3, 9e-3), (38.44e-3, 11e-3), (45e-3, 8e-3)]
)
def test_physiology_is_read_off_the_response(time_constant, latency, record):
    recruitment = simulation_subject().recruitment
    subject = Subject(time_constant, latency, recruitment=recruitment)
    take = record(12.0, subject=subject, noise=0.005)
    estimator = BatchEstimator(ProjectionSettings(basis=LaguerreBasis(8, 38e-3, 8e-3)))
    take.feed(estimator)
    estimate = estimator.estimate(0, {})
    assert estimate.physiology_names == PHYSIOLOGY_NAMES
    peak = float(subject.pulse_weight(1.0, 20.0) - subject.pulse_weight(0.0, 20.0))
    truth = np.array([time_constant, latency, 3.0, peak])
    # Time constant and order trade against each other: 1.5 ms against 0.1.
    np.testing.assert_allclose(estimate.physiology, truth, rtol=0.06, atol=1e-3)
    lower, upper = estimate.physiology_lower, estimate.physiology_upper
    assert ((lower <= estimate.physiology) & (estimate.physiology <= upper)).all()
