# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Arrival cost: the blocks that have left the horizon, as a quadratic cost of [theta, w].

``(z - z_0)^T L (z - z_0) / 2 - p^T (z - z_0)``: a leaving block adds its Gauss-Newton matrix to L
and its gradient to p, both at the present parameters.

Old information is to be replaced by new, but only where there is new information.  With
M = L + (information of the horizon) it is forgotten in proportion to the new information,

.. math:: L \leftarrow L - a\,(L - L M^{-1} L), \qquad p \leftarrow p - a\,(p - L M^{-1} p).

``L - L M^{-1} L`` is the parallel sum of old and new information: about L in directions that the
horizon informs, zero in those it does not.  So a rest, a constant intensity or one below the
threshold erases nothing, and L does not grow without bound.

Both describe the same muscle only while it does not change.  So they are compared before each
step: with v the slope of the arrival cost at the joint optimum and H the information of the
horizon, baseline eliminated and prior included,

.. math:: T = v^T (H^{-1} + L^{-1}) v / s^2

is the squared difference of the two estimates in units of its covariance, chi-square with as many
degrees of freedom as there are unknowns.  If T is above `disagreement_limit`, process noise is
added along the difference ``L^{-1} v``, so much that T becomes one,

.. math:: L \leftarrow L - (1 - 1/T)\, v v^T / (v^T L^{-1} v),

