# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Fit of twitches that share their shape: variable projection, compiled.

Every twitch i has its own peak a_i and baseline b_i; the onset t_0, the time constant T_a and, if
asked for, the order n are common,

.. math:: F_i(t) = a_i \hat F(t - t_0; T_a, n) + b_i

with Eq. (2) for the shape.  For given (t_0, ln T_a, n) the best a_i and b_i follow from two
linear equations; the Jacobian of the residual is the derivative of the shape, scaled by a_i and
projected orthogonally to shape and constant (Kaufman).  Two or three parameters remain for
`rpms_ros.identification.model.levenberg_marquardt`, however many twitches there are.  This
minimises Eq. (3) with its peak, its onset and a baseline free.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.model.levenberg_marquardt import Ending, dot, minimiser
from rpms_ros.identification.model.physiology import twitch_row
from rpms_ros.pulses import FloatArray, IntArray

_STEPS = 60
_SETTLED = 1e-9
_LEAST_COST = 1e-18
# Bounds of onset [s], ln of the time constant [ln s] and order.
_LOWER = (-0.02, math.log(1e-3), 1.2)
_UPPER = (0.2, math.log(0.5), 12.0)


class Twitches(NamedTuple):
    """Twitches that share their shape.

    Attributes
    ----------
    lag, force : ndarray (samples,)
        Time since the pulse [s] and force [N], all twitches in a row.
    starts : ndarray of int64 (twitches + 1,)
        Where each twitch begins; the last entry is the number of samples.
    order : float
        Order if it is not fitted.
    """

    lag: FloatArray
    force: FloatArray
    starts: IntArray
    order: float


class SharedShape(NamedTuple):
    """A shape and its residuals; a point of `rpms_ros.identification.model.levenberg_marquardt`.

    Attributes
    ----------
    theta : ndarray (2,) or (3,)
        Onset [s], ln of the time constant [ln s] and, if it is fitted, the order.
    normal, slope : ndarray (parameters, parameters), (parameters,)
        Gauss-Newton matrix and minus half the gradient of the cost.
    rows : ndarray (samples, 5)
        Scratch: twitch, its derivatives, residual.
    cost, energy, damping, moved, failures : ndarray (1,)
        Sum of squared residuals and of squared forces [N^2], and those of the loop.
    """

    theta: FloatArray
    normal: FloatArray
    slope: FloatArray
    rows: FloatArray
    cost: FloatArray
    energy: FloatArray
    damping: FloatArray
    moved: FloatArray
    failures: FloatArray


@numba.njit(cache=True, nogil=True)
def _tables(
    lag: FloatArray, force: FloatArray, theta: FloatArray, rows: FloatArray
) -> tuple[float, float, float]:
    """Return peak, baseline, squared error; `rows` (samples, 5) gets shapes and residuals."""
    count = len(lag)
    sums = np.zeros(4)
    for k in range(count):
        twitch_row(lag[k] - theta[0], math.exp(theta[1]), theta[2], rows[k])
        sums[0] += rows[k, 0]
        sums[1] += force[k]
        sums[2] += rows[k, 0] * rows[k, 0]
        sums[3] += rows[k, 0] * force[k]
    spread = sums[2] - sums[0] * sums[0] / count
    peak = 0.0
    if spread > 1e-12 * (1.0 + sums[2]):
        peak = (sums[3] - sums[0] * sums[1] / count) / spread
    base = (sums[1] - peak * sums[0]) / count
    error = 0.0
    for k in range(count):
        rows[k, 4] = force[k] - base - peak * rows[k, 0]
        error += rows[k, 4] * rows[k, 4]
    return peak, base, error


@numba.njit(cache=True, nogil=True)
def _add_normal(
    rows: FloatArray, peak: float, free: int, normal: FloatArray, slope: FloatArray
) -> None:
    """Add one twitch to the normal equations of (onset, ln T_a, order)."""
    count = len(rows)
    mean = np.zeros(4)
    for k in range(count):
        mean += rows[k, :4]
    mean /= count
    inner = np.zeros((4, 4))
    gradient = np.zeros(4)
    for k in range(count):
        centred = rows[k, :4] - mean
        for i in range(free + 1):
            gradient[i] += centred[i] * rows[k, 4]
            for j in range(i + 1):
                inner[i, j] += centred[i] * centred[j]
    if inner[0, 0] <= 0.0:
        return
    for i in range(free):
        slope[i] += peak * gradient[i + 1]
        for j in range(i + 1):
            term = inner[i + 1, j + 1] - inner[i + 1, 0] * inner[j + 1, 0] / inner[0, 0]
            normal[i, j] += peak * peak * term
            if i != j:
                normal[j, i] = normal[i, j]


@numba.njit(cache=True, nogil=True)
def _evaluate(
    lag: FloatArray,
    force: FloatArray,
    starts: IntArray,
    theta: FloatArray,
    free: int,
    normal: FloatArray,
    slope: FloatArray,
    rows: FloatArray,
) -> float:
    """Return the squared error of all twitches and fill in the normal equations."""
    normal[:] = 0.0
    slope[:] = 0.0
    total = 0.0
    for index in range(len(starts) - 1):
        first, last = starts[index], starts[index + 1]
        peak, _, error = _tables(lag[first:last], force[first:last], theta, rows[first:last])
        total += error
        if free:
            _add_normal(rows[first:last], peak, free, normal, slope)
    return total


