# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Steps of variable projection: the linear unknowns by Cholesky, the others by Gauss-Newton.

For given theta the linear unknowns ``l = [w, b]`` follow from ``(M + C)_ll l = r`` (Eq. 22), where
M, r come from the blocks and C is a ridge.  Inserting l leaves a cost of theta alone, whose
Gauss-Newton matrix in Kaufman's form is the Schur complement

.. math:: H = M_{\theta\theta} - M_{\theta l} M_{ll}^{-1} M_{l \theta}, \qquad
          g = \Psi^T (y - \Phi w - B b).

`rpms_ros.identification.model.levenberg_marquardt` takes its steps with them.  The neglected term
of the full Golub-Pereyra derivative is of second order in the residual, which is small here; the
gradient g is exact either way.

Normal equations are used instead of a QR factorisation: the regressors of the orthonormal Laguerre
functions have a condition number below 1e4 (1e8 squared), so eight digits are left, and blocks can
be added to and removed from a sum, but not from a QR factorisation.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.estimation.blocks import COUNT, FORCE, RESPONSE_ONE, TIME
from rpms_ros.identification.estimation.normal_equations import (
    advance_state,
    correlate,
    gradient_pass,
    hat,
    knot_of,
    linear_pass,
)
from rpms_ros.identification.estimation.settings import PARAMETERS, Prior, Problem
from rpms_ros.identification.model.levenberg_marquardt import (
    Ending,
    factorise_positive,
    minimiser,
    solve_factorised,
    solve_positive,
)
from rpms_ros.muscle.recruitment import arctan_recruitment
from rpms_ros.pulses import FloatArray

# The variance of the residuals is estimated with a prior value, this share of the mean square of
# the force [1], of the weight of so many samples: few residuals determine it poorly.
_MODEL_ERROR = 1e-4
_MODEL_ERROR_SAMPLES = 200.0
LEAST_ENERGY = 1e-18


class Fit(NamedTuple):
    """Parameters of a fit, and its equations at these parameters.

    Attributes
    ----------
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr.
    linear : ndarray (functions,)
        w.
    levels : ndarray (knots,)
        b [N].
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Sums from the blocks, lower triangle.
    complete : ndarray (unknowns, unknowns)
        The newest matrix with the rows of theta.
    cost, squares : ndarray (1,)
        Cost including the prior, and sum of squared residuals alone [N^2].
    samples, energy : ndarray (1,)
        Number of samples in the blocks, and sum of the squared force [N^2].
    variance : ndarray (1,)
        Variance of the residuals, the weight of the prior [N^2].
    damping, moved : ndarray (1,)
        Of the next step, and largest change of the last one.
    failures : ndarray (1,)
        How many matrices could not be factorised.
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray
    matrix: FloatArray
    right: FloatArray
    complete: FloatArray
    cost: FloatArray
    squares: FloatArray
    samples: FloatArray
    energy: FloatArray
    variance: FloatArray
    damping: FloatArray
    moved: FloatArray
    failures: FloatArray


def empty_fit(theta: FloatArray, functions: int, knots: int) -> Fit:
    """Return a fit without data."""
    unknowns = PARAMETERS + functions + knots
    return Fit(
        theta=theta.copy(),
        linear=np.zeros(functions),
        levels=np.zeros(knots),
        matrix=np.zeros((unknowns, unknowns)),
        right=np.zeros(unknowns),
        complete=np.zeros((unknowns, unknowns)),
        cost=np.zeros(1),
        squares=np.zeros(1),
        samples=np.zeros(1),
        energy=np.zeros(1),
        variance=np.zeros(1),
        damping=np.full(1, 1e-3),
        moved=np.zeros(1),
        failures=np.zeros(1),
    )


@numba.njit(cache=True)
def coordinate(theta: FloatArray, place: int) -> float:
    """Return a parameter in the coordinate of the steps: alpha as its logarithm."""
    if place >= 2:
        return math.log(theta[place])
    value: float = theta[place]
    return value


@numba.njit(cache=True)
def weak_ridge(fit: Fit) -> float:
    """Return a ridge that keeps w and b solvable, too weak to change estimates noticeably."""
    power = fit.energy[0] / max(fit.samples[0], 1.0) + LEAST_ENERGY
    # The variance exceeds the power only if it is from before a gap.
    value: float = 1e-2 * fit.variance[0] / max(power, fit.variance[0])
    return value


@numba.njit(cache=True)
def _linear_matrix(fit: Fit) -> FloatArray:
    """Return the matrix of w and b, ridge included, of which the lower triangle is valid."""
    matrix = fit.matrix[PARAMETERS:, PARAMETERS:].copy()
    ridge = weak_ridge(fit)
    for row in range(len(matrix)):
        matrix[row, row] += ridge
    return matrix


@numba.njit(cache=True)
def _known_cost(fit: Fit, prior: Prior) -> float:
    """Return ridge and prior at the parameters of the fit."""
    cost = 0.0
    ridge = weak_ridge(fit)
    for value in fit.linear:
        cost += ridge * value * value
    for value in fit.levels:
        cost += ridge * value * value
    for place in range(PARAMETERS):
        distance = (coordinate(fit.theta, place) - prior.mean[place]) / prior.deviation[place]
        cost += fit.variance[0] * distance * distance
    return cost


@numba.njit(cache=True)
def _squares(fit: Fit) -> float:
    """Return the sum of squared residuals at the fit's w and b."""
    linear = np.concatenate((fit.linear, fit.levels))
    total = fit.energy[0]
    for row in range(len(linear)):
        at = PARAMETERS + row
        inner = 0.5 * fit.matrix[at, at] * linear[row]
        for column in range(row):
            inner += fit.matrix[at, PARAMETERS + column] * linear[column]
        total += 2.0 * linear[row] * (inner - fit.right[at])
    value: float = total
    return value


