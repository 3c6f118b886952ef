# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Fits of twitches at several orders, and the choice of the order (Eqs. 2 and 3, Fig. 5).

Twitches i that share their shape have their own peak a_i and baseline b_i; the onset t_0 and the
time constant T_a are common,

.. math:: F_i(t) = a_i \hat F(t - t_0; T_a, n) + b_i

with Eq. (2) for the shape.  For given (t_0, ln T_a) the best a_i and b_i follow from two
linear equations; the Jacobian of the residual is the derivative of the shape, scaled by a_i and
projected orthogonally to shape and constant (Kaufman).  Two parameters remain for
`rpms_ros.identification.model.levenberg_marquardt`, however many twitches there are.  This
minimises Eq. (3) with its peak, its onset and a baseline free.

The Bayesian information criterion is computed for every twitch at every order; all orders have
the same number of parameters, so it compares likelihoods, and its sum over the twitches is the
evidence of all of them.  A higher order is only chosen if it is better by more than `DECISIVE`, a
factor of about 150 in the odds.  The error on held-out samples is given for comparison.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.model.levenberg_marquardt import Ending, dot, minimiser
from rpms_ros.muscle.twitch import TWITCH, twitch_row
from rpms_ros.pulses import FloatArray, IntArray

_ENDING = Ending(steps=60, tolerance=1e-9, least_cost=1e-18)
# Bounds of onset [s] and ln of the time constant [ln s].
_LOWER = np.array([-0.02, math.log(1e-3)])
_UPPER = np.array([0.2, math.log(0.5)])


class Twitches(NamedTuple):
    """Twitches that share their shape.

    Attributes
    ----------
    lag, force : ndarray (samples,)
        Time since the pulse [s] and force [N], all twitches in a row.
    starts : ndarray of int64 (twitches + 1,)
        Where each twitch begins; the last entry is the number of samples.
    order : float
        Number of equal poles.
    """

    lag: FloatArray
    force: FloatArray
    starts: IntArray
    order: float


class SharedShape(NamedTuple):
    """A shape and its residuals; a point of `rpms_ros.identification.model.levenberg_marquardt`.

    Attributes
    ----------
    theta : ndarray (2,)
        Onset [s] and ln of the time constant [ln s].
    normal, slope : ndarray (parameters, parameters), (parameters,)
        Gauss-Newton matrix and minus half the gradient of the cost.  The inverse of the matrix
        times the variance of the noise is the covariance of theta.
    linear : ndarray (twitches, 2)
        Peak and baseline of each twitch [N].
    rows : ndarray (samples, 5)
        Scratch: twitch, its derivatives, residual.
    cost, energy, damping, moved, failures : ndarray (1,)
        Sum of squared residuals and of squared forces [N^2], and those of the loop.
    """

    theta: FloatArray
    normal: FloatArray
    slope: FloatArray
    linear: FloatArray
    rows: FloatArray
    cost: FloatArray
    energy: FloatArray
    damping: FloatArray
    moved: FloatArray
    failures: FloatArray


