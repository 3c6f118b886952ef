# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the recursion for people has fitted, and how far it may be wrong."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.estimation.settings import Prior
from rpms_ros.identification.estimation.uncertainty import (
    Muscle,
    ResidualSums,
    Uncertainty,
    condition_number,
)
from rpms_ros.identification.estimation.window_fit import LEAST_ENERGY
from rpms_ros.identification.model.physiology import MISFIT
from rpms_ros.identification.model.recruitment import PARAMETERS
from rpms_ros.pulses import FloatArray

_ROUNDING = 1e-12


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
    single = ['cost', 'squares', 'samples', 'energy', 'variance', 'moved', 'failures']
    return Fit(
        theta=theta.copy(),
        linear=np.zeros(functions),
        levels=np.zeros(knots),
        matrix=np.zeros((unknowns, unknowns)),
        right=np.zeros(unknowns),
        complete=np.zeros((unknowns, unknowns)),
        damping=np.full(1, 1e-3),
        **{name: np.zeros(1) for name in single},
    )


@numba.njit(cache=True)
def coordinate(theta: FloatArray, place: int) -> float:
    """Return a parameter in the coordinate of the steps: alpha as its logarithm."""
    if place >= 2:
        return math.log(theta[place])
    value: float = theta[place]
    return value


@numba.njit(cache=True)
def weak_ridge(energy: float, samples: float, variance: float) -> float:
    """Return a ridge that keeps w and b solvable, too weak to change estimates noticeably."""
    power = energy / max(samples, 1.0) + LEAST_ENERGY
    # The variance exceeds the power only if it is from before a gap.
    value: float = 1e-2 * variance / max(power, variance)
    return value


@register_jitable
def room(problem: Any, fit: Fit, low: FloatArray, high: FloatArray) -> None:
    """Write the least and greatest steps of the coordinates (4,) within `problem.prior`."""
    for place in range(PARAMETERS):
        here = coordinate(fit.theta, place)
        low[place] = coordinate(problem.prior.lower, place) - here
        high[place] = coordinate(problem.prior.upper, place) - here


@numba.njit(cache=True)
def move_theta(theta: FloatArray, prior: Prior, step: FloatArray, moved: FloatArray) -> None:
    """Write theta (4,) after a step (4,); u_thr and u_sat keep their least distance.

    `step` becomes what was gone.
    """
    for place in range(PARAMETERS):
        value = coordinate(theta, place) + step[place]
        value = math.exp(value) if place >= 2 else value
        moved[place] = min(max(value, prior.lower[place]), prior.upper[place])
    lacking = prior.separation - (moved[1] - moved[0])
    if lacking > 0.0:
        moved[0] = max(moved[0] - 0.5 * lacking, prior.lower[0])
        moved[1] = moved[0] + prior.separation
    for place in range(PARAMETERS):
        step[place] = coordinate(moved, place) - coordinate(theta, place)


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


def uncertainty(
    fit: Fit, prior: Prior, sums: ResidualSums, area: FloatArray, confidence: float
) -> tuple[Muscle, Uncertainty | None]:
    """Return the muscle of a fit whose equations are complete, and its uncertainty.

    Parameters
    ----------
    fit, prior : Fit, Prior
        State of the recursion.
    sums : ResidualSums
        Of its residuals.
    area : ndarray (functions,)
        Integrals of the functions [s^1/2].
    confidence : float
        Level of the intervals.

    Returns
    -------
    tuple of Muscle, Uncertainty or None
        None while there is no sample.
    """
    joint = PARAMETERS + len(fit.linear)
    lower = np.tril(fit.complete)
    muscle = Muscle(
        fit.theta.copy(),
        fit.linear.copy(),
        fit.levels.copy(),
        moved=float(fit.moved[0]),
        damping=float(fit.damping[0]),
    )
    if not fit.samples[0] > 0.0:
        return muscle, None
    matrix = lower + lower.T - np.diag(np.diag(lower))
    variance = float(fit.variance[0])
    theta = np.arange(PARAMETERS)
    matrix[theta, theta] += variance / prior.deviation**2
    linear = np.arange(PARAMETERS, len(matrix))
    matrix[linear, linear] += weak_ridge(fit.energy[0], fit.samples[0], variance)
    scale = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(scale, scale) + _ROUNDING * np.eye(len(matrix))
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    inflation = max(1.0, float(sums.spread.max(initial=0.0)) / variance)
    inverse = 0.5 * (inverse + inverse.T) * variance
    inverse[PARAMETERS:] *= np.sqrt(inflation)
    inverse[:, PARAMETERS:] *= np.sqrt(inflation)
    # the deviations of theta are inflated at most to those of the prior
    deviation = np.sqrt(np.maximum(np.diag(inverse)[:PARAMETERS], 0.0))
    most = np.maximum(prior.deviation / np.maximum(deviation, 1e-300), 1.0)
    scale = np.ones(joint)
    scale[:PARAMETERS] = np.minimum(np.sqrt(inflation), most)
    covariance = inverse[:joint, :joint] * np.outer(scale, scale)
    by_basis = MISFIT * float(np.linalg.norm(fit.linear) * np.linalg.norm(area))
    muscle = replace(
        muscle,
        condition=condition_number(lower[PARAMETERS:joint, PARAMETERS:joint]),
        area_error=math.hypot(by_basis / math.sqrt(len(fit.linear)), sums.missing_area(variance)),
    )
    return muscle, Uncertainty(covariance, confidence)
