# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sums of blocks give the same equations as a loop over samples, derivatives included."""

import numpy as np
import pytest

from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.estimation.window_equations import condensed, no_change
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.recruitment import (
    DEVIATION,
    NONLINEAR,
    SUMMATION,
    coordinates,
    from_coordinates,
)
from rpms_ros.muscle import RateRecruitment, RecruitmentParameters, identified_recruitment

BASIS = LaguerreBasis(5, 38e-3, 3.3e-3)
LINEAR = np.array([1.0, -0.5, 0.3, 0.2, -0.1])
WHOLE_NS = 10_000_000_000


def theta_of(seed):
    """Return arctangents with a deviation, and a summation of its own."""
    generator = np.random.default_rng(seed)
    theta = np.zeros(NONLINEAR)
    theta[:4] = 0.5, 0.9, 6.0, 5.0
    theta[DEVIATION] = 0.1 * generator.standard_normal(20)
    theta[SUMMATION] = 0.8, 0.3
    return theta


def regressors(take, theta):
    """Return Phi (samples, functions), sample by sample and pulse by pulse."""

    def shape(intensity):
        return identified_recruitment(RecruitmentParameters(*theta[:4]), intensity)

    angle = np.pi * np.outer(take.intensity, np.arange(1, 21)) / 1.2
    rho = shape(take.intensity) + shape(1.0) * (np.sin(angle) @ theta[DEVIATION])
    by_rate = RateRecruitment()
    rate = np.concatenate(([0.0], 1e9 / np.diff(take.onset_ns)))
    weight = by_rate.per_pulse(rate) / by_rate.per_pulse(20.0)
    power = np.where(weight > 1.0, theta[SUMMATION][0], theta[SUMMATION][1])
    total = np.zeros((len(take.stamp_ns), BASIS.functions))
    for onset, share in zip(take.onset_ns, rho * weight**power, strict=True):
        total += share * BASIS.evaluate(1e-9 * (take.stamp_ns - onset))
    return total


@pytest.fixture(name='prepared', scope='module')
def prepared_fixture(record):
    take = record(1.5, seed=3)
    # intervals of 32 to 68 ms: both kinds of weight
    take.onset_ns[:] += np.random.default_rng(1).integers(
        -9_000_000, 9_000_000, len(take.onset_ns)
    )
    take.onset_ns[0] = 1_000
    estimator = TrackingEstimator(
        TrackingSettings(basis=BASIS, choose_basis=False, step_period=100.0)
    )
    take.feed(estimator)
    return take, estimator


def test_equal_those_of_a_loop_over_samples(prepared):
    take, estimator = prepared
    theta = theta_of(2)
    still = no_change(BASIS.functions)
    whole = condensed(estimator._problem, theta, LINEAR, 0, WHOLE_NS, still)
    step = 1e-5
    moves = step * np.eye(NONLINEAR)
    psi = [
        (
            regressors(take, from_coordinates(coordinates(theta) + move))
            - regressors(take, from_coordinates(coordinates(theta) - move))
        )
        @ LINEAR
        / (2 * step)
        for move in moves
    ]
    ahead = 1e-9 * take.stamp_ns * 1e9 / WHOLE_NS
    columns = np.column_stack((*psi, regressors(take, theta), 1.0 - ahead, ahead))
    expected = columns.T @ columns
    # Central differences of step 1e-5 leave 1e-9 of the curvature; sums 1e-12.
    np.testing.assert_allclose(whole.gram[0], expected, atol=1e-6 * expected.max())
    force = columns.T @ take.force
    np.testing.assert_allclose(whole.right[0], force, atol=1e-6 * np.abs(force).max())
    assert whole.samples[0] == len(take.force)


def test_the_paper_s_form_has_no_deviation():
    starts = ProjectionSettings().starts()
    assert all((start[DEVIATION] == 0.0).all() for start in starts)
