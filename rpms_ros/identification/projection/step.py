# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Steps of variable projection: the linear unknowns by Cholesky, the others by Gauss-Newton.

For given theta the linear unknowns ``l = [w, b]`` follow from ``(M + C)_ll l = r`` (Eq. 22), where
M, r come from the blocks and C is a ridge and the arrival cost.  Inserting l leaves a cost of
theta alone, whose Gauss-Newton matrix in Kaufman's form is the Schur complement

.. math:: H = M_{\theta\theta} - M_{\theta l} M_{ll}^{-1} M_{l \theta}, \qquad
          g = \Psi^T (y - \Phi w - B b).

`rpms_ros.identification.levenberg_marquardt` takes its steps with them.  The neglected term
of the full Golub-Pereyra derivative is of second order in the residual, which is small here; the
gradient g is exact either way.

Normal equations are used instead of a QR factorisation: the regressors of the orthonormal Laguerre
functions have a condition number below 1e4 (1e8 squared), so eight digits are left, and blocks can
be added to and removed from a sum, but not from a QR factorisation.
"""

import numba
from numba.extending import register_jitable

from rpms_ros.identification.levenberg_marquardt import Ending
from rpms_ros.identification.levenberg_marquardt import minimiser
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
from rpms_ros.identification.projection.theta_step import move_theta
from rpms_ros.identification.projection.theta_step import room_for_steps
from rpms_ros.identification.small_matrix import factorise_positive
from rpms_ros.identification.small_matrix import solve_factorised
from rpms_ros.pulses import FloatArray


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


@register_jitable
def _room(problem: Problem, fit: Fit, low: FloatArray, high: FloatArray) -> None:
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
def _accept(fit: Fit, trial: Fit) -> None:
    """Copy the trial into the fit."""
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
    theta_gradient(fit, problem.prior, gradient)
    return _reduced_hessian(fit, problem.prior, hessian)


_minimise = minimiser(_linearise, _room, _move, _accept)


def improve(
    problem: Problem, fit: Fit, trial: Fit, steps: int, tolerance: float, ready: bool
) -> None:
    """Take up to so many Levenberg-Marquardt steps from `fit`, whose linear part is solved.

    `trial` is scratch of the same shape; `ready`: the equations are complete already.
    """
    if fit.samples[0] > 0.0:
        _minimise(problem, fit, trial, Ending(steps, tolerance, LEAST_ENERGY), ready)


@numba.njit(cache=True)
def complete_equations(problem: Problem, fit: Fit) -> None:
    """Solve the linear part of `fit` and fill in all its equations."""
    fit_linear(problem, fit, False)
    complete(problem, fit)
