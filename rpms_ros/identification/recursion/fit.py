# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Parameters from the memory of the recursion: one Levenberg-Marquardt step a pulse.

At parameters theta the linear unknowns ``l = [w, b]`` follow from the sums in `memory`, Eq. (22).
Inserting them leaves a cost of theta alone; with ``x_j = d(model)/d theta_j`` its Gauss-Newton
matrix is the Schur complement ``H = M_tt - M_tl M_ll^-1 M_lt`` (Kaufman's variable projection),
its gradient ``X^T (y - model)``.  ``(H + delta diag H) d = g`` is the step.

The cost of a trial is exact, since the sums are valid for any parameters, so the gain ratio (28)
is that of all samples: delta falls if it is good, rises if it is bad, and a step that raises the
cost is not taken.  No schedule of delta and no rule about condition numbers is needed; a weak
prior with the variance of the residuals as weight keeps H positive.
"""

import numba
import numpy as np

from rpms_ros.identification.estimation.gauss_newton import (
    LEAST_ENERGY,
    Fit,
    coordinate,
    move_theta,
    room_for_steps,
)
from rpms_ros.identification.estimation.settings import PARAMETERS, Prior
from rpms_ros.identification.model.levenberg_marquardt import bounded_step, dot, solve_positive
from rpms_ros.identification.recursion.sums import Memory, recruitment_at_knots
from rpms_ros.pulses import FloatArray

# The variance of the residuals is estimated with a prior value, this share of the mean square of
# the force [1], of the weight of so many samples: few residuals determine it poorly.
_MODEL_ERROR = 1e-4
_MODEL_ERROR_SAMPLES = 200.0
# Differences of cost below this share of sum y^2 are rounding.
_ROUNDING = 1e-13
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e6


@numba.njit(cache=True)
def equations(memory: Memory, fit: Fit) -> None:
    """Write matrix (full) and right-hand side of [theta, w, b] at the parameters of `fit`."""
    gram, cross = memory.gram, memory.cross
    knots, functions = memory.chains.shape
    last = len(cross) - 1
    matrix, right = fit.matrix, fit.right
    values = np.empty((1 + PARAMETERS, knots))
    recruitment_at_knots(fit.theta, values)
    # G times rho in every function, and times the derivatives in the direction of w.
    count = functions + PARAMETERS
    directions = np.zeros((count, last))
    for knot in range(knots):
        for function in range(functions):
            at = knot * functions + function
            directions[PARAMETERS + function, at] = values[0, knot]
            for place in range(PARAMETERS):
                directions[place, at] = values[1 + place, knot] * fit.linear[function]
    applied = np.zeros((count, last))
    for row in range(count):
        for at in range(last):
            total = 0.0
            value = directions[row, at]
            for other in range(at):
                total += gram[at, other] * directions[row, other]
                applied[row, other] += gram[at, other] * value
            applied[row, at] += total + gram[at, at] * value
    for row in range(count):
        right[row] = dot(directions[row], cross[:last])
        for column in range(row + 1):
            matrix[row, column] = dot(directions[row], applied[column])
            matrix[column, row] = matrix[row, column]
        matrix[count, row] = dot(directions[row], gram[last, :last])
        matrix[row, count] = matrix[count, row]
    matrix[count, count] = gram[last, last]
    right[count] = cross[last]


@numba.njit(cache=True)
def _ridge(memory: Memory, variance: float) -> float:
    """Return a ridge that keeps w and b solvable, too weak to change estimates noticeably."""
    power = memory.energy[0] / max(memory.samples[0], 1.0) + LEAST_ENERGY
    value: float = 1e-2 * variance / max(power, variance)
    return value


@numba.njit(cache=True)
def solve_linear(memory: Memory, prior: Prior, fit: Fit) -> bool:
    """Solve for w and b at theta, then the cost; return whether the matrix was positive."""
    functions = len(fit.linear)
    matrix = fit.matrix[PARAMETERS:, PARAMETERS:].copy()
    linear = fit.right[PARAMETERS:].copy()
    ridge = _ridge(memory, fit.variance[0])
    for row in range(len(linear)):
        matrix[row, row] += ridge
    if not solve_positive(matrix, linear):
        return False
    fit.linear[:] = linear[:functions]
    fit.levels[:] = linear[functions:]
    squares = memory.energy[0]
    away = 0.0
    for row in range(len(linear)):
        at = PARAMETERS + row
        squares += linear[row] * (dot(fit.matrix[at, PARAMETERS:], linear) - 2.0 * fit.right[at])
        away += ridge * linear[row] * linear[row]
    for place in range(PARAMETERS):
        distance = (coordinate(fit.theta, place) - prior.mean[place]) / prior.deviation[place]
        away += fit.variance[0] * distance * distance
    fit.squares[0] = max(squares, 0.0)
    fit.cost[0] = squares + away
    fit.samples[0] = memory.samples[0]
    fit.energy[0] = memory.energy[0]
    return True


@numba.njit(cache=True)
def evaluate(memory: Memory, prior: Prior, fit: Fit) -> bool:
    """Solve the linear unknowns at theta and make the equations complete there."""
    equations(memory, fit)
    if not solve_linear(memory, prior, fit):
        return False
    # The rows of theta are taken in the direction of the new w.
    equations(memory, fit)
    return True


@numba.njit(cache=True)
def refresh_variance(memory: Memory, prior: Prior, fit: Fit) -> None:
    """Update the variance of the residuals, and with it the weight of the prior."""
    power = fit.energy[0] / max(fit.samples[0], 1.0) + LEAST_ENERGY
    doubt = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
    fit.variance[0] = (fit.squares[0] + doubt) / (fit.samples[0] + _MODEL_ERROR_SAMPLES)
    if not solve_linear(memory, prior, fit):
        fit.failures[0] += 1.0


@numba.njit(cache=True)
def _reduced(
    memory: Memory, prior: Prior, fit: Fit, hessian: FloatArray, slope: FloatArray
) -> bool:
    """Write H (4, 4) and minus half the gradient (4,); return whether there is a factor."""
    matrix = fit.matrix
    linear = np.concatenate((fit.linear, fit.levels))
    ridge = _ridge(memory, fit.variance[0])
    solved = np.empty((PARAMETERS, len(linear)))
    for place in range(PARAMETERS):
        rest = matrix[PARAMETERS:, PARAMETERS:].copy()
        for row in range(len(linear)):
            rest[row, row] += ridge
        solved[place] = matrix[place, PARAMETERS:]
        if not solve_positive(rest, solved[place]):
            return False
    for place in range(PARAMETERS):
        slope[place] = fit.right[place] - dot(matrix[place, PARAMETERS:], linear)
        weight = fit.variance[0] / prior.deviation[place] ** 2
        slope[place] -= weight * (coordinate(fit.theta, place) - prior.mean[place])
        for other in range(PARAMETERS):
            hessian[place, other] = matrix[place, other] - dot(
                matrix[place, PARAMETERS:], solved[other]
            )
        hessian[place, place] += weight
    return True


@numba.njit(cache=True)
def go_to(fit: Fit, other: Fit) -> None:
    """Copy parameters, equations and cost of `other` to `fit`; damping and counters stay."""
    fit.theta[:] = other.theta
    fit.linear[:] = other.linear
    fit.levels[:] = other.levels
    fit.matrix[:] = other.matrix
    fit.right[:] = other.right
    fit.cost[0] = other.cost[0]
    fit.squares[0] = other.squares[0]
    fit.samples[0] = other.samples[0]
    fit.energy[0] = other.energy[0]


@numba.njit(cache=True)
def improve(memory: Memory, prior: Prior, fit: Fit, trial: Fit, steps: int) -> None:
    """Take up to so many steps from `fit`, whose equations are complete.

    A step that raises the cost is not taken, and one whose matrix has no factor is counted.
    """
    hessian = np.zeros((PARAMETERS, PARAMETERS))
    slope, step = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    low, high = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    for _ in range(steps):
        damping = fit.damping[0]
        if not _reduced(memory, prior, fit, hessian, slope):
            fit.failures[0] += 1.0
            return
        room_for_steps(fit.theta, prior, low, high)
        if not bounded_step(hessian, slope, damping, low, high, step):
            fit.failures[0] += 1.0
            fit.damping[0] = min(max(10.0 * damping, 1e-6), MOST_DAMPING)
            continue
        size = move_theta(fit.theta, prior, step, trial.theta)
        trial.variance[0] = fit.variance[0]
        trial.linear[:] = fit.linear
        if not evaluate(memory, prior, trial):
            fit.failures[0] += 1.0
            return
        predicted = 0.0
        for place in range(PARAMETERS):
            predicted += step[place] * (2.0 * slope[place] - dot(hessian[place], step))
        actual = fit.cost[0] - trial.cost[0]
        if actual >= -_ROUNDING * fit.energy[0]:
            go_to(fit, trial)
            good = actual > 0.5 * predicted
            fit.damping[0] = max(damping * (0.1 if good else 1.0), LEAST_DAMPING)
            fit.moved[0] = size
        else:
            fit.damping[0] = min(max(10.0 * damping, 1e-6), MOST_DAMPING)
