r"""Steps of variable projection: the linear unknowns by Cholesky, the others by Gauss-Newton.

For given theta the linear unknowns ``l = [w, b]`` follow from ``(M + C)_ll l = r`` (Eq. 22), where
M, r come from the blocks and C holds what is known besides them: a ridge, and what blocks that
have left the horizon had said.  Putting l back leaves a cost of theta alone, whose Gauss-Newton
matrix in Kaufman's form is the Schur complement

.. math:: H = M_{\theta\theta} - M_{\theta l} M_{ll}^{-1} M_{l \theta}, \qquad
          g = \Psi^T (y - \Phi w - B b).

``(H + mu diag H) d = g`` is the Levenberg-Marquardt step, held within bounds by fixing what
would leave them and solving again for the rest.  The neglected term of the full
Golub-Pereyra derivative is of second order in the residual, which is small here; the gradient g
is exact either way.

Normal equations are formed, not a QR factorisation: the Laguerre functions are orthonormal and
their regressors stay below a condition number of 1e4 (1e8 squared), so eight digits are left, and
a sum over blocks can be kept, added to and taken apart, which rows of a QR cannot.
"""

import math

import numba
import numpy as np

from rpms_ros.identification.projection.fit import LEAST_ENERGY
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import away_from_reference
from rpms_ros.identification.projection.fit import coordinate
from rpms_ros.identification.projection.fit import fit_linear
from rpms_ros.identification.projection.fit import linear_matrix
from rpms_ros.identification.projection.normal_equations import gradient_pass
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.small_matrix import factorise_positive
from rpms_ros.identification.small_matrix import solve_factorised
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray

LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e6
# Differences of cost below this share of sum y^2 are rounding.
_ROUNDING = 1e-13


@numba.njit(cache=True)
def theta_gradient(fit: Fit, prior: Prior, gradient: FloatArray) -> None:
    """Write minus half the gradient of the cost by theta (4,)."""
    functions = len(fit.linear)
    away = away_from_reference(fit, prior)
    for place in range(PARAMETERS):
        total = fit.right[place] + prior.information_vector[place]
        for row in range(functions):
            total -= fit.matrix[PARAMETERS + row, place] * fit.linear[row]
        for row in range(len(fit.levels)):
            total -= fit.matrix[PARAMETERS + functions + row, place] * fit.levels[row]
        for other in range(len(away)):
            total -= prior.information[place, other] * away[other]
        distance = coordinate(fit.theta, place) - prior.mean[place]
        gradient[place] = total - fit.variance[0] * distance / prior.deviation[place] ** 2


@numba.njit(cache=True)
def _reduced_hessian(fit: Fit, prior: Prior, hessian: FloatArray) -> bool:
    """Write the Schur complement of theta (4, 4); return whether the rest is positive."""
    functions = len(fit.linear)
    columns = fit.matrix[PARAMETERS:, :PARAMETERS].T.copy()
    columns[:, :functions] += prior.information[:PARAMETERS, PARAMETERS:]
    factor = linear_matrix(fit, prior)
    if not factorise_positive(factor):
        return False
    for place in range(PARAMETERS):
        solved = columns[place].copy()
        solve_factorised(factor, solved)
        for other in range(place, PARAMETERS):
            entry = fit.matrix[other, place] + prior.information[other, place]
            if other == place:
                entry += fit.variance[0] / prior.deviation[place] ** 2
            for row in range(len(solved)):
                entry -= columns[other, row] * solved[row]
            hessian[other, place] = entry
            hessian[place, other] = entry
    return True


@numba.njit(cache=True)
def _damped_step(
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
    held: BoolArray,
    step: FloatArray,
) -> bool:
    """Solve for the steps (4,) that are not held, given those that are; return success."""
    matrix = hessian.copy()
    right = gradient.copy()
    for place in range(PARAMETERS):
        matrix[place, place] *= 1.0 + damping
        for other in range(PARAMETERS):
            if held[other] and not held[place]:
                right[place] -= hessian[place, other] * step[other]
    for place in range(PARAMETERS):
        if held[place]:
            matrix[place] = 0.0
            matrix[:, place] = 0.0
            matrix[place, place] = 1.0
            right[place] = step[place]
    solved = solve_positive(matrix, right)
    step[:] = right
    return solved


@numba.njit(cache=True)
def _part(prior: Prior, candidate: FloatArray) -> None:
    """Keep u_sat above u_thr, about where both would be."""
    lacking = prior.separation - (candidate[1] - candidate[0])
    if lacking > 0.0:
        candidate[0] = max(candidate[0] - 0.5 * lacking, prior.lower[0])
        candidate[1] = candidate[0] + prior.separation


