# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""State of a fit, its cost, and the solution for the linear unknowns (Eq. 22)."""

import math
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.projection.normal_equations import linear_pass
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.small_matrix import solve_positive
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
def away_from_reference(fit: Fit, prior: Prior) -> FloatArray:
    """Return [theta, w] (4 + functions,) relative to the reference of the arrival cost."""
    away = np.empty(len(prior.reference))
    for place in range(PARAMETERS):
        away[place] = coordinate(fit.theta, place)
    away[PARAMETERS:] = fit.linear
    away -= prior.reference
    return away


@numba.njit(cache=True)
def remembers(prior: Prior) -> bool:
    """Return whether there is an arrival cost."""
    found: bool = prior.information[PARAMETERS, PARAMETERS] > 0.0
    return found


@numba.njit(cache=True)
def linear_matrix(fit: Fit, prior: Prior) -> FloatArray:
    """Return the lower triangle of the matrix of w and b, arrival cost and ridge included."""
    functions = len(fit.linear)
    count = functions + len(fit.levels)
    matrix = np.empty((count, count))
    ridge = weak_ridge(fit)
    for row in range(count):
        for column in range(row + 1):
            matrix[row, column] = fit.matrix[PARAMETERS + row, PARAMETERS + column]
            if row < functions:
                matrix[row, column] += prior.information[PARAMETERS + row, PARAMETERS + column]
        matrix[row, row] += ridge
    return matrix


@numba.njit(cache=True)
def _known_cost(fit: Fit, prior: Prior) -> float:
    """Return arrival cost, ridge and prior at the parameters of the fit."""
    cost = 0.0
    away = away_from_reference(fit, prior)
    for row in range(len(away)):
        cost -= 2.0 * prior.information_vector[row] * away[row]
        for column in range(len(away)):
            cost += away[row] * prior.information[row, column] * away[column]
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
def _solve_linear(fit: Fit, prior: Prior) -> None:
    """Solve for w and b at ``fit.theta``; if that fails they stay, and the failure is counted."""
    functions = len(fit.linear)
    matrix = linear_matrix(fit, prior)
    right = fit.right[PARAMETERS:].copy()
    before = fit.linear.copy()
    fit.linear[:] = 0.0
    away = away_from_reference(fit, prior)
    fit.linear[:] = before
    for row in range(functions):
        at = PARAMETERS + row
        right[row] += prior.information_vector[at]
        for other in range(len(away)):
            right[row] -= prior.information[at, other] * away[other]
    if not solve_positive(matrix, right):
        fit.failures[0] += 1.0
        return
    fit.linear[:] = right[:functions]
    fit.levels[:] = right[functions:]


@numba.njit(cache=True)
def fit_linear(problem: Problem, fit: Fit, refresh: bool) -> None:
    """Solve the linear unknowns at ``fit.theta``; with `refresh`, update the variance too.

    The variance is the weight of the prior; it stays while two parameter sets are compared.
    """
    prior = problem.prior
    samples, energy = linear_pass(
        problem, problem.blocks.size[0], fit.theta, fit.matrix, fit.right
    )
    fit.samples[0] = samples
    fit.energy[0] = energy
    power = energy / max(samples, 1.0) + LEAST_ENERGY
    if refresh and fit.variance[0] == 0.0:
        fit.variance[0] = 0.01 * power
    _solve_linear(fit, prior)
    squares = _squares(fit)
    fit.squares[0] = max(squares, 0.0)
    if refresh and remembers(prior) and samples < _MODEL_ERROR_SAMPLES:
        # After a gap the variance from before is better known than that of a few samples.
        kept = (_MODEL_ERROR_SAMPLES - samples) * fit.variance[0]
        fit.variance[0] = (fit.squares[0] + kept) / _MODEL_ERROR_SAMPLES
    elif refresh:
        doubt = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
        fit.variance[0] = (fit.squares[0] + doubt) / (samples + _MODEL_ERROR_SAMPLES)
    fit.cost[0] = squares + _known_cost(fit, prior)
