# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Twitches fitted one by one, at several orders (Eqs. 2 and 3).

Choice of the twitch's order by information criterion (Sec. 2.1, Fig. 5).

The Bayesian information criterion is computed for every twitch at every order; all orders have
the same number of parameters, so it compares likelihoods, and its sum over the twitches is the
evidence of all of them.  A higher order is only chosen if it is better by more than `DECISIVE`, a
factor of about 150 in the odds.  The error on held-out samples is given for comparison.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.twitch_kernel import coarse_start, linear_parts, shared_fit
from rpms_ros.identification.model.physiology import TWITCH, twitch_row
from rpms_ros.pulses import FloatArray, IntArray

Progress = Callable[[int, int], None]

ONSET, CONSTANT, PEAK, BASELINE, ERROR, HELD_OUT, ONSET_SD, CONSTANT_SD = range(8)
COLUMNS = 8
_STRIDE = 4
_WORKERS = 2
_CHUNK = 25


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
    table : ndarray, shape (twitches, orders, 8)
        Onset [s], time constant [s], peak [N], baseline [N], squared error [N^2], squared error
        on samples that were held out [N^2], standard deviations of onset and time constant [s].
    free_order : ndarray, shape (twitches,)
        Order fitted as a real number.
    """

    orders: tuple[int, ...]
    intensity: FloatArray
    samples: IntArray
    table: FloatArray
    free_order: FloatArray

    def __len__(self) -> int:
        return len(self.samples)

    def column(self, column: int, order: int) -> FloatArray:
        """Return one column of the table at one order (twitches,)."""
        values: FloatArray = self.table[:, self.orders.index(order), column]
        return values

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
        return TwitchFits(
            self.orders,
            self.intensity[mask],
            self.samples[mask],
            self.table[mask],
            self.free_order[mask],
        )


@numba.njit(cache=True, nogil=True)
def _errors_on(
    lag: FloatArray, force: FloatArray, theta: FloatArray, peak: float, base: float
) -> float:
    total = 0.0
    row = np.empty(4)
    for k in range(len(lag)):
        twitch_row(lag[k] - theta[0], np.exp(theta[1]), theta[2], row)
        total += (force[k] - (base + peak * row[TWITCH])) ** 2
    return total


@numba.njit(cache=True, nogil=True)
def _held_out(lag: FloatArray, force: FloatArray, theta: FloatArray) -> float:
    """Return the squared error of each half of the samples under the fit to the other [N^2]."""
    total = 0.0
    for part in range(2):
        seen_lag, seen = lag[part::2].copy(), force[part::2].copy()
        starts = np.array([0, len(seen)])
        fitted, _, _ = shared_fit(seen_lag, seen, starts, theta, 2)
        parts = linear_parts(seen_lag, seen, starts, fitted)
        rest = 1 - part
        total += _errors_on(lag[rest::2], force[rest::2], fitted, parts[0, 0], parts[0, 1])
    return total


@numba.njit(cache=True, nogil=True)
def fit_one(lag: FloatArray, force: FloatArray, orders: IntArray, row: FloatArray) -> float:
    """Fit one twitch at each order into `row` (orders, 8); return the free order.

    Parameters
    ----------
    lag : ndarray, shape (samples,)
        Time since the pulse [s].
    force : ndarray, shape (samples,)
        Force [N].
    orders : ndarray of int64, shape (orders,)
        Orders to try.
    row : ndarray, shape (orders, 8)
        Filled in, as in `TwitchFits`.
    """
    starts = np.array([0, len(lag)])
    best = np.inf
    best_theta = np.zeros(3)
    start = coarse_start(lag, force, starts, float(orders[0]), _STRIDE)
    for index in range(len(orders)):
        # keep the time of the peak, (n - 1) T_a after the onset, from one order to the next
        start[1] += np.log((start[2] - 1.0) / (orders[index] - 1.0))
        start[2] = orders[index]
        theta, normal, error = shared_fit(lag, force, starts, start, 2)
        parts = linear_parts(lag, force, starts, theta)
        scale = error / max(1, len(lag) - 4)
        row[index, ONSET] = theta[0]
        row[index, CONSTANT] = np.exp(theta[1])
        row[index, PEAK] = parts[0, 0]
        row[index, BASELINE] = parts[0, 1]
        row[index, ERROR] = error
        row[index, HELD_OUT] = _held_out(lag, force, theta)
        determinant = normal[0, 0] * normal[1, 1] - normal[0, 1] ** 2
        if determinant > 0.0:
            row[index, ONSET_SD] = np.sqrt(scale * normal[1, 1] / determinant)
            row[index, CONSTANT_SD] = np.exp(theta[1]) * np.sqrt(
                scale * normal[0, 0] / determinant
            )
        if error < best:
            best = error
            best_theta = theta
    free, _, _ = shared_fit(lag, force, starts, best_theta, 3)
    return float(free[2])


def fit_twitches(
    responses: Sequence[Response],
    orders: tuple[int, ...],
    progress: Progress | None = None,
) -> TwitchFits:
    """Fit every response to a single pulse at every order.

    Parameters
    ----------
    responses : sequence of Response
        Twitches.
    orders : tuple of int
        Orders.
    progress : callable, optional
        Called with the number of twitches done and of all.
    """
    tried = np.array(orders, dtype=np.int64)
    table = np.zeros((len(responses), len(orders), COLUMNS))
    free = np.full(len(responses), np.nan)
    samples = np.array([int(item.usable.sum()) for item in responses], dtype=np.int64)

    def work(first: int) -> int:
        chunk = range(first, min(first + _CHUNK, len(responses)))
        for index in chunk:
            item = responses[index]
            lag, force = item.lag[item.usable], item.force[item.usable]
            free[index] = fit_one(lag, force, tried, table[index])
        return len(chunk)

    done = 0
    # The compiled fits release the interpreter lock, so threads use both cores without copies.
    with ThreadPoolExecutor(_WORKERS) as pool:
        for count in pool.map(work, range(0, len(responses), _CHUNK)):
            done += count
            if progress is not None:
                progress(done, len(responses))
    intensity = np.array([item.intensity for item in responses])
    return TwitchFits(orders, intensity, samples, table, free)


DECISIVE = 10.0


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
    wins : int
        Twitches for which this order has the best criterion.
    """

    order: int
    information: float
    held_out: float
    least_error: float
    time_constant: float
    time_constant_spread: float
    wins: int