@numba.njit(cache=True, nogil=True)
def _measure(twitches: Twitches, shape: SharedShape) -> None:
    """Write cost, normal equations and residuals of a shape."""
    free = len(shape.theta)
    theta = np.empty(3)
    theta[2] = twitches.order
    theta[:free] = shape.theta
    shape.cost[0] = _evaluate(
        twitches.lag,
        twitches.force,
        twitches.starts,
        theta,
        free,
        shape.normal,
        shape.slope,
        shape.rows,
    )


@register_jitable
def _linearise(
    _twitches: Twitches,
    shape: SharedShape,
    _ready: bool,
    hessian: FloatArray,
    gradient: FloatArray,
) -> bool:
    hessian[:] = shape.normal
    gradient[:] = shape.slope
    return True


@register_jitable
def _room(_twitches: Twitches, shape: SharedShape, low: FloatArray, high: FloatArray) -> None:
    for place in range(len(shape.theta)):
        low[place] = _LOWER[place] - shape.theta[place]
        high[place] = _UPPER[place] - shape.theta[place]


@register_jitable
def _move(twitches: Twitches, shape: SharedShape, step: FloatArray, trial: SharedShape) -> None:
    trial.theta[:] = shape.theta + step
    _measure(twitches, trial)


@register_jitable
def _accept(shape: SharedShape, trial: SharedShape) -> None:
    shape.theta[:] = trial.theta
    shape.normal[:] = trial.normal
    shape.slope[:] = trial.slope
    shape.cost[0] = trial.cost[0]


_minimise = minimiser(_linearise, _room, _move, _accept)


@numba.njit(cache=True, nogil=True)
def _begin(start: FloatArray, rows: FloatArray, energy: float) -> SharedShape:
    free = len(start)
    return SharedShape(
        start.copy(),
        np.zeros((free, free)),
        np.zeros(free),
        rows,
        np.zeros(1),
        np.full(1, energy),
        np.full(1, 1e-3),
        np.zeros(1),
        np.zeros(1),
    )


@numba.njit(cache=True, nogil=True)
def shared_fit(
    lag: FloatArray,
    force: FloatArray,
    starts: IntArray,
    start: FloatArray,
    free: int,
) -> tuple[FloatArray, FloatArray, float]:
    """Return the shape that twitches share.

    Parameters
    ----------
    lag : ndarray, shape (samples,)
        Time since the pulse [s], all twitches in a row.
    force : ndarray, shape (samples,)
        Force [N].
    starts : ndarray of int64, shape (twitches + 1,)
        Where each twitch begins; the last entry is the number of samples.
    start : ndarray, shape (3,)
        Onset [s], ln of the time constant [ln s] and order to start from.
    free : int
        2 keeps the order, 3 fits it as a real number.

    Returns
    -------
    theta : ndarray, shape (3,)
        Onset, ln of the time constant, order.
    normal : ndarray, shape (free, free)
        Projected J^T J at the end: its inverse times the variance of the noise is the
        covariance of theta.
    error : float
        Sum of the squared residuals [N^2].
    """
    twitches = Twitches(lag, force, starts, start[2])
    rows = np.empty((len(lag), 5))
    energy = dot(force, force)
    shape = _begin(start[:free], rows, energy)
    trial = _begin(start[:free], rows, energy)
    _measure(twitches, shape)
    _minimise(twitches, shape, trial, Ending(_STEPS, _SETTLED, _LEAST_COST), True)
    theta = start.copy()
    theta[:free] = shape.theta
    return theta, shape.normal, shape.cost[0]


@numba.njit(cache=True, nogil=True)
def coarse_start(
    lag: FloatArray, force: FloatArray, starts: IntArray, order: float, stride: int
) -> FloatArray:
    """Return the best (onset, ln T_a, order) of a coarse grid, on every `stride`-th sample."""
    thin = np.empty(len(starts), dtype=np.int64)
    thin[0] = 0
    total = 0
    for index in range(len(starts) - 1):
        total += (starts[index + 1] - starts[index] + stride - 1) // stride
        thin[index + 1] = total
    thin_lag, thin_force = np.empty(total), np.empty(total)
    for index in range(len(starts) - 1):
        for k in range(thin[index + 1] - thin[index]):
            thin_lag[thin[index] + k] = lag[starts[index] + k * stride]
            thin_force[thin[index] + k] = force[starts[index] + k * stride]
    rows = np.empty((total, 5))
    normal, slope = np.zeros((0, 0)), np.zeros(0)
    best = np.array([0.01, math.log(0.03), order])
    least = math.inf
    for constant in (0.004, 0.007, 0.012, 0.02, 0.03, 0.042, 0.06, 0.09):
        for onset in (0.002, 0.008, 0.014, 0.022, 0.032):
            theta = np.array([onset, math.log(2.0 * constant / (order - 1.0)), order])
            error = _evaluate(thin_lag, thin_force, thin, theta, 0, normal, slope, rows)
            if error < least:
                least = error
                best = theta
    return best


@numba.njit(cache=True, nogil=True)
def linear_parts(
    lag: FloatArray, force: FloatArray, starts: IntArray, theta: FloatArray
) -> FloatArray:
    """Return peak [N], baseline [N] and squared error [N^2] of each twitch, (twitches, 3)."""
    result = np.empty((len(starts) - 1, 3))
    rows = np.empty((len(lag), 5))
    for index in range(len(starts) - 1):
        part = slice(starts[index], starts[index + 1])
        peak, base, error = _tables(lag[part], force[part], theta, rows[part])
        result[index, 0] = peak
        result[index, 1] = base
        result[index, 2] = error
    return result