@numba.njit(cache=True)
def _solve_linear(fit: Fit) -> None:
    """Solve for w and b at ``fit.theta``; if that fails they stay, and the failure is counted."""
    functions = len(fit.linear)
    right = fit.right[PARAMETERS:].copy()
    if not solve_positive(_linear_matrix(fit), right):
        fit.failures[0] += 1.0
        return
    fit.linear[:] = right[:functions]
    fit.levels[:] = right[functions:]


@numba.njit(cache=True)
def fit_linear(problem: Problem, fit: Fit, refresh: bool) -> None:
    """Solve the linear unknowns at ``fit.theta``; with `refresh`, update the variance too.

    The variance is the weight of the prior; it stays while two parameter sets are compared.
    """
    samples, energy = linear_pass(
        problem, problem.blocks.size[0], fit.theta, fit.matrix, fit.right
    )
    fit.samples[0] = samples
    fit.energy[0] = energy
    power = energy / max(samples, 1.0) + LEAST_ENERGY
    if refresh and fit.variance[0] == 0.0:
        fit.variance[0] = 0.01 * power
    _solve_linear(fit)
    squares = _squares(fit)
    fit.squares[0] = max(squares, 0.0)
    if refresh:
        doubt = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
        fit.variance[0] = (fit.squares[0] + doubt) / (samples + _MODEL_ERROR_SAMPLES)
    fit.cost[0] = squares + _known_cost(fit, problem.prior)


@numba.njit(cache=True)
def room_for_steps(theta: FloatArray, prior: Prior, low: FloatArray, high: FloatArray) -> None:
    """Write the least and greatest steps of the coordinates (4,) within the bounds."""
    for place in range(PARAMETERS):
        here = coordinate(theta, place)
        low[place] = coordinate(prior.lower, place) - here
        high[place] = coordinate(prior.upper, place) - here


@numba.njit(cache=True)
def move_theta(theta: FloatArray, prior: Prior, step: FloatArray, moved: FloatArray) -> float:
    """Write theta (4,) after a step (4,); u_thr and u_sat keep their least distance.

    `step` becomes what was gone.  Returns its largest component.
    """
    for place in range(PARAMETERS):
        value = coordinate(theta, place) + step[place]
        value = math.exp(value) if place >= 2 else value
        moved[place] = min(max(value, prior.lower[place]), prior.upper[place])
    lacking = prior.separation - (moved[1] - moved[0])
    if lacking > 0.0:
        moved[0] = max(moved[0] - 0.5 * lacking, prior.lower[0])
        moved[1] = moved[0] + prior.separation
    largest = 0.0
    for place in range(PARAMETERS):
        step[place] = coordinate(moved, place) - coordinate(theta, place)
        largest = max(largest, abs(step[place]))
    return largest


@numba.njit(cache=True)
def _theta_gradient(fit: Fit, prior: Prior, gradient: FloatArray) -> None:
    """Write minus half the gradient of the cost by theta (4,)."""
    functions = len(fit.linear)
    for place in range(PARAMETERS):
        total = fit.right[place]
        for row in range(functions):
            total -= fit.matrix[PARAMETERS + row, place] * fit.linear[row]
        for row in range(len(fit.levels)):
            total -= fit.matrix[PARAMETERS + functions + row, place] * fit.levels[row]
        distance = coordinate(fit.theta, place) - prior.mean[place]
        gradient[place] = total - fit.variance[0] * distance / prior.deviation[place] ** 2


