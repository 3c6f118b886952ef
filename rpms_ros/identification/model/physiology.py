# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Twitch parameters from an identified response: time constant, latency, order, peak.

The twitch of Eq. (2) behind a latency is fitted to the coefficients of the basis:
``min (w - P m(p))^T (C + e^2 I)^-1 (w - P m(p))`` with P the projection on the basis, C the
covariance of the coefficients and e the error of the basis, as a share of their norm.  Each
direction has the weight of its information.  Time constant, latency and order have similar effects
on the response; a prior as wide as people differ (Tables 1 and 2) keeps them physiological where
the data do not separate them, and the intervals show it.

For given time constant, latency and order the best peak follows from one linear equation; three
parameters remain for `rpms_ros.identification.model.levenberg_marquardt`, with a Gaussian prior.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.levenberg_marquardt import Ending, minimiser
from rpms_ros.pulses import FloatArray

TWITCH, BY_ONSET, BY_LOGARITHM, BY_ORDER = range(4)


@numba.njit(cache=True, nogil=True)
def twitch_row(lag: float, constant: float, order: float, row: FloatArray) -> None:
    """Write the twitch and its derivatives by onset [1/s], ln T_a and order into `row` (4,).

    With ``x = lag / T_a`` and ``k = n - 1`` the twitch is ``(x/k)^k e^(k - x)``; `lag` is the time
    since the onset [s].
    """
    row[:] = 0.0
    if lag > 0.0:
        power = order - 1.0
        scaled = lag / constant
        value = math.exp(power * math.log(scaled / power) + power - scaled)
        row[TWITCH] = value
        row[BY_ONSET] = -value * (power / scaled - 1.0) / constant
        row[BY_LOGARITHM] = value * (scaled - power)
        row[BY_ORDER] = value * math.log(scaled / power)


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
    """A twitch; a point of `rpms_ros.identification.model.levenberg_marquardt`.

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
            columns=np.zeros((len(response.target), 4)),
            energy=np.full(1, response.target @ response.target),
            damping=np.full(1, _DAMPING),
            **{name: np.zeros(1) for name in ('peak', 'cost', 'moved', 'failures')},
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


PHYSIOLOGY_NAMES = ('twitch_time_constant_s', 'latency_s', 'order', 'twitch_peak_n')
_PEOPLE = TwitchPrior(
    centre=np.array([38e-3, 9.5e-3, 3.0]),
    deviation=np.array([15e-3, 8e-3, 0.7]),
    lower=np.array([8e-3, 0.0, 1.5]),
    upper=np.array([0.15, 60e-3, 6.0]),
)
PRIOR: Mapping[str, tuple[float, float]] = {
    name: (float(_PEOPLE.centre[place]), float(_PEOPLE.deviation[place]))
    for place, name in enumerate(PHYSIOLOGY_NAMES[:3])
}
"""Mean and standard deviation among people, by name; none for the peak."""
# Prior with a basis that was chosen by the samples.
_WIDE_DEVIATION = np.array([60e-3, 20e-3, 1.0])
# Grid on which twitches are projected [s]; a wide prior asks for a tenth of T_p besides.
_GRID_STEP = 4e-3
# Error of the basis, relative to the norm of the coefficients.
MISFIT = 1e-3


@dataclass(frozen=True)
class Physiology:
    """Numbers of `PHYSIOLOGY_NAMES` and their standard deviations, (4,) each."""

    values: FloatArray
    deviations: FloatArray


@dataclass(frozen=True)
class TwitchReader:
    """Reads the twitch off coefficients of a basis.

    Attributes
    ----------
    basis : LaguerreBasis
        The basis.
    wide : bool
        Use a wide prior around the basis instead of that of `PRIOR`.
    """

    basis: LaguerreBasis
    wide: bool = False

    @cached_property
    def _prior(self) -> TwitchPrior:
        if not self.wide:
            return _PEOPLE
        centre = np.array([self.basis.time_constant, self.basis.latency + 1e-3, 3.0])
        centre = np.clip(centre, _PEOPLE.lower, _PEOPLE.upper)
        return _PEOPLE._replace(centre=centre, deviation=_WIDE_DEVIATION)

    @cached_property
    def _grid(self) -> tuple[FloatArray, FloatArray]:
        """Times of the grid (grid,) [s], and the projection on the basis (functions, grid)."""
        finest = self.basis.time_constant / 10.0
        step = min(_GRID_STEP, finest) if self.wide else _GRID_STEP
        lag = np.arange(step / 2, self.basis.duration, step)
        return lag, np.asarray(np.linalg.pinv(self.basis.evaluate(lag)), dtype=np.float64)

    def read(
        self, response: FloatArray, covariance: FloatArray, misfit: float = MISFIT
    ) -> Physiology | None:
        """Fit the twitch.

        Parameters
        ----------
        response, covariance : ndarray (functions,), (functions, functions)
            Coefficients of the response at full intensity, and their covariance.
        misfit : float
            Error of the basis, relative to the norm of the coefficients.

        Returns
        -------
        Physiology or None
            None if the response does not differ from zero by two standard deviations.
        """
        length = float(np.linalg.norm(response))
        if not length > 2.0 * float(np.sqrt(max(np.trace(covariance), 0.0))):
            return None
        noise = covariance + (misfit * length) ** 2 * np.eye(len(response))
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        lag, projection = self._grid
        match = match_twitch(
            Coefficients(lag, whiten @ projection, whiten @ response, self._prior)
        )
        jacobian = np.column_stack((match.peak * match.columns[:, 1:], match.columns[:, 0]))
        information = jacobian.T @ jacobian
        information[:3, :3] += np.diag(self._prior.deviation**-2)
        inverse = np.linalg.inv(information + 1e-12 * np.eye(4))
        deviations = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        return Physiology(np.append(match.theta, match.peak), deviations)
