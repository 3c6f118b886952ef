# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the twitch's order by information criterion (Sec. 2.1, Fig. 5).

The Bayesian information criterion is computed for every twitch at every order; all orders have
the same number of parameters, so it compares likelihoods, and its sum over the twitches is the
evidence of all of them.  A higher order is only chosen if it is better by more than `DECISIVE`, a
factor of about 150 in the odds.  The error on held-out samples is given for comparison.
"""

import math
from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.twitch_fits import CONSTANT
from rpms_ros.identification.analysis.twitch_fits import ERROR
from rpms_ros.identification.analysis.twitch_fits import HELD_OUT
from rpms_ros.identification.analysis.twitch_fits import PEAK
from rpms_ros.identification.analysis.twitch_fits import TwitchFits

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
