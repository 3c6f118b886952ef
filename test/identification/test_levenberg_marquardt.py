# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The loop on a model of its own, beside scipy; its models in the package have their own tests."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numba.extending import register_jitable
from scipy.optimize import least_squares

from rpms_ros.identification.model.levenberg_marquardt import (
    Ending,
    bounded_step,
    condition_number,
    minimiser,
    solve_positive,
)

TIME = np.linspace(0.0, 2.0, 41)
ENDING = Ending(60, 1e-12, 1e-18)


class Decay(NamedTuple):
    time: np.ndarray
    data: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Place(NamedTuple):
    theta: np.ndarray
    cost: np.ndarray
    energy: np.ndarray
    damping: np.ndarray
    moved: np.ndarray
    failures: np.ndarray


@register_jitable
def cost_of(problem, theta):
    return ((problem.data - theta[0] * np.exp(-theta[1] * problem.time)) ** 2).sum()


@register_jitable
def linearise(problem, here, hessian, gradient):
    shape = np.exp(-here.theta[1] * problem.time)
    residual = problem.data - here.theta[0] * shape
    slope = -here.theta[0] * problem.time * shape
    gradient[0] = (shape * residual).sum()
    gradient[1] = (slope * residual).sum()
    hessian[0, 0] = (shape * shape).sum()
    hessian[1, 1] = (slope * slope).sum()
    hessian[0, 1] = hessian[1, 0] = (shape * slope).sum()
    return True


@register_jitable
def room(problem, here, low, high):
    low[:] = problem.lower - here.theta
    high[:] = problem.upper - here.theta


@register_jitable
def move(problem, here, change, trial):
    trial.theta[:] = here.theta + change
    trial.cost[0] = cost_of(problem, trial.theta)


fit_decay = minimiser(linearise, room, move)


def fitted(data, start, lower, upper, ending=ENDING):
    problem = Decay(TIME, data, np.array(lower, dtype=float), np.array(upper, dtype=float))
    here, trial = (
        Place(np.array(start, dtype=float), *np.zeros((4, 1)), np.zeros(1)) for _ in range(2)
    )
    here.cost[0] = ((data - start[0] * np.exp(-start[1] * TIME)) ** 2).sum()
    here.energy[0] = (data**2).sum()
    here.damping[0] = 1e-3
    return trial if fit_decay(problem, here, trial, ending) else here


@pytest.mark.long
@pytest.mark.parametrize('start', [(1.0, 1.0), (10.0, 4.5), (0.1, 0.1)])
@pytest.mark.parametrize(
    ('lower', 'upper'),
    [
        ((0.0, 0.0), (20.0, 5.0)),
        ((0.0, 0.0), (2.0, 5.0)),
        ((0.0, 3.0), (20.0, 5.0)),
        ((4.0, 0.0), (20.0, 0.5)),
    ],
    ids=['free', 'first bound', 'second bound', 'both bounds'],
)
def test_the_optimum_within_bounds_is_that_of_scipy(start, lower, upper):
    noise = 0.05 * np.random.default_rng(4).standard_normal(len(TIME))
    data = 3.0 * np.exp(-1.5 * TIME) + noise
    inside = np.clip(start, np.array(lower) + 1e-3, np.array(upper) - 1e-3)
    here = fitted(data, inside, lower, upper)
    other = least_squares(
        lambda theta: data - theta[0] * np.exp(-theta[1] * TIME),
        inside,
        bounds=(lower, upper),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    # scipy's interior method stops a little inside a bound: 1e-4 of the parameter
    np.testing.assert_allclose(here.theta, other.x, rtol=1e-3)
    assert here.cost[0] <= 2.0 * other.cost * (1.0 + 1e-6)
    assert here.failures[0] == 0.0


def test_no_step_raises_the_cost():
    data = 3.0 * np.exp(-1.5 * TIME)
    before = np.inf
    for steps in range(12):
        here = fitted(data, (20.0, 0.01), (0.0, 0.0), (20.0, 5.0), Ending(steps, 0.0, 0.0))
        assert here.cost[0] <= before
        before = here.cost[0]
    # without noise the optimum is the truth, up to rounding of the cost
    np.testing.assert_allclose(here.theta, (3.0, 1.5), rtol=1e-6)


def test_a_matrix_that_is_not_positive_is_counted_and_damped():
    here = fitted(np.zeros(len(TIME)), (0.0, 1.0), (-1.0, 0.0), (1.0, 5.0))
    # at amplitude 0 the rate has no effect: its column is zero, at every damping
    assert here.failures[0] == ENDING.steps
    assert here.damping[0] == 1e6
    np.testing.assert_array_equal(here.theta, (0.0, 1.0))


def test_parameters_that_are_free_make_up_for_those_that_are_held():
    hessian = np.array([[2.0, 1.0], [1.0, 2.0]])
    gradient = np.array([4.0, 0.0])
    change = np.zeros(2)
    assert bounded_step(hessian, gradient, 0.0, np.array([-1.0, -9.0]), np.ones(2), change)
    # unbounded it is (8/3, -4/3); with the first held at 1 the second one is -1/2
    np.testing.assert_allclose(change, (1.0, -0.5))


squares = st.integers(1, 5).flatmap(
    lambda n: arrays(np.float64, (n, n), elements=st.floats(-9, 9))
)


@given(squares)
def test_solve(square):
    matrix = square @ square.T + np.eye(len(square))
    vector = np.arange(1.0, len(square) + 1)
    solution = vector.copy()
    assert solve_positive(matrix.copy(), solution)
    # condition number up to 5 * 5 * 81: 2000 epsilon and some
    np.testing.assert_allclose(matrix @ solution, vector, atol=1e-10)


@pytest.mark.parametrize('diagonal', [[1.0, -1.0], [0.0, 1.0], [float('nan'), 1.0]])
def test_what_is_not_positive_gives_no_step(diagonal):
    vector = np.ones(2)
    assert not solve_positive(np.diag(diagonal), vector)
    np.testing.assert_array_equal(vector, 0.0)


@given(squares)
def test_condition_number(square):
    matrix = square + square.T + 0.5 * np.eye(len(square))
    singular = np.linalg.svd(matrix, compute_uv=False)
    before = matrix.copy()
    found = condition_number(matrix)
    if singular[0] < 1e6 * singular[-1]:
        # the smallest singular value is known to epsilon times the largest: 1e-16 * 1e6
        assert found == pytest.approx(singular[0] / singular[-1], rel=1e-8)
    else:
        assert found > 0.9e6
    np.testing.assert_array_equal(matrix, before)


def test_singular_matrices_have_an_infinite_one():
    assert condition_number(np.diag([1.0, 0.0])) == np.inf
    assert condition_number(np.diag([1.0, np.nan])) == np.inf
