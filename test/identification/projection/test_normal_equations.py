# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sums of blocks and equations of a changing muscle, against those of all samples."""

import numpy as np
import pytest

from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.estimation.window_equations import (
    Point,
    Roughness,
    ages_in_knots,
    assembled,
    condensed,
    disturbance_at,
    eliminated,
    empty_intervals,
    log_determinant_of_prior,
    no_change,
    shares_of_prior,
    steady,
    time_scale_derivative,
    time_scaled,
)
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    SINES,
    SUMMATION,
    coordinates,
    from_coordinates,
)
from rpms_ros.muscle import RateRecruitment, RecruitmentParameters, identified_recruitment

BASIS = LaguerreBasis(5, 38e-3, 3.3e-3)
LINEAR = np.array([1.0, -0.5, 0.3, 0.2, -0.1])
WHOLE_NS, NOW_NS = 10_000_000_000, 1_500_000_000
# of u_thr and u_sat, at ages counted in ten seconds
MOVED_AT, MOVED = np.array([0.0, 0.06, 0.11]), np.array([[0.0, 0.02, 0.01], [0.0, -0.01, -0.02]])
DEVIATION = slice(PARAMETERS, PARAMETERS + SINES)
NONLINEAR = PARAMETERS + SINES + 2


def theta_of(seed):
    """Return arctangents with a deviation, and a summation of its own."""
    generator = np.random.default_rng(seed)
    theta = np.zeros(NONLINEAR)
    theta[:4] = 0.5, 0.9, 6.0, 5.0
    theta[DEVIATION] = 0.1 * generator.standard_normal(20)
    theta[SUMMATION] = 0.8, 0.3
    return theta


def regressors(take, theta):
    """Return Phi (samples, functions), sample by sample and pulse by pulse of its own age."""

    def shape(intensity, age):
        # beyond the last knot as between the last two
        beyond = max(age - MOVED_AT[-1], 0.0) * (MOVED[:, 2] - MOVED[:, 1]) / np.diff(MOVED_AT)[-1]
        thresholds = theta[:2] + [np.interp(age, MOVED_AT, way) for way in MOVED] + beyond
        return identified_recruitment(RecruitmentParameters(*thresholds, *theta[2:4]), intensity)

    angle = np.pi * np.outer(take.intensity, np.arange(1, 21)) / 1.2
    ages = (NOW_NS - (take.onset_ns + round(1e9 * BASIS.latency))) / WHOLE_NS
    deviation = np.sin(angle) @ theta[DEVIATION]
    rho = np.array(
        [
            shape(one, age) + shape(1.0, age) * away
            for one, age, away in zip(take.intensity, ages, deviation, strict=True)
        ]
    )
    by_rate = RateRecruitment()
    rate = np.concatenate(([0.0], 1e9 / np.diff(take.onset_ns)))
    weight = by_rate.per_pulse(rate) / by_rate.per_pulse(20.0)
    power = np.where(weight > 1.0, theta[SUMMATION][0], theta[SUMMATION][1])
    total = np.zeros((len(take.stamp_ns), BASIS.functions))
    for onset, share in zip(take.onset_ns, rho * weight**power, strict=True):
        total += share * BASIS.evaluate(1e-9 * (take.stamp_ns - onset))
    return total


def test_equal_those_of_a_loop_over_samples(recorded):
    take = recorded(1.5, seed=3)
    # intervals of 32 to 68 ms: both kinds of weight
    moved_ns = np.random.default_rng(1).integers(-9_000_000, 9_000_000, len(take.onset_ns))
    take.onset_ns[:] += moved_ns
    take.onset_ns[0] = 1_000
    settings = TrackingSettings(basis=BASIS, choose_basis=False, step_period=100.0)
    estimator = TrackingEstimator(settings)
    take.feed(estimator)
    theta = theta_of(2)
    still = no_change(BASIS.functions)
    times = 7.0 - MOVED_AT
    point = steady(theta, LINEAR).at_times(times)._replace(thresholds=MOVED[:, 1:])
    whole = condensed(estimator._problem, point, 0, NOW_NS, WHOLE_NS, still)
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
    starts = ProjectionSettings().starts(SINES)
    assert all((start[DEVIATION] == 0.0).all() for start in starts)


FUNCTIONS, INTERVALS, SAMPLES, KNOTS, FIRST = 6, 9, 60, 2, 100
LOCAL = NONLINEAR + FUNCTIONS
# the newest distance of knots is shorter, as that since a pause
AGES, VARIANCE = np.array([0.0, 2.0, 5.0]), 0.04
# information about the level of a knot
LEVEL = 0.01