@numba.njit(cache=True)
def _reduced_hessian(fit: Fit, prior: Prior, hessian: FloatArray) -> bool:
    """Write the Schur complement of theta (4, 4); return whether the rest is positive."""
    columns = fit.matrix[PARAMETERS:, :PARAMETERS].T.copy()
    factor = _linear_matrix(fit)
    if not factorise_positive(factor):
        return False
    for place in range(PARAMETERS):
        solved = columns[place].copy()
        solve_factorised(factor, solved)
        for other in range(place, PARAMETERS):
            entry = fit.matrix[other, place]
            if other == place:
                entry += fit.variance[0] / prior.deviation[place] ** 2
            for row in range(len(solved)):
                entry -= columns[other, row] * solved[row]
            hessian[other, place] = entry
            hessian[place, other] = entry
    return True


@register_jitable
def room(problem: Problem, fit: Fit, low: FloatArray, high: FloatArray) -> None:
    """Write the least and greatest steps of theta, see `room_for_steps`."""
    room_for_steps(fit.theta, problem.prior, low, high)


@register_jitable
def _move(problem: Problem, fit: Fit, step: FloatArray, trial: Fit) -> None:
    """Take a step (4,), keep u_thr below u_sat, and solve the linear unknowns there."""
    move_theta(fit.theta, problem.prior, step, trial.theta)
    trial.variance[0] = fit.variance[0]
    trial.failures[0] = 0.0
    fit_linear(problem, trial, False)
    fit.failures[0] += trial.failures[0]


@register_jitable
def accept(fit: Fit, trial: Fit) -> None:
    """Copy parameters, equations, cost and variance of a trial; damping and counters stay."""
    fit.theta[:] = trial.theta
    fit.linear[:] = trial.linear
    fit.levels[:] = trial.levels
    fit.matrix[:] = trial.matrix
    fit.right[:] = trial.right
    fit.cost[0] = trial.cost[0]
    fit.squares[0] = trial.squares[0]
    fit.samples[0] = trial.samples[0]
    fit.energy[0] = trial.energy[0]
    fit.variance[0] = trial.variance[0]


@numba.njit(cache=True)
def complete(problem: Problem, fit: Fit) -> None:
    """Add the rows of theta to the equations of a fit whose linear part is solved."""
    gradient_pass(problem, problem.blocks.size[0], fit.theta, fit.linear, fit.matrix, fit.right)
    fit.complete[:] = fit.matrix


@register_jitable
def _linearise(
    problem: Problem, fit: Fit, ready: bool, hessian: FloatArray, gradient: FloatArray
) -> bool:
    """Write the cost's quadratic model in theta; return whether there is one."""
    if not ready:
        complete(problem, fit)
    _theta_gradient(fit, problem.prior, gradient)
    return _reduced_hessian(fit, problem.prior, hessian)


_minimise = minimiser(_linearise, room, _move, accept)


def improve(problem: Problem, fit: Fit, trial: Fit, steps: int, tolerance: float) -> None:
    """Take up to so many Levenberg-Marquardt steps from `fit`, whose linear part is solved.

    `trial` is scratch of the same shape.
    """
    if fit.samples[0] > 0.0:
        _minimise(problem, fit, trial, Ending(steps, tolerance, LEAST_ENERGY), False)


@numba.njit(cache=True)
def complete_equations(problem: Problem, fit: Fit) -> None:
    """Solve the linear part of `fit` and fill in all its equations."""
    fit_linear(problem, fit, False)
    complete(problem, fit)


@numba.njit(cache=True)
def residual_sums(problem: Problem, last: int, fit: Fit, sums: FloatArray) -> None:
    """Write the sum of the residuals of blocks first..last-1 into `sums` (last - first,) [N]."""
    blocks, first, baseline, work = problem.blocks, problem.first, problem.baseline, problem.work
    theta, linear, levels, input_gain = fit.theta, fit.linear, fit.levels, problem.input_gain
    state = work.state[0]
    state[:] = 0.0
    origin = arctan_recruitment(0.0, theta)
    values = work.correlated[0]
    for index in range(last):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], state)
        rho = arctan_recruitment(blocks.intensity[here], theta) - origin
        state += input_gain * blocks.weight[here] * rho
        if index < first:
            continue
        moments = blocks.moments[here]
        correlate(linear, state, values)
        total = moments[FORCE]
        for shift in range(len(linear)):
            total -= values[shift] * blocks.response[here, shift, RESPONSE_ONE]
        knot, position = knot_of(blocks.start_ns[here], baseline)
        for offset in range(min(baseline.knots, 2)):
            value, slope = hat(offset, position, baseline)
            total -= levels[knot + offset] * (value * moments[COUNT] + slope * moments[TIME])
        sums[index - first] = total