@dataclass(frozen=True)
class OrderChoice:
    """The order that was chosen and why.

    Attributes
    ----------
    order : int
        Chosen by the information criterion.
    held_out_order : int
        Order with the smallest held-out error.
    free_order, free_order_spread : float
        Median and scaled interquartile range of the order fitted as a real number; the range of
        one twitch is NaN.
    evidence : tuple of OrderEvidence
        One for each order.
    """

    order: int
    held_out_order: int
    free_order: float
    free_order_spread: float
    evidence: tuple[OrderEvidence, ...]


def choose_order(fits: TwitchFits) -> OrderChoice:
    """Return the order for a set of twitches (at least one)."""
    criterion = fits.bayes()
    total = criterion.sum(axis=0)
    # each error is relative to the peak of its twitch, or the strong ones alone would decide
    share = fits.table[:, :, HELD_OUT] / fits.table[:, :, PEAK] ** 2 / fits.samples[:, None]
    held_out = np.sqrt(share.mean(axis=0))
    best = 0
    for index in range(1, len(fits.orders)):
        if total[index] < total[best] - DECISIVE:
            best = index
    wins = np.bincount(np.argmin(criterion, axis=1), minlength=len(fits.orders))
    low, median, high = np.percentile(fits.free_order, [25, 50, 75])
    evidence = tuple(
        OrderEvidence(
            order=order,
            information=float(total[index] - total.min()),
            held_out=float(held_out[index]),
            least_error=float(np.median(fits.least_error(order))),
            time_constant=float(fits.column(CONSTANT, order).mean()),
            time_constant_spread=spread(fits.column(CONSTANT, order)),
            wins=int(wins[index]),
        )
        for index, order in enumerate(fits.orders)
    )
    return OrderChoice(
        order=fits.orders[best],
        held_out_order=fits.orders[int(np.argmin(held_out))],
        free_order=float(median),
        free_order_spread=float((high - low) / 1.349) if len(fits.free_order) > 1 else math.nan,
        evidence=evidence,
    )


def spread(values: np.ndarray) -> float:
    """Return the standard deviation of a sample, NaN for a single value."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else float('nan')


def signal_to_noise(fits: TwitchFits, order: int) -> np.ndarray:
    """Return peak over standard deviation of the residual (twitches,)."""
    noise = np.sqrt(fits.column(ERROR, order) / fits.samples)
    return np.asarray(fits.column(PEAK, order) / np.maximum(noise, 1e-300))