@numba.njit(cache=True)
def _bounded_step(
    theta: FloatArray,
    prior: Prior,
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
    candidate: FloatArray,
) -> bool:
    """Write theta after a damped step (4,) within the bounds; return whether there is one."""
    step = np.zeros(PARAMETERS)
    held = np.zeros(PARAMETERS, dtype=np.bool_)
    for _ in range(PARAMETERS):
        if not _damped_step(hessian, gradient, damping, held, step):
            return False
        left = False
        for place in range(PARAMETERS):
            here = coordinate(theta, place)
            low = coordinate(prior.lower, place) - here
            high = coordinate(prior.upper, place) - here
            if not held[place] and not low <= step[place] <= high:
                step[place] = low if step[place] < low else high
                held[place] = True
                left = True
        if not left:
            break
    for place in range(PARAMETERS):
        value = coordinate(theta, place) + step[place]
        candidate[place] = math.exp(value) if place >= 2 else value
        candidate[place] = min(max(candidate[place], prior.lower[place]), prior.upper[place])
    _part(prior, candidate)
    return True


@numba.njit(cache=True)
def _promise(
    fit: Fit, theta: FloatArray, hessian: FloatArray, gradient: FloatArray
) -> tuple[float, float]:
    """Return the reduction that the quadratic model promises for theta, and the largest step."""
    step = np.empty(PARAMETERS)
    for place in range(PARAMETERS):
        step[place] = coordinate(theta, place) - coordinate(fit.theta, place)
    promised = 0.0
    for place in range(PARAMETERS):
        promised += 2.0 * gradient[place] * step[place]
        for other in range(PARAMETERS):
            promised -= step[place] * hessian[place, other] * step[other]
    return promised, np.abs(step).max()


@numba.njit(cache=True)
def _accept(fit: Fit, trial: Fit, size: float, good: bool) -> None:
    """Go where the trial is."""
    damping = fit.damping[0]
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
    fit.damping[0] = max(damping * (0.1 if good else 1.0), LEAST_DAMPING)
    fit.moved[0] = size


@numba.njit(cache=True)
def complete(problem: Problem, fit: Fit) -> None:
    """Make matrix and right-hand side complete at parameters whose linear part is solved."""
    gradient_pass(problem, problem.blocks.size[0], fit.theta, fit.linear, fit.matrix, fit.right)
    fit.complete[:] = fit.matrix


@numba.njit(cache=True)
def improve(
    problem: Problem, fit: Fit, trial: Fit, steps: int, tolerance: float, ready: bool
) -> None:
    """Take up to so many Levenberg-Marquardt steps from `fit`, whose linear part is solved.

    A step that does not lower the cost is not taken; damping rises and the next one is shorter.
    So is one whose matrix cannot be factorised, which is counted.
    Ends early when the reduction that a step promises falls below `tolerance` times the cost.
    `trial` is scratch of the same shape; `ready` says that the equations are complete already.
    """
    prior = problem.prior
    hessian = np.zeros((PARAMETERS, PARAMETERS))
    gradient = np.zeros(PARAMETERS)
    fresh = False
    if fit.samples[0] == 0.0:
        return
    for _ in range(steps):
        if not fresh:
            if not ready:
                complete(problem, fit)
            ready = False
            theta_gradient(fit, prior, gradient)
            if not _reduced_hessian(fit, prior, hessian):
                fit.failures[0] += 1.0
                return
            fresh = True
        damping = fit.damping[0]
        if not _bounded_step(fit.theta, prior, hessian, gradient, damping, trial.theta):
            fit.failures[0] += 1.0
            fit.damping[0] = min(max(10.0 * damping, 1e-6), MOST_DAMPING)
            continue
        promised, size = _promise(fit, trial.theta, hessian, gradient)
        trial.variance[0] = fit.variance[0]
        trial.failures[0] = 0.0
        fit_linear(problem, trial, False)
        fit.failures[0] += trial.failures[0]
        actual = fit.cost[0] - trial.cost[0]
        if actual >= -_ROUNDING * fit.energy[0]:
            _accept(fit, trial, size, actual > 0.5 * promised)
            fresh = False
        else:
            fit.damping[0] = min(max(10.0 * fit.damping[0], 1e-6), MOST_DAMPING)
        if promised <= tolerance * (fit.cost[0] + LEAST_ENERGY):
            break


@numba.njit(cache=True)
def complete_equations(problem: Problem, fit: Fit) -> None:
    """Make matrix and right-hand side of `fit` complete at its parameters, theta included."""
    fit_linear(problem, fit, False)
    complete(problem, fit)
