# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The horizon follows a muscle that changes, and its arrival cost is right.

Mutants that make a test of this file fail, each tried by hand:

* forgetting turned off;
* the gradient of the arrival cost set to zero (nothing added to `information_vector`);
* its decay omitted (only the information is forgotten);
* memory and horizon never compared;
* no other start tried after a contradiction;
* the arrival cost not expanded at the present parameters (`_recentre` omitted);
* the horizon's part of the statistic omitted;
* no process noise along the difference;
* nothing forgotten after a contradiction.
"""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification.estimation import horizon
from rpms_ros.identification.estimation.gauss_newton import empty_fit, fit_linear
from rpms_ros.identification.estimation.horizon import (
    HorizonEstimator,
    disagreement_limit,
    forget,
    marginalize,
    reduce_contradiction,
)
from rpms_ros.identification.estimation.settings import PARAMETERS, ProjectionSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED
from rpms_ros.muscle import RecruitmentParameters, identified_recruitment

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))
SECOND = 1000


def with_gain_step(record, seed, seconds, at, gain, intensity=None):
    """Return a recording whose force is `gain` times as large from second `at` on."""
    take = record(seconds, intensity, noise=0.005, seed=seed)
    force = take.force.copy()
    force[at * SECOND :] *= gain
    return replace(take, force=force, curve=gain * take.curve)


def sinusoid(seconds):
    """Return intensities at 20 Hz with a period of 9 s."""
    return 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(20 * seconds) / 180)


@pytest.mark.long
@pytest.mark.parametrize(('kind', 'seed'), [('random', 0), ('random', 1), ('sinusoid', 0)])
def test_a_step_of_gain_has_left_when_the_horizon_has(kind, seed, record):
    """After 20 s the horizon holds the new muscle only; 2 s later so does the estimate."""
    intensity = sinusoid(52) if kind == 'sinusoid' else None
    take = with_gain_step(record, seed, 52, 30, 0.7, intensity)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    estimate = estimator.estimate(0, {})
    # A fresh fit of the same 20 s has 0.1 %; the memory of the gain before would leave 4 %.
    assert take.curve_error(estimate) < 0.005
    half = np.maximum(estimate.curve_upper - estimate.curve_force, 1e-9)
    # Three half widths are six standard deviations.
    assert (np.abs(estimate.curve_force - take.curve) < 3 * half)[5:].all()


def test_nothing_is_settled_while_the_horizon_holds_two_muscles(record):
    take = with_gain_step(record, 2, 36, 26, 0.7)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    assert not (estimator.estimate(0, {}).nonlinear_identifiability == CONVERGED).all()


@pytest.mark.long
@pytest.mark.parametrize('seed', range(3))
def test_another_start_ends_a_local_minimum(seed, record):
    """Thrown far off when the old muscle has just left, the fit comes back."""
    take = with_gain_step(record, seed, 34, 8, 0.6)
    settings = replace(SETTINGS, horizon=12.0)
    estimator = HorizonEstimator(settings)
    estimator.add_pulses(take.onset_ns, take.intensity)
    every = np.ones(SECOND, dtype=bool)
    for start in range(0, len(take.stamp_ns), SECOND):
        part = slice(start, start + SECOND)
        if start == 20 * SECOND:
            estimator._fit.theta[:] = [0.576, 0.677, 2.14, 2.68]
            estimator._settled_ns = int(take.stamp_ns[start]) + 12_000_000_000
        estimator.update(take.stamp_ns[part], take.force[part], every)
    assert take.curve_error(estimator.estimate(0, {})) < 0.005


@pytest.fixture(name='absorbed')
def absorbed_fixture(record):
    """Three seconds, condensed and marginalized at parameters beside the optimum."""
    take = record(3.0, noise=0.01, seed=5)
    settings = replace(SETTINGS, by_rate=None, step_period=100.0, baseline=False)
    estimator = HorizonEstimator(settings)
    take.feed(estimator)
    fit = estimator._fit
    fit.theta[:] = [0.45, 0.95, 4.5, 5.5]
    fit_linear(estimator._problem, fit, True)
    fit.linear[0] *= 1.02
    marginalize(estimator._problem, int(estimator._problem.blocks.size[0]), fit, estimator._trial)
    return take, estimator


def squares(take, theta, linear):
    """Return the sum of squared residuals, sample by sample."""
    rho = identified_recruitment(RecruitmentParameters(*theta), take.intensity)
    force = np.zeros(len(take.stamp_ns))
    for onset, share in zip(take.onset_ns, rho, strict=True):
        values = SETTINGS.basis.evaluate(1e-9 * (take.stamp_ns - onset))
        force += share * (values @ linear)
    return float(np.sum((take.force - force) ** 2))


def test_the_arrival_cost_has_the_slope_of_the_samples(absorbed):
    take, estimator = absorbed
    fit, prior = estimator._fit, estimator._problem.prior
    found = []
    for place in range(len(prior.information_vector)):
        costs = []
        for step in (1e-4, -1e-4):
            theta, linear = fit.theta.copy(), fit.linear.copy()
            if place < 2:
                theta[place] += step
            elif place < PARAMETERS:
                theta[place] *= np.exp(step)
            else:
                linear[place - PARAMETERS] += step
            costs.append(squares(take, theta, linear))
        found.append((costs[0] - costs[1]) / 2e-4)
    # Central differences of step 1e-4: 1e-8 of the third derivative, a few 1e-5 of the slope here
    expected = -2 * prior.information_vector
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_forgetting_moves_no_optimum(absorbed):
    """Less is known afterwards, about the same parameters."""
    _, estimator = absorbed
    prior, fit = estimator._problem.prior, estimator._fit
    fit.variance[0] = 0.01
    # The horizon knows half of what is remembered, and the first Laguerre function twice as well.
    fit.complete[:] = 0.5 * np.tril(prior.information)
    fit.complete[4, 4] += prior.information[4, 4]
    before = np.linalg.solve(prior.information, prior.information_vector)
    sizes = np.linalg.eigvalsh(prior.information)
    for _ in range(10):
        forget(prior, fit, 0.1)
    after = np.linalg.solve(prior.information, prior.information_vector)
    # Condition number 1e5 of a matrix known to 1e-12
    np.testing.assert_allclose(after, before, atol=1e-6 * np.abs(before).max())
    assert (np.linalg.eigvalsh(prior.information) < 0.9 * sizes).all()


def test_the_arrival_cost_is_small_beside_a_full_horizon(record):
    take = record(60.0, noise=0.01)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    functions = slice(PARAMETERS, PARAMETERS + 7)
    remembered = np.trace(estimator._problem.prior.information[functions, functions])
    held = np.trace(estimator._fit.complete[functions, functions])
    # A step forgets 2 % of what is replaced while 1/400 to 1/200 of the horizon leaves: a share
    # of an eighth to a third stays.  Without forgetting it would be twice the horizon.
    assert 0.05 * held < remembered < 0.5 * held


@pytest.mark.long
def test_the_disagreement_of_an_unchanged_muscle_is_chi_square(record, monkeypatch):
    """On average near the number of unknowns, and practically never above the limit."""
    found = []

    def noted(*arguments):
        found.append(reduce_contradiction(*arguments))
        return found[-1]

    reduce_contradiction = horizon.reduce_contradiction
    monkeypatch.setattr(horizon, 'reduce_contradiction', noted)
    for seed in range(4):
        record(16.0, noise=0.01, seed=seed).feed(HorizonEstimator(replace(SETTINGS, horizon=6.0)))
    limit = disagreement_limit(11)
    # Steps overlap: four recordings hold about ten independent values of standard deviation 4.7.
    assert 5.0 < np.mean(found) < 17.0
    assert max(found) < limit
    # 99.99 % of chi-square with 11 degrees of freedom, from a table
    assert limit == pytest.approx(37.37, abs=0.01)


class TwoEstimates:
    """Memory and horizon as two quadratic costs of known centre and information."""

    variance = 0.3

    def __init__(self):
        random = np.random.default_rng(8)
        factors = random.standard_normal((2, 5, 8))
        self.memory, self.horizon = (factor @ factor.T for factor in factors)
        self.remembered, self.seen = random.uniform(0.1, 0.9, (2, 5))
        theta = np.array([0.4, 0.9, 6.0, 5.0])
        # the linear unknown is solved: the slope of both costs together by it is zero
        point = np.array([*theta[:2], *np.log(theta[2:]), 0.0])
        slope = self.memory @ (self.remembered - point) + self.horizon @ (self.seen - point)
        point[4] = slope[4] / (self.memory + self.horizon)[4, 4]
        self.slope = self.memory @ (self.remembered - point) + self.horizon @ (self.seen - point)
        self.fit = empty_fit(theta, 1, 0)
        self.fit.linear[:] = point[4]
        self.fit.complete[:] = np.tril(self.horizon)
        self.fit.variance[0] = self.variance
        self.fit.samples[0] = 1.0
        # far above the variance: the ridge is too small to count
        self.fit.energy[0] = 1e12
        self.prior = replace(SETTINGS, basis=LaguerreBasis(1, 38e-3, 0.0)).as_prior()
        self.prior.deviation[:] = 1e9
        self.prior.information[:] = self.memory
        self.prior.reference[:] = self.remembered

    def compare(self, limit):
        return reduce_contradiction(self.prior, self.fit, self.slope[:PARAMETERS].copy(), limit)


def test_the_statistic_is_the_squared_difference_in_units_of_its_covariance():
    two = TwoEstimates()
    covariance = np.linalg.inv(two.memory) + np.linalg.inv(two.horizon)
    difference = two.remembered - two.seen
    expected = difference @ np.linalg.solve(covariance, difference) / two.variance
    # what keeps matrices positive is 1e-9 of them
    assert two.compare(np.inf) == pytest.approx(expected, rel=1e-6)
    np.testing.assert_array_equal(two.prior.information, two.memory)


def test_what_contradicts_the_horizon_gets_noise_and_is_forgotten():
    """As the equations of `arrival_cost` say; where it had its optimum, it still has it."""
    two = TwoEstimates()
    statistic = two.compare(0.0)
    both = two.memory + two.horizon
    optimum = np.linalg.solve(both, two.memory @ two.remembered + two.horizon @ two.seen)
    slope = two.memory @ (two.remembered - optimum)
    noise = np.outer(slope, slope) / (slope @ np.linalg.solve(two.memory, slope))
    noisy = two.memory - (1.0 - 1.0 / statistic) * noise
    # forgotten with share 1; M is kept positive by the variance on its diagonal
    total = noisy + two.horizon + two.variance * np.eye(5)
    expected = noisy @ np.linalg.solve(total, noisy)
    np.testing.assert_allclose(two.prior.information, expected, rtol=1e-6, atol=1e-9)
    # its own optimum has not moved
    centre = two.prior.reference + np.linalg.solve(
        two.prior.information, two.prior.information_vector
    )
    np.testing.assert_allclose(centre, two.remembered, rtol=1e-6)
