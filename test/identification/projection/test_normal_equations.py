# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sums a block give the same normal equations as a loop over samples, derivatives included."""

import numpy as np
import pytest

from rpms_ros.identification.estimation.normal_equations import gradient_pass, linear_pass
from rpms_ros.identification.estimation.settings import PARAMETERS
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.muscle import RecruitmentParameters, identified_recruitment

THETA = np.array([0.5, 0.9, 6.0, 5.0])
BASIS = LaguerreBasis(5, 38e-3, 3.3e-3)


def in_logarithms(theta, place, step):
    """Return theta with one parameter moved, alpha as its logarithm."""
    moved = theta.copy()
    moved[place] = theta[place] * np.exp(step) if place >= 2 else theta[place] + step
    return moved


def regressors(take, theta):
    """Return Phi (samples, functions), sample by sample and pulse by pulse."""
    rho = identified_recruitment(RecruitmentParameters(*theta), take.intensity)
    total = np.zeros((len(take.stamp_ns), BASIS.functions))
    for onset, share in zip(take.onset_ns, rho, strict=True):
        total += share * BASIS.evaluate(1e-9 * (take.stamp_ns - onset))
    return total


@pytest.fixture(name='prepared', scope='module')
def prepared_fixture(record):
    take = record(1.5, seed=3)
    estimator = TrackingEstimator(TrackingSettings(basis=BASIS, by_rate=None, step_period=100.0))
    take.feed(estimator)
    return take, estimator


def equations(estimator, theta, linear):
    """Return matrix and right-hand side at theta, the derivatives taken at `linear`."""
    fit = estimator._fit
    last = int(estimator._problem.blocks.size[0])
    linear_pass(estimator._problem, last, theta, fit.matrix, fit.right)
    gradient_pass(estimator._problem, last, theta, linear, fit.matrix, fit.right)
    lower = np.tril(fit.matrix)
    return lower + np.tril(lower, -1).T, fit.right.copy()


def test_equal_those_of_a_loop_over_samples(prepared):
    take, estimator = prepared
    linear = np.array([1.0, -0.5, 0.3, 0.2, -0.1])
    matrix, right = equations(estimator, THETA, linear)
    phi = regressors(take, THETA)
    step = 1e-5
    psi = np.column_stack(
        [
            (
                regressors(take, in_logarithms(THETA, place, step))
                - regressors(take, in_logarithms(THETA, place, -step))
            )
            @ linear
            / (2 * step)
            for place in range(PARAMETERS)
        ]
    )
    columns = np.hstack((psi, phi))
    part = columns.shape[1]
    expected = columns.T @ columns
    # Central differences of step 1e-5 leave 1e-9 of the curvature; sums 1e-12.
    np.testing.assert_allclose(matrix[:part, :part], expected, atol=1e-6 * expected.max())
    force = columns.T @ take.force
    np.testing.assert_allclose(right[:part], force, atol=1e-6 * np.abs(force).max())


def test_offset_and_slope_are_sums_over_samples(prepared):
    take, estimator = prepared
    baseline = estimator._problem.baseline._replace(origin_ns=0, spacing_ns=int(take.stamp_ns[-1]))
    estimator._problem = estimator._problem._replace(baseline=baseline)
    matrix, right = equations(estimator, THETA, np.zeros(BASIS.functions))
    ahead = take.stamp_ns / take.stamp_ns[-1]
    hats = np.column_stack((1.0 - ahead, ahead))
    part = slice(PARAMETERS + BASIS.functions, PARAMETERS + BASIS.functions + 2)
    np.testing.assert_allclose(matrix[part, part], hats.T @ hats, rtol=1e-9)
    np.testing.assert_allclose(right[part], hats.T @ take.force, rtol=1e-9)
    cross = hats.T @ regressors(take, THETA)
    between = matrix[part, PARAMETERS : PARAMETERS + BASIS.functions]
    np.testing.assert_allclose(between, cross, atol=1e-9 * np.abs(cross).max())
