r"""Fit of twitches that share their shape: variable projection, compiled.

Every twitch i has its own peak a_i and baseline b_i; the onset t_0, the time constant T_a and, if
asked for, the order n are common,

.. math:: F_i(t) = a_i \hat F(t - t_0; T_a, n) + b_i

with Eq. (2) for the shape.  For given (t_0, ln T_a, n) the best a_i and b_i follow from two
linear equations; the Jacobian of what is left is the derivative of the shape, scaled by a_i and
projected off the span of shape and constant (Kaufman).  Levenberg-Marquardt with two or three
parameters remains, however many twitches there are.  This minimises Eq. (3) with its peak, its
onset and a baseline free.
"""

import math

import numba
import numpy as np

from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

_STEPS = 60
_SETTLED = 1e-9
_SHORTEST = 1e-3
_LONGEST = 0.5


@numba.njit(cache=True, nogil=True)
def _shape(lag: float, constant: float, order: float, row: FloatArray) -> None:
    """Write the shape and its derivatives to onset, ln T_a and order into `row` (4,)."""
    row[:] = 0.0
    if lag > 0.0:
        power = order - 1.0
        scaled = lag / constant
        value = math.exp(power * math.log(scaled / power) + power - scaled)
        row[0] = value
        row[1] = -value * (power / scaled - 1.0) / constant
        row[2] = value * (scaled - power)
        row[3] = value * math.log(scaled / power)


@numba.njit(cache=True, nogil=True)
def _tables(
    lag: FloatArray, force: FloatArray, theta: FloatArray, rows: FloatArray
) -> tuple[float, float, float]:
    """Return peak, baseline and squared error; `rows` (samples, 5) gets shapes and the rest."""
    count = len(lag)
    sums = np.zeros(4)
    for k in range(count):
        _shape(lag[k] - theta[0], math.exp(theta[1]), theta[2], rows[k])
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
def _allowed(theta: FloatArray) -> bool:
    constant = math.exp(theta[1])
    return (
        -0.02 <= theta[0] <= 0.2 and _SHORTEST <= constant <= _LONGEST and 1.2 <= theta[2] <= 12.0
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
    theta = start.copy()
    rows = np.empty((len(lag), 5))
    normal = np.zeros((free, free))
    slope = np.zeros(free)
    next_normal = np.zeros((free, free))
    next_slope = np.zeros(free)
    damping = 1e-3
    error = _evaluate(lag, force, starts, theta, free, normal, slope, rows)
    for _ in range(_STEPS):
        damped = normal.copy()
        for i in range(free):
            damped[i, i] += damping * normal[i, i] + 1e-300
        step = np.linalg.solve(damped, slope)
        trial = theta.copy()
        trial[:free] += step
        if _allowed(trial):
            reached = _evaluate(lag, force, starts, trial, free, next_normal, next_slope, rows)
        else:
            reached = math.inf
        if reached < error:
            gain = error - reached
            theta, error = trial, reached
            normal[:] = next_normal
            slope[:] = next_slope
            damping = max(damping * 0.2, 1e-12)
            if gain <= _SETTLED * error:
                break
        else:
            damping *= 8.0
            if damping > 1e10:
                break
    return theta, normal, error


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
