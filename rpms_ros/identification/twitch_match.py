# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Fit of one twitch to coefficients of a basis, compiled.

For given time constant, latency and order the best peak follows from one linear equation; three
parameters remain for `rpms_ros.identification.levenberg_marquardt`, with a Gaussian prior.
"""

from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.levenberg_marquardt import Ending
from rpms_ros.identification.levenberg_marquardt import minimiser
from rpms_ros.identification.twitch_shape import BY_LOGARITHM
from rpms_ros.identification.twitch_shape import BY_ONSET
from rpms_ros.identification.twitch_shape import BY_ORDER
from rpms_ros.identification.twitch_shape import TWITCH
from rpms_ros.identification.twitch_shape import twitch_row
from rpms_ros.pulses import FloatArray

CONSTANT, LATENCY, ORDER = range(3)
_STEPS = 30
_TOLERANCE = 1e-6
_DAMPING = 1e-2
# Cost per coefficient, in squared standard deviations, above which a fit is not accepted.
_CONTRADICTED = 4.0
# Other starts, in deviations of time constant, latency and order from the centre.
_OTHER_STARTS = ((-1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (-0.5, 0.0, 1.0), (0.5, 0.0, -1.0))


class TwitchPrior(NamedTuple):
    """Prior of time constant [s], latency [s] and order.

    Attributes
    ----------
    centre, deviation : ndarray (3,)
        Mean and standard deviation.
    lower, upper : ndarray (3,)
        Bounds.
    """

    centre: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray


class Coefficients(NamedTuple):
    """The coefficients to which a twitch is fitted.

    Attributes
    ----------
    lag : ndarray (grid,)
        Times of the grid [s].
    projection : ndarray (functions, grid)
        Maps a force on the grid to whitened coefficients.
    target : ndarray (functions,)
        Whitened coefficients of the response.
    prior : TwitchPrior
        Prior.
    """

    lag: FloatArray
    projection: FloatArray
    target: FloatArray
    prior: TwitchPrior


class TwitchMatch(NamedTuple):
    """A twitch; a point of `rpms_ros.identification.levenberg_marquardt`.

    Attributes
    ----------
    theta : ndarray (3,)
        Time constant [s], latency [s], order.
    peak : ndarray (1,)
        Peak force [N].
    columns : ndarray (functions, 4)
        Whitened coefficients of the twitch of peak 1, and their derivatives by theta.
    cost, energy, damping, moved, failures : ndarray (1,)
        Squared distance in standard deviations, that of zero force, and those of the loop.
    """

    theta: FloatArray
    peak: FloatArray
    columns: FloatArray
    cost: FloatArray
    energy: FloatArray
    damping: FloatArray
    moved: FloatArray
    failures: FloatArray


@numba.njit(cache=True)
def _measure(response: Coefficients, match: TwitchMatch) -> None:
    """Write columns, peak and cost at theta."""
    constant, latency, order = match.theta
    row = np.empty(4)
    match.columns[:] = 0.0
    for index in range(len(response.lag)):
        twitch_row(response.lag[index] - latency, constant, order, row)
        for function in range(len(response.target)):
            share = response.projection[function, index]
            match.columns[function, 0] += share * row[TWITCH]
            match.columns[function, 1 + CONSTANT] += share * row[BY_LOGARITHM] / constant
            match.columns[function, 1 + LATENCY] += share * row[BY_ONSET]
            match.columns[function, 1 + ORDER] += share * row[BY_ORDER]
    model = match.columns[:, 0]
    match.peak[0] = (model * response.target).sum() / max((model * model).sum(), 1e-300)
    residual = response.target - match.peak[0] * model
    away = (match.theta - response.prior.centre) / response.prior.deviation
    match.cost[0] = (residual * residual).sum() + (away * away).sum()


@register_jitable
def _linearise(
    response: Coefficients,
    match: TwitchMatch,
    _ready: bool,
    hessian: FloatArray,
    gradient: FloatArray,
) -> bool:
    """Write the equations of theta, the peak eliminated."""
    prior, peak = response.prior, match.peak[0]
    model = match.columns[:, 0]
    power = (model * model).sum()
    if not power > 0.0:
        return False
    residual = response.target - peak * model
    for place in range(3):
        column = peak * match.columns[:, 1 + place]
        along = (column * model).sum() / power
        weight = 1.0 / prior.deviation[place] ** 2
        away = match.theta[place] - prior.centre[place]
        gradient[place] = (column * residual).sum() - weight * away
        for other in range(3):
            free = (column - along * model) * match.columns[:, 1 + other]
            hessian[place, other] = peak * free.sum()
        hessian[place, place] += weight
    return True


@register_jitable
def _room(response: Coefficients, match: TwitchMatch, low: FloatArray, high: FloatArray) -> None:
    low[:] = response.prior.lower - match.theta
    high[:] = response.prior.upper - match.theta


@register_jitable
def _move(
    response: Coefficients, match: TwitchMatch, step: FloatArray, trial: TwitchMatch
) -> None:
    trial.theta[:] = match.theta + step
    _measure(response, trial)


@register_jitable
def _accept(match: TwitchMatch, trial: TwitchMatch) -> None:
    match.theta[:] = trial.theta
    match.peak[:] = trial.peak
    match.columns[:] = trial.columns
    match.cost[:] = trial.cost


_minimise = minimiser(_linearise, _room, _move, _accept)


def _fit_from(start: FloatArray, response: Coefficients) -> TwitchMatch:
    """Return the fit that is reached from a start (3,)."""
    match, trial = (
        TwitchMatch(
            theta=np.clip(start, response.prior.lower, response.prior.upper),
            peak=np.zeros(1),
            columns=np.zeros((len(response.target), 4)),
            cost=np.zeros(1),
            energy=np.full(1, response.target @ response.target),
            damping=np.full(1, _DAMPING),
            moved=np.zeros(1),
            failures=np.zeros(1),
        )
        for _ in range(2)
    )
    _measure(response, match)
    # In squared standard deviations: a cost of 1 need not be reduced.
    _minimise(response, match, trial, Ending(_STEPS, _TOLERANCE, 1.0), True)
    return match


def match_twitch(response: Coefficients) -> TwitchMatch:
    """Return the twitch that fits the coefficients.

    The search begins at the centre of the prior.  If the fit is poor, it may be a local minimum,
    and other starts are tried.
    """
    best = _fit_from(response.prior.centre, response)
    for shift in _OTHER_STARTS:
        if best.cost[0] <= _CONTRADICTED * len(response.target):
            break
        start = response.prior.centre + np.array(shift) * response.prior.deviation
        other = _fit_from(start, response)
        if other.cost[0] < best.cost[0]:
            best = other
    return best