def past(knots, age):
    """Return a line between 0 now and the knots; beyond the last one it goes on."""
    values = np.concatenate(([0.0], knots))
    first = 0 if age < AGES[1] else 1
    part = (age - AGES[first]) / (AGES[first + 1] - AGES[first])
    return (1.0 - part) * values[first] + part * values[first + 1]


class Written:
    """A window with its samples: columns of every interval, force, point."""

    def __init__(self, seed: int) -> None:
        generator = np.random.default_rng(seed)
        self.columns = generator.standard_normal((INTERVALS, SAMPLES, LOCAL + 2))
        self.columns[4] = 0.0
        share = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        self.columns[:, :, LOCAL], self.columns[:, :, LOCAL + 1] = 1.0 - share, share
        self.columns[4] = 0.0
        self.force = generator.standard_normal((INTERVALS, SAMPLES))
        self.force[4] = 0.0
        self.point = Point(
            theta=np.concatenate(([0.5, 0.9, 5.0, 6.0], np.zeros(NONLINEAR - 4))),
            linear=generator.standard_normal(FUNCTIONS),
            gain=np.array([0.1, 0.25]),
            slowing=np.array([-0.05, -0.08]),
            thresholds=np.array([[0.01, 0.02], [-0.01, -0.05]]),
            times=FIRST + INTERVALS - AGES,
        )
        self.now = float(INTERVALS)
        self.ages = ages_in_knots(self.point.times, FIRST, INTERVALS)

    def intervals(self):
        """Return what the estimator keeps of it; the fifth interval holds no sample."""
        found = empty_intervals(INTERVALS, LOCAL + 2, FIRST)
        for index in range(INTERVALS):
            columns, force = self.columns[index], self.force[index]
            found.gram[index] = columns.T @ columns
            found.right[index] = columns.T @ force
            found.energy[index] = force @ force
            found.samples[index] = 0 if index == 4 else SAMPLES
        return found

    def model(self, x):
        """Return the force (intervals, samples) of the muscle at unknowns x, by the formula."""
        theta, linear, gain, slowing, *moved = np.split(
            x, np.cumsum([NONLINEAR, FUNCTIONS, KNOTS, KNOTS, KNOTS])
        )
        # the columns are those of the point, its thresholds' change included
        moved -= self.point.thresholds
        force = np.zeros((INTERVALS, SAMPLES))
        for index in range(INTERVALS):
            age = self.now - (index + 0.5)
            grown, delay = past(gain, age), past(slowing, age)
            inner = self.columns[index, :, :LOCAL] @ np.concatenate(
                (
                    theta + np.append([past(way, age) for way in moved], np.zeros(NONLINEAR - 2)),
                    time_scaled(linear, delay),
                )
            )
            force[index] = (1.0 + grown) * inner
        return force

    def unknowns(self):
        """Return x at the point; theta counts as a deviation."""
        point = self.point
        return np.concatenate((np.zeros(NONLINEAR), point.linear, point.changes.ravel()))

    def disturbance(self):
        """Return the matrix (samples, knots) of the disturbance."""
        matrix = np.zeros((INTERVALS, SAMPLES, INTERVALS + 1))
        for index in range(INTERVALS):
            matrix[index, :, index] = self.columns[index, :, LOCAL]
            matrix[index, :, index + 1] = self.columns[index, :, LOCAL + 1]
        return matrix.reshape(-1, INTERVALS + 1)


def penalty_of(rough):
    """Return the information (knots, knots) of a prior of differences."""
    first, second = (np.diff(np.eye(INTERVALS + 1), order, axis=0) for order in (1, 2))
    differences = first.T * rough.first[:-1] @ first + second.T * rough.second[1:-1] @ second
    # a mean that is not known has a prior of its own
    apart = np.full(INTERVALS + 1, rough.extent)
    return differences + np.diag(apart) - np.outer(apart, apart) / (apart.sum() + LEVEL)


def dense(written, rough, level, about):
    """Return information, right-hand side, cost and levels by linear algebra with all samples."""
    x = written.unknowns()
    steps = 1e-6 * np.eye(len(x))
    jacobian = np.stack(
        [(written.model(x + h) - written.model(x - h)).ravel() / 2e-6 for h in steps], axis=1
    )
    rest = (written.force - written.model(x)).ravel()
    matrix = written.disturbance()
    inner = matrix.T @ matrix / VARIANCE + penalty_of(rough) + np.diag(level)
    across = matrix.T @ jacobian / VARIANCE
    right = matrix.T @ rest / VARIANCE + level * about
    information = jacobian.T @ jacobian / VARIANCE - across.T @ np.linalg.solve(inner, across)
    gradient = jacobian.T @ rest / VARIANCE - across.T @ np.linalg.solve(inner, right)
    cost = rest @ rest / VARIANCE + level @ about**2 - right @ np.linalg.solve(inner, right)
    step = np.full(len(x), 0.01)
    levels = np.linalg.solve(inner, right - across @ step)
    return information, gradient, cost, levels, step