and everything of which the horizon informs is forgotten: blocks that left since the change were
linearised at parameters between the old and the new ones.
"""

import numba
import numpy as np
from scipy.special import chdtri

from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import away_from_reference
from rpms_ros.identification.projection.fit import coordinate
from rpms_ros.identification.projection.fit import weak_ridge
from rpms_ros.identification.projection.normal_equations import gradient_pass
from rpms_ros.identification.projection.normal_equations import linear_pass
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.small_matrix import dot
from rpms_ros.identification.small_matrix import factorise_positive
from rpms_ros.identification.small_matrix import solve_factorised
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import FloatArray

# Probability of a false alarm in one comparison if the muscle does not change.
_FALSE_ALARM = 1e-4


def disagreement_limit(unknowns: int) -> float:
    """Return the value of the statistic above which arrival cost and horizon contradict."""
    return float(chdtri(unknowns, _FALSE_ALARM))


@numba.njit(cache=True)
def _recentre(prior: Prior, fit: Fit) -> None:
    """Expand the cost about the present parameters."""
    for place in range(len(prior.reference)):
        here = (
            coordinate(fit.theta, place) if place < PARAMETERS else fit.linear[place - PARAMETERS]
        )
        step = here - prior.reference[place]
        for row in range(len(prior.reference)):
            prior.information_vector[row] -= prior.information[row, place] * step
        prior.reference[place] = here


@numba.njit(cache=True)
def marginalize(problem: Problem, last: int, fit: Fit, scratch: Fit) -> None:
    """Add the blocks before `last`, linearised at the parameters of `fit`, to the prior."""
    prior = problem.prior
    _recentre(prior, fit)
    linear_pass(problem, last, fit.theta, scratch.matrix, scratch.right)
    gradient_pass(problem, last, fit.theta, fit.linear, scratch.matrix, scratch.right)
    functions = len(fit.linear)
    matrix = scratch.matrix
    for row in range(PARAMETERS + functions):
        total = scratch.right[row]
        for function in range(functions):
            column = PARAMETERS + function
            entry = matrix[row, column] if row >= column else matrix[column, row]
            total -= entry * fit.linear[function]
        for knot in range(len(fit.levels)):
            total -= matrix[PARAMETERS + functions + knot, row] * fit.levels[knot]
        prior.information_vector[row] += total
        for column in range(row + 1):
            prior.information[row, column] += matrix[row, column]
            if column < row:
                prior.information[column, row] += matrix[row, column]


@numba.njit(cache=True)
def _total(prior: Prior, fit: Fit) -> FloatArray:
    """Return the lower triangle of M with a small ridge."""
    count = len(prior.reference)
    total = fit.complete[:count, :count] + prior.information
    size = 0.0
    for row in range(count):
        size = max(size, total[row, row])
    for row in range(count):
        total[row, row] += 1e-12 * size + fit.variance[0]
    return total


@numba.njit(cache=True)
def forget(prior: Prior, fit: Fit, share: float) -> None:
    """Forget `share` of the arrival cost in the directions of which the blocks inform."""
    count = len(prior.reference)
    information = prior.information
    total = _total(prior, fit)
    if not factorise_positive(total):
        fit.failures[0] += 1.0
        return
    kept = np.empty((count, count))
    for column in range(count):
        solved = information[column].copy()
        solve_factorised(total, solved)
        for row in range(count):
            kept[row, column] = dot(information[row], solved)
    solved = prior.information_vector.copy()
    solve_factorised(total, solved)
    for row in range(count):
        prior.information_vector[row] += share * (
            dot(information[row], solved) - prior.information_vector[row]
        )
    for row in range(count):
        for column in range(row + 1):
            value = 0.5 * (kept[row, column] + kept[column, row])
            value = information[row, column] + share * (value - information[row, column])
            information[row, column] = value
            information[column, row] = value


@numba.njit(cache=True)
def _add_prior(prior: Prior, fit: Fit, matrix: FloatArray) -> None:
    """Add prior and ridge to the diagonal of an information matrix."""
    ridge = weak_ridge(fit)
    for row in range(len(matrix)):
        if row < PARAMETERS:
            matrix[row, row] += fit.variance[0] / prior.deviation[row] ** 2
        else:
            matrix[row, row] += ridge


@numba.njit(cache=True)
def _slope_at_optimum(prior: Prior, fit: Fit, gradient: FloatArray) -> FloatArray:
    """Return minus the gradient of the arrival cost at the optimum of both costs together."""
    count = len(prior.reference)
    both = fit.complete.copy()
    _add_prior(prior, fit, both)
    both[:count, :count] += prior.information
    step = np.zeros(len(both))
    # The linear unknowns are solved: the joint cost has a slope by theta only.
    step[:PARAMETERS] = gradient
    if not solve_positive(both, step):
        fit.failures[0] += 1.0
    away = away_from_reference(fit, prior) + step[:count]
    slope = prior.information_vector.copy()
    for row in range(count):
        slope[row] -= dot(prior.information[row], away)
    return slope


@numba.njit(cache=True)
def reduce_contradiction(prior: Prior, fit: Fit, gradient: FloatArray, limit: float) -> float:
    """Reduce the arrival cost where it contradicts the horizon; return the statistic T.

    Parameters
    ----------
    prior : Prior
        The arrival cost, changed if T is above the limit.
    fit : Fit
        Fit with complete equations and solved linear unknowns.
    gradient : ndarray (4,)
        Minus half the gradient of the joint cost by theta.
    limit : float
        See `disagreement_limit`.
    """
    count = len(prior.reference)
    slope = _slope_at_optimum(prior, fit, gradient)
    own = fit.complete.copy()
    _add_prior(prior, fit, own)
    by_horizon = np.zeros(len(own))
    by_horizon[:count] = slope
    memory = prior.information.copy()
    _add_prior(prior, fit, memory)
    difference = slope.copy()
    if not (solve_positive(own, by_horizon) and solve_positive(memory, difference)):
        fit.failures[0] += 1.0
        return 0.0
    statistic: float = dot(slope, by_horizon[:count]) + dot(slope, difference)
    statistic /= fit.variance[0]
    if not statistic > limit:
        return statistic
    _recentre(prior, fit)
    held = np.empty(count)
    for row in range(count):
        held[row] = dot(prior.information[row], difference)
    share = (1.0 - 1.0 / statistic) / dot(difference, held)
    along = share * dot(difference, prior.information_vector)
    for row in range(count):
        prior.information_vector[row] -= held[row] * along
        for column in range(count):
            prior.information[row, column] -= share * held[row] * held[column]
    forget(prior, fit, 1.0)
    return statistic