@numba.njit(cache=True, nogil=True)
def _fit_line(
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
def _add_normal(rows: FloatArray, peak: float, normal: FloatArray, slope: FloatArray) -> None:
    """Add one twitch to the normal equations of (onset, ln T_a)."""
    free = len(slope)
    centred = np.empty((free + 1, len(rows)))
    for i in range(free + 1):
        centred[i] = rows[:, i] - np.mean(rows[:, i])
    power = dot(centred[0], centred[0])
    if power <= 0.0:
        return
    for i in range(free):
        derivative = centred[i + 1]
        derivative -= dot(derivative, centred[0]) / power * centred[0]
        slope[i] += peak * dot(derivative, rows[:, 4])
        for j in range(i + 1):
            normal[i, j] += peak * peak * dot(derivative, centred[j + 1])
            normal[j, i] = normal[i, j]


@numba.njit(cache=True, nogil=True)
def _measure(twitches: Twitches, shape: SharedShape) -> None:
    """Write linear parts, cost, normal equations and residuals of a shape."""
    theta = np.append(shape.theta, twitches.order)
    shape.normal[:] = 0.0
    shape.slope[:] = 0.0
    shape.cost[0] = 0.0
    for index in range(len(twitches.starts) - 1):
        first, last = twitches.starts[index], twitches.starts[index + 1]
        lag, force = twitches.lag[first:last], twitches.force[first:last]
        rows = shape.rows[first:last]
        peak, base, error = _fit_line(lag, force, theta, rows)
        shape.linear[index] = (peak, base)
        shape.cost[0] += error
        _add_normal(rows, peak, shape.normal, shape.slope)


@register_jitable
def _linearise(
    _twitches: Twitches, shape: SharedShape, hessian: FloatArray, gradient: FloatArray
) -> bool:
    hessian[:] = shape.normal
    gradient[:] = shape.slope
    return True


@register_jitable
def _room(_twitches: Twitches, shape: SharedShape, low: FloatArray, high: FloatArray) -> None:
    low[:] = _LOWER - shape.theta
    high[:] = _UPPER - shape.theta


@register_jitable
def _move(twitches: Twitches, shape: SharedShape, step: FloatArray, trial: SharedShape) -> None:
    trial.theta[:] = shape.theta + step
    _measure(twitches, trial)


_minimise = minimiser(_linearise, _room, _move)


@numba.njit(cache=True, nogil=True)
def _begin(twitches: Twitches, start: FloatArray, rows: FloatArray) -> SharedShape:
    free = len(start)
    return SharedShape(
        start.copy(),
        np.zeros((free, free)),
        np.zeros(free),
        np.zeros((len(twitches.starts) - 1, 2)),
        rows,
        np.zeros(1),
        np.full(1, dot(twitches.force, twitches.force)),
        np.full(1, 1e-3),
        np.zeros(1),
        np.zeros(1),
    )


@numba.njit(cache=True, nogil=True)
def shared_fit(
    lag: FloatArray, force: FloatArray, starts: IntArray, start: FloatArray
) -> SharedShape:
    """Return the shape that twitches share.

    Parameters
    ----------
    lag, force : ndarray (samples,)
        As in `Twitches`.
    starts : ndarray of int64 (twitches + 1,)
        As in `Twitches`.
    start : ndarray (3,)
        Onset [s] and ln of the time constant [ln s] to start from, and the order.
    """
    twitches = Twitches(lag, force, starts, start[2])
    rows = np.empty((len(lag), 5))
    shape, trial = _begin(twitches, start[:2], rows), _begin(twitches, start[:2], rows)
    _measure(twitches, shape)
    return trial if _minimise(twitches, shape, trial, _ENDING) else shape


@numba.njit(cache=True, nogil=True)
def coarse_start(lag: FloatArray, force: FloatArray, order: float) -> FloatArray:
    """Return the best (onset, ln T_a, order) of a coarse grid for one twitch (samples,)."""
    rows = np.empty((len(lag), 5))
    best = np.empty(3)
    least = math.inf
    for constant in (0.004, 0.007, 0.012, 0.02, 0.03, 0.042, 0.06, 0.09):
        for onset in (0.002, 0.008, 0.014, 0.022, 0.032):
            theta = np.array([onset, math.log(2.0 * constant / (order - 1.0)), order])
            error = _fit_line(lag, force, theta, rows)[2]
            if error < least:
                least = error
                best = theta
    return best


Progress = Callable[[int, int], None]

# Columns of the table, in the order in which `_fit_one` writes them.
ONSET, CONSTANT, PEAK, BASELINE, ERROR, HELD_OUT = range(6)
DECISIVE = 10.0
_STRIDE = 4


@dataclass(frozen=True)
class TwitchFits:
    """Fits of several twitches at several orders.

    Attributes
    ----------
    orders : tuple of int
        Orders, as many as columns below.
    intensity : ndarray, shape (twitches,)
        Shares of the maximum; NaN where it is not recorded.
    samples : ndarray of int64, shape (twitches,)
        Samples fitted.
    table : ndarray, shape (twitches, orders, 6)
        Onset [s], time constant [s], peak [N], baseline [N], squared error [N^2], squared error
        on samples that were held out [N^2].
    """

    orders: tuple[int, ...]
    intensity: FloatArray
    samples: IntArray
    table: FloatArray

    def __len__(self) -> int:
        return len(self.samples)

    def column(self, column: int, order: int) -> FloatArray:
        """Return one column of the table at one order (twitches,)."""
        return self.table[:, self.orders.index(order), column]

    def least_error(self, order: int) -> FloatArray:
        """Return E_min of Eq. (3), the squared error in squared peaks (twitches,)."""
        return self.column(ERROR, order) / self.column(PEAK, order) ** 2

    def bayes(self) -> FloatArray:
        """Return the Bayesian information criterion (twitches, orders): N ln(E / N) + k ln N."""
        count = self.samples[:, None].astype(np.float64)
        error = np.maximum(self.table[:, :, ERROR], 1e-300)
        return count * np.log(error / count) + 5.0 * np.log(count)

    def chosen(self, mask: FloatArray) -> 'TwitchFits':
        """Return the twitches of a mask or of indices."""
        return TwitchFits(self.orders, self.intensity[mask], self.samples[mask], self.table[mask])


@numba.njit(cache=True, nogil=True)
def _held_out(lag: FloatArray, force: FloatArray, theta: FloatArray) -> float:
    """Return the squared error of each half of the samples under the fit to the other [N^2]."""
    total = 0.0
    row = np.empty(4)
    for part in range(2):
        seen = lag[part::2].copy()
        fit = shared_fit(seen, force[part::2].copy(), np.array([0, len(seen)]), theta)
        constant = math.exp(fit.theta[1])
        for k in range(1 - part, len(lag), 2):
            twitch_row(lag[k] - fit.theta[0], constant, theta[2], row)
            total += (force[k] - fit.linear[0, 1] - fit.linear[0, 0] * row[TWITCH]) ** 2
    return total


@numba.njit(cache=True, nogil=True)
def _fit_one(lag: FloatArray, force: FloatArray, orders: IntArray, row: FloatArray) -> None:
    """Fit one twitch at each order into `row` (orders, 6) of the table."""
    starts = np.array([0, len(lag)])
    start = coarse_start(lag[::_STRIDE].copy(), force[::_STRIDE].copy(), float(orders[0]))
    for index in range(len(orders)):
        # keep the time of the peak, (n - 1) T_a after the onset, from one order to the next
        start[1] += math.log((start[2] - 1.0) / (orders[index] - 1.0))
        start[2] = orders[index]
        fit = shared_fit(lag, force, starts, start)
        theta = np.array([fit.theta[0], fit.theta[1], start[2]])
        peak, base = fit.linear[0]
        held_out = _held_out(lag, force, theta)
        row[index] = (theta[0], math.exp(theta[1]), peak, base, fit.cost[0], held_out)


def fit_twitches(
    responses: Sequence[Response], orders: tuple[int, ...], progress: Progress = lambda *_: None
) -> TwitchFits:
    """Fit every response to a single pulse at every order.

    Parameters
    ----------
    responses : sequence of Response
        Twitches.
    orders : tuple of int
        Orders.
    progress : callable
        Called with the number of twitches done and of all.
    """
    table = np.zeros((len(responses), len(orders), 6))

    def fit(index: int) -> None:
        lag, force = responses[index].samples
        _fit_one(lag, force, np.array(orders, dtype=np.int64), table[index])

    # The compiled fits release the interpreter lock, so threads use both cores without copies.
    with ThreadPoolExecutor(2) as pool:
        for index, _ in enumerate(pool.map(fit, range(len(responses)))):
            progress(index + 1, len(responses))
    samples = np.array([int(item.usable.sum()) for item in responses], dtype=np.int64)
    return TwitchFits(orders, np.array([item.intensity for item in responses]), samples, table)


@dataclass(frozen=True)
class OrderEvidence:
    """Criteria of one order.

    Attributes
    ----------
    order : int
        Number of equal poles.
    information : float
        Information criterion minus that of the best order; smaller is better.
    held_out : float
        Root of the mean squared error on held-out samples, in peaks of the twitches.
    least_error : float
        Median of E_min of Eq. (3).
    time_constant, time_constant_spread : float
        Mean and standard deviation of T_a over the twitches [s].
    """

    order: int
    information: float
    held_out: float
    least_error: float
    time_constant: float
    time_constant_spread: float


@dataclass(frozen=True)
class OrderChoice:
    """The order that was chosen and why.

    Attributes
    ----------
    order : int
        Chosen by the information criterion.
    held_out_order : int
        Order with the smallest held-out error.
    evidence : tuple of OrderEvidence
        One for each order.
    """

    order: int
    held_out_order: int
    evidence: tuple[OrderEvidence, ...]


def choose_order(fits: TwitchFits) -> OrderChoice:
    """Return the order for a set of twitches (at least one)."""
    total = fits.bayes().sum(axis=0)
    # each error is relative to the peak of its twitch, or the strong ones alone would decide
    share = fits.table[:, :, HELD_OUT] / fits.table[:, :, PEAK] ** 2 / fits.samples[:, None]
    held_out = np.sqrt(share.mean(axis=0))
    best = 0
    for index in range(1, len(fits.orders)):
        if total[index] < total[best] - DECISIVE:
            best = index
    evidence = tuple(
        OrderEvidence(
            order=order,
            information=float(total[index] - total.min()),
            held_out=float(held_out[index]),
            least_error=float(np.median(fits.least_error(order))),
            time_constant=float(fits.column(CONSTANT, order).mean()),
            time_constant_spread=spread(fits.column(CONSTANT, order)),
        )
        for index, order in enumerate(fits.orders)
    )
    return OrderChoice(
        order=fits.orders[best],
        held_out_order=fits.orders[int(np.argmin(held_out))],
        evidence=evidence,
    )


def spread(values: FloatArray) -> float:
    """Return the standard deviation of a sample, NaN for a single value."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def derivatives(
    function: Callable[[FloatArray], FloatArray], at: FloatArray, steps: FloatArray
) -> FloatArray:
    """Return the derivatives (values, parameters) of a function, by central differences."""
    pairs = ((function(at + step), function(at - step)) for step in np.diag(steps))
    return np.column_stack([above - below for above, below in pairs]) / (2.0 * steps)