@pytest.mark.parametrize(('seed', 'extent'), [(0, 0.0), (1, 0.0), (2, 5.0)])
def test_the_equations_are_those_of_all_samples(seed, extent):
    written = Written(seed)
    generator = np.random.default_rng(seed)
    rough = Roughness(*generator.uniform(1.0, 100.0, (2, INTERVALS + 1)), extent)
    level = np.full(INTERVALS + 1, LEVEL)
    about = generator.standard_normal(INTERVALS + 1)
    equations = assembled(written.intervals(), written.point, written.ages)
    reduced = eliminated(equations, VARIANCE, rough, level, about)
    information, gradient, cost, levels, step = dense(written, rough, level, about)
    # the dense Jacobian is by differences: about 1e-8 of its entries
    np.testing.assert_allclose(reduced.matrix, information, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(reduced.right, gradient, rtol=1e-6, atol=1e-5)
    assert reduced.cost[0] == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(disturbance_at(reduced, step), levels, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize('extent', [0.0, 5.0])
def test_determinant_of_the_prior_of_a_course(extent):
    differences = np.random.default_rng(4).uniform(1.0, 100.0, (2, INTERVALS + 1))
    rough, level = Roughness(*differences, extent), np.full(INTERVALS + 1, LEVEL)
    whole = penalty_of(rough) + np.diag(level)
    found = log_determinant_of_prior(rough, level)
    assert found == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-9)


def test_shares_of_the_prior_of_differences():
    rough = Roughness(*np.random.default_rng(3).uniform(1.0, 100.0, (2, INTERVALS + 1)), 0.0)
    shares, logarithm = shares_of_prior(rough)
    # the increments are all but the level of the first knot
    increments = np.tri(INTERVALS + 1, INTERVALS, -1)
    information = increments.T @ penalty_of(rough) @ increments
    covariance = np.linalg.inv(information)
    bends = np.diff(np.eye(INTERVALS), axis=0)
    first = rough.first[:-1] * np.diag(covariance)
    second = rough.second[1:-1] * np.diag(bends @ covariance @ bends.T)
    np.testing.assert_allclose(shares[0, :-1], first, rtol=1e-9)
    np.testing.assert_allclose(shares[1, 1:-1], second, rtol=1e-9)
    assert logarithm == pytest.approx(np.linalg.slogdet(information)[1], rel=1e-9)
    # each difference is told by its own prior or by another one
    assert first.sum() + second.sum() == pytest.approx(INTERVALS)


def test_slowing_is_the_derivative_by_the_time_constant():
    """Of the functions that are held; the one behind the last is cut off."""
    step, functions = 1e-6, 5
    weights = np.array([1.0, -0.5, 0.3, 0.2, 0.0])
    lag = np.linspace(0.0, 0.4, 50)
    slower, faster = (
        LaguerreBasis(functions, 38e-3 * np.exp(sign * step)).evaluate(lag) @ weights
        for sign in (1, -1)
    )
    derivative = LaguerreBasis(functions, 38e-3).evaluate(lag) @ time_scale_derivative(weights)
    # differences of values of about 10 over a step of 1e-6: nine digits are left
    np.testing.assert_allclose(derivative, (slower - faster) / (2 * step), atol=1e-7)


def test_a_response_is_stretched_in_time():
    """A twitch of third order, 25 % slower: what it keeps is its area but for the factor."""
    basis, stretch = LaguerreBasis(9, 38e-3), 1.25
    lag = np.arange(0.0005, 2.0, 1e-3)

    def twitch(constant):
        return (lag / constant) ** 2 * np.exp(-lag / constant)

    functions = basis.evaluate(lag)
    weights = 1e-3 * functions.T @ twitch(32e-3)
    slower = functions @ time_scaled(weights, np.log(stretch))
    expected = twitch(32e-3 * stretch) / np.sqrt(stretch)
    # nine functions hold the slower twitch to 0.1 % of its peak
    np.testing.assert_allclose(slower, expected, atol=2e-3 * expected.max())
