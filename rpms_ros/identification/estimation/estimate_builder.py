# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Estimates from a fit: curve, response, physiology, each with its interval.

**Uncertainty.** The covariance of [theta, w] is ``s^2 (M + C)^-1`` with M the Gauss-Newton
matrix of the joint problem and C that of the prior. ``s^2`` is the variance of the residuals,
times the factor by which sums of neighbouring residuals vary more than those of white noise:
drift, an artifact or a misfit of the basis correlate neighbouring residuals, and then a sample
informs less than an independent one.

**Misfit.** A response that lacks an area ``a_k`` in the time between ``k`` and ``k + 1``
cells after its pulse leaves residuals whose sum over cell b is ``sum_k a_k rho_(b-k) / dt``.
With intensities that differ from pulse to pulse the mean square of these sums is that of
``rho`` times ``sum_k a_k^2``, beyond what white residuals have. The signs are not known: taken
as random, the error of the area, to which the recruitment curve is proportional, is the root
of ``sum_k a_k^2``. The fit has taken up a part of what is missing, so it is multiplied by
`_SHOWN`. Drift, voluntary effort and a changed muscle leave such sums too, and are an error of
the curve too.

**Parameters.** u_thr, u_sat and both alpha are those of the arctangents that are nearest to the
recruitment curve (`nearest_arctangents`): the paper's parameters where it does not deviate.

**Identifiability.**

* not informed: the standard deviation is above 0.7 of that of the prior: the data have not halved
  the variance.
* converged: it is below `SETTLED`, and the last step was smaller than that.
* informed: neither.

**Twitch.** That of Eq. (2) behind a latency is fitted to the coefficients of the basis:
``min (w - P m(p))^T (C + e^2 I)^-1 (w - P m(p))`` with P the projection on the basis, C the
covariance of the coefficients and e the error of the basis, as a share of their norm.  Each
direction has the weight of its information.  Time constant, latency and order have similar effects
on the response; a prior as wide as people differ (Tables 1 and 2) keeps them physiological where
the data do not separate them, and the intervals show it.

For given time constant, latency and order the best peak follows from one linear equation; three
parameters remain for `rpms_ros.identification.model.levenberg_marquardt`, with a Gaussian prior.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable
from scipy.special import ndtri

from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import (
    CONVERGED,
    CURVE_INTENSITY,
    INFORMED,
    NOT_INFORMED,
    SMALLEST_INTENSITY_SPAN,
    Estimate,
)
from rpms_ros.identification.model.levenberg_marquardt import Ending, minimiser
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    coordinates,
    from_coordinates,
    recruitment_curve,
)
from rpms_ros.muscle.recruitment import PARAMETER_NAMES
from rpms_ros.muscle.twitch import BY_LOGARITHM, BY_ONSET, BY_ORDER, TWITCH, twitch_row
from rpms_ros.pulses import FloatArray, IntArray


class Uncertainty(NamedTuple):
    """Gaussian uncertainty of [theta, w], alpha as logarithms.

    Attributes
    ----------
    covariance : ndarray (recruitment + functions, recruitment + functions)
        Of the recruitment and w.
    confidence : float
        Level of the intervals.
    theta, linear : ndarray (recruitment,), (functions,)
        Where the covariance holds.
    """

    covariance: FloatArray
    confidence: float
    theta: FloatArray
    linear: FloatArray

    @property
    def quantile(self) -> float:
        """Half width of an interval in standard deviations."""
        return float(ndtri(0.5 + 0.5 * self.confidence))

    def without(self, part: slice) -> 'Uncertainty':
        """Return that of the others, whatever these of the recruitment are."""
        rest = np.delete(np.delete(self.covariance, part, axis=0), part, axis=1)
        return self._replace(covariance=rest)

    def gradient(self, area: FloatArray, height: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return that of steady forces (n, unknowns), of which a response has `area` (functions,).

        `height` (n,) and `slopes` (n, recruitment) are the recruitment where the covariance holds.
        """
        return np.hstack((float(area @ self.linear) * slopes, np.outer(height, area)))

    def half_width(self, gradient: FloatArray, misfit: FloatArray | float = 0.0) -> FloatArray:
        """Return half the interval (n,) of quantities with this gradient (n, unknowns).

        `misfit` is the standard deviation (n,) of the error of the model itself.
        """
        variance = np.einsum('ij,jk,ik->i', gradient, self.covariance, gradient)
        width: FloatArray = self.quantile * np.sqrt(np.maximum(variance, 0.0) + misfit**2)
        return width


# What is missing, as a multiple of what the residuals show of it: such that intervals hold in
# bench/misfit.py, with T_a of 10 to 90 ms and latencies up to 24 ms.
_SHOWN = 2.5
# Error of theta, alpha as logarithms, where the area of the response is wrong by all of it.
_TAKEN_UP: FloatArray = np.array([0.1, 0.1, 1.0, 1.0])
# Error of the curve's shape, as a share of that of its height, and where it begins.
_SHAPE, _LOW = 0.3, 0.1
# Standard deviations by which sums of white residuals vary; what is within them does not count.
_CHANCE = 1.0


class ResidualSums(NamedTuple):
    """Sums of residuals over cells of the time.

    Attributes
    ----------
    spread : ndarray (lengths,)
        Mean of (sum of residuals)^2 / samples in the cells of each length [N^2], the shortest
        first.
    cells : float
        Number of the shortest cells.
    samples, seconds : float
        Number of the samples, and the time that they cover.
    recruited : float
        Sum of the squared recruitment of the pulses.
    """

    spread: FloatArray
    cells: float
    samples: float
    seconds: float
    recruited: float

    def missing_area(self, variance: float) -> float:
        """Return the standard deviation of the area of a response by its misfit [N s].

        `variance` is that of the residuals [N^2].
        """
        if not (self.cells > 1.0 and self.samples > 0.0 and self.recruited > 0.0):
            return 0.0
        by_chance = variance * (1.0 + _CHANCE * math.sqrt(2.0 / self.cells))
        beyond = max(float(self.spread[0]) - by_chance, 0.0)
        area_squared = beyond * self.seconds**2 / (self.samples * self.recruited)
        return _SHOWN * math.sqrt(area_squared)


class Muscle(NamedTuple):
    """What a fit has found.

    Attributes
    ----------
    theta, linear : ndarray (4,) or (4 + sines,), (functions,)
        Recruitment, and w.
    levels : ndarray (levels,)
        Levels of the baseline [N].
    moved : float
        Largest change of theta in the last step, alpha as logarithms.
    damping, condition : float
        Of the last step, and condition number of the equations of w; 0 if there is none.
    area_error : float
        Standard deviation of the area of the response by what the functions miss of it [N s].
    curve_error : float
        That of the curve by what the sines miss of it, as a share of its end.
    model_error : float
        That of curve and response by what no muscle of the model does, as such a share.
    unnoticed : ndarray (recruitment + functions, recruitment + functions) or float
        Covariance by forces that are too small to be noticed, as that of `Uncertainty`.
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray
    moved: float
    damping: float = 0.0
    condition: float = 0.0
    area_error: float = 0.0
    curve_error: float = 0.0
    model_error: float = 0.0
    unnoticed: FloatArray | float = 0.0


LEAST_GAIN = 0.7
SETTLED: FloatArray = np.array([0.01, 0.01, 0.15, 0.15])
SETTLED.flags.writeable = False


def identifiability(deviation: FloatArray, prior: FloatArray, moved: float) -> IntArray:
    """Return one flag per parameter (4,).

    Parameters
    ----------
    deviation, prior : ndarray (4,)
        Standard deviations of the estimate and of the prior, alpha as logarithms.
    moved : float
        Largest change in the last step, in the same units.
    """
    flags = np.full(len(deviation), INFORMED, dtype=np.int64)
    flags[(deviation < SETTLED) & (moved < SETTLED)] = CONVERGED
    flags[~(deviation < LEAST_GAIN * prior)] = NOT_INFORMED
    return flags


# Damped steps to the nearest arctangents, on this grid of intensities; the weak prior keeps the
# parameters that a curve does not show.
_NEAREST_STEPS, _WEAK = 12, 1e-6
_GRID: FloatArray = np.linspace(0.02, 1.0, 50)


def nearest_arctangents(theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the arctangents that are nearest to a recruitment but for a factor.

    Returns
    -------
    parameters : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr: those of `theta` where there is no deviation.
    derivative : ndarray (4, len(theta))
        By `theta`; alpha as logarithms on both sides.
    factor : float
        By which the recruitment exceeds them.
    """
    here = coordinates(theta)
    if not theta[PARAMETERS:].any():
        return theta[:PARAMETERS].copy(), np.eye(PARAMETERS, len(theta)), 1.0
    curve, slopes = recruitment_curve(_GRID, theta)
    found, gain, damping = here[:PARAMETERS].copy(), 1.0, 1e-3
    weak = _WEAK * np.eye(PARAMETERS + 1)

    def equations(found: FloatArray, gain: float) -> tuple[FloatArray, FloatArray]:
        shape, gradient = recruitment_curve(_GRID, from_coordinates(found))
        return np.column_stack((gain * gradient, shape)), curve - gain * shape

    columns, rest = equations(found, gain)
    for _ in range(_NEAREST_STEPS):
        square = columns.T @ columns
        damped = square + damping * np.diag(np.diag(square)) + weak
        pull = weak[:, :PARAMETERS] @ (here[:PARAMETERS] - found)
        step = np.linalg.solve(damped, columns.T @ rest + pull)
        step /= max(1.0, float(np.abs(step).max()) / 0.3)
        trial = equations(found + step[:PARAMETERS], gain + step[-1])
        if trial[1] @ trial[1] <= rest @ rest:
            found, gain = found + step[:PARAMETERS], gain + float(step[-1])
            columns, rest = trial
            damping *= 0.1
        else:
            damping *= 10.0
    square = columns.T @ columns + weak
    derivative = np.linalg.solve(square, columns.T @ slopes).astype(np.float64)
    return from_coordinates(found), derivative[:PARAMETERS], gain


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
    response: Coefficients, match: TwitchMatch, hessian: FloatArray, gradient: FloatArray
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


_minimise = minimiser(_linearise, _room, _move)


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
    ending = Ending(_STEPS, _TOLERANCE, 1.0)
    return trial if _minimise(response, match, trial, ending) else match


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


class TwitchReader:
    """Reads the twitch off coefficients of a basis.

    Parameters
    ----------
    basis : LaguerreBasis
        The basis.
    wide : bool
        Use a wide prior around the basis instead of that of `PRIOR`.
    """

    def __init__(self, basis: LaguerreBasis, wide: bool = False) -> None:
        self._prior, step = _PEOPLE, _GRID_STEP
        if wide:
            centre = np.array([basis.time_constant, basis.latency + 1e-3, 3.0])
            centre = np.clip(centre, _PEOPLE.lower, _PEOPLE.upper)
            self._prior = _PEOPLE._replace(centre=centre, deviation=_WIDE_DEVIATION)
            step = min(_GRID_STEP, basis.time_constant / 10.0)
        self._lag = np.arange(step / 2, basis.duration, step)
        self._projection = np.asarray(np.linalg.pinv(basis.evaluate(self._lag)), np.float64)

    def read(
        self, response: FloatArray, covariance: FloatArray, misfit: float = MISFIT
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Fit the twitch.

        Parameters
        ----------
        response, covariance : ndarray (functions,), (functions, functions)
            Coefficients of the response at full intensity, and their covariance.
        misfit : float
            Error of the basis, relative to the norm of the coefficients.

        Returns
        -------
        tuple of ndarray, or None
            Numbers of `PHYSIOLOGY_NAMES`, their standard deviations, and the coefficients
            (functions,) of that twitch; None if the response does not differ from zero by two
            standard deviations.
        """
        length = float(np.linalg.norm(response))
        if not length > 2.0 * float(np.sqrt(max(np.trace(covariance), 0.0))):
            return None
        noise = covariance + (misfit * length) ** 2 * np.eye(len(response))
        factor = np.linalg.cholesky(noise)
        whiten = np.linalg.inv(factor)
        projection = whiten @ self._projection
        match = match_twitch(Coefficients(self._lag, projection, whiten @ response, self._prior))
        jacobian = np.column_stack((match.peak * match.columns[:, 1:], match.columns[:, 0]))
        information = jacobian.T @ jacobian
        information[:3, :3] += np.diag(self._prior.deviation**-2)
        inverse = np.linalg.inv(information + 1e-12 * np.eye(4))
        deviations = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        course = match.peak * (factor @ match.columns[:, 0])
        return np.append(match.theta, match.peak), deviations, course


RESPONSE_STEP = 5e-3
RESPONSE_DURATION = 0.4


class Counters(NamedTuple):
    """Properties of the data of an estimator.

    Attributes
    ----------
    samples, pulses : int
        How many were used.
    intensity_range : tuple of float
        Lowest and highest intensity above 0, shares of the maximum.
    output_error : float
        A-priori error over the last second, relative to the force.
    """

    samples: int
    pulses: int
    intensity_range: tuple[float, float]
    output_error: float


RecruitmentCurve = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


class EstimateBuilder:
    """Makes estimates of one estimator.

    Parameters
    ----------
    name : str
        Name of the estimator.
    basis : LaguerreBasis
        Basis of the response.
    rate_hz : float
        Rate for which the curve is stated [Hz].
    confidence : float
        Level of the intervals.
    wide : bool
        Whether the samples chose the basis: see `TwitchReader`.  What functions that were not
        chosen miss of a twitch is in the interval of the response.
    curve : callable
        Recruitment and its derivatives, as `recruitment_curve`.
    """

    def __init__(
        self,
        name: str,
        basis: LaguerreBasis,
        rate_hz: float,
        confidence: float,
        wide: bool,
        curve: RecruitmentCurve = recruitment_curve,
    ) -> None:
        self._recruitment = curve
        self._name = name
        self._basis = basis
        self._rate_hz = rate_hz
        self._confidence = confidence
        self._chosen, self._reader = wide, TwitchReader(basis, wide)
        self._time = np.arange(0.0, RESPONSE_DURATION, RESPONSE_STEP)
        self._values = basis.evaluate(self._time)

    def make(
        self,
        stamp_ns: int,
        found: Muscle,
        sure: Uncertainty | None,
        deviation: FloatArray,
        counters: Counters,
        faults: Mapping[str, int],
    ) -> Estimate:
        """Return the estimate of a muscle with its uncertainty.

        `deviation` (4,) is the standard deviation of the prior of the parameters, alpha as
        logarithms: none of theirs is larger.
        """
        names = tuple(f'basis_{index + 1}' for index in range(len(found.linear)))
        levels = tuple(f'baseline_{index + 1}' for index in range(len(found.levels)))
        parameters, derivative, factor = nearest_arctangents(found.theta)
        taken_up = np.zeros(len(CURVE_INTENSITY))
        fields: dict[str, Any] = {}
        if sure is not None:
            part = slice(len(found.theta))
            covariance = derivative @ sure.covariance[part, part] @ derivative.T
            place = np.arange(PARAMETERS)
            most = np.maximum(deviation**2 - covariance[place, place], 0.0)
            misfit = np.minimum((self._share(found) * _TAKEN_UP) ** 2, most)
            covariance[place, place] += misfit
            # The recruitment takes up a part of what the response lacks.  By the nearest
            # arctangents: those of theta and its deviation stand in for each other.
            slopes = factor * recruitment_curve(CURVE_INTENSITY, parameters)[1]
            taken_up = np.sqrt(np.square(slopes) @ misfit)
            spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
            scale = np.minimum(1.0, deviation / spread)
            spread = spread * scale
            scale[2:] *= parameters[2:]
            fields |= {
                'confidence': self._confidence,
                'nonlinear_covariance': covariance * np.outer(scale, scale),
                'nonlinear_identifiability': identifiability(spread, deviation, found.moved),
                'condition_number': found.condition,
            }
        fields |= self._curve(found, sure, taken_up, *counters.intensity_range)
        fields |= self._response(found, sure, float(taken_up[-1]))
        return Estimate(
            stamp_ns=stamp_ns,
            estimator=self._name,
            nonlinear_names=PARAMETER_NAMES,
            nonlinear=parameters,
            linear_names=names + levels,
            linear=np.concatenate((found.linear, found.levels)),
            repetition_rate=self._rate_hz,
            curve_intensity=CURVE_INTENSITY,
            response_time=self._time,
            output_error=counters.output_error,
            samples=counters.samples,
            pulses=counters.pulses,
            damping=found.damping,
            faults=dict(faults),
            **fields,
        )

    def _share(self, found: Muscle) -> float:
        """Return the error of the height of the response as a share of it."""
        area = abs(float(self._basis.area @ found.linear))
        share = found.area_error / max(area, found.area_error, 1e-300)
        return math.hypot(share, found.model_error)

    def _curve(
        self,
        found: Muscle,
        sure: Uncertainty | None,
        taken_up: FloatArray,
        low: float,
        high: float,
    ) -> dict[str, FloatArray]:
        """Return K rho(u) and its bounds [N]; empty if there was one intensity only.

        `taken_up` (n,) is the deviation of the recruitment by what the response lacks.
        """
        if not high - low >= SMALLEST_INTENSITY_SPAN:
            return {'curve_force': np.empty(0)}
        area = self._rate_hz * self._basis.area
        rho, _ = self._recruitment(CURVE_INTENSITY, found.theta)
        gain = float(area @ found.linear)
        curve = gain * rho
        if sure is None:
            return {'curve_force': curve}
        gradient = sure.gradient(area, *self._recruitment(CURVE_INTENSITY, sure.theta))
        # an error of the shape does not end where the recruitment is small
        shape = rho[-1] * np.minimum(CURVE_INTENSITY / _LOW, 1.0)
        error = self._rate_hz * found.area_error
        of_curve = gain * math.hypot(found.curve_error, found.model_error)
        of_shape = math.hypot(_SHAPE * max(error, MISFIT * abs(gain)), of_curve)
        misfit = np.linalg.norm((error * rho, of_shape * shape, gain * taken_up), axis=0)
        half = sure.half_width(gradient, misfit)
        lower, upper = curve - half, curve + half
        # below the lowest intensity the force is only known to be no larger than there
        unseen = low > CURVE_INTENSITY
        lower[unseen] = np.minimum(lower[unseen], 0.0)
        upper[unseen] = np.maximum(upper[unseen], np.interp(low, CURVE_INTENSITY, upper))
        return {'curve_force': curve, 'curve_lower': lower, 'curve_upper': upper}

    def _response(
        self, found: Muscle, sure: Uncertainty | None, taken_up: float
    ) -> dict[str, Any]:
        """Return the response to a pulse of full intensity, and its physiology."""
        linear = found.linear
        rho, _ = recruitment_curve(np.ones(1), found.theta)
        response = rho[0] * (self._values @ linear)
        if sure is None:
            return {'response_force': response}
        height, slopes = recruitment_curve(np.ones(1), sure.theta)
        to_coefficients = np.hstack(
            (np.outer(sure.linear, slopes[0]), height[0] * np.eye(len(linear)))
        )
        share = max(MISFIT, self._share(found))
        misfit = share * rho[0] * np.linalg.norm(linear) * np.linalg.norm(self._values, axis=1)
        covariance = to_coefficients @ (sure.covariance + found.unnoticed) @ to_coefficients.T
        covariance += taken_up**2 * np.outer(linear, linear)
        fields: dict[str, Any] = {'response_force': response}
        if (twitch := self._reader.read(rho[0] * linear, covariance, share)) is not None:
            values, deviations, course = twitch
            width = sure.quantile * deviations
            if not self._chosen:
                # of a twitch that begins late the functions take another course for it, of which
                # slow intensities leave no trace
                missed = course - rho[0] * linear
                covariance += np.outer(missed, missed)
            # No muscle answers before its pulse, and none of the others can be negative either,
            # but where the force is upside down.
            fields |= {
                'physiology_names': PHYSIOLOGY_NAMES,
                'physiology': values,
                'physiology_lower': np.maximum(values - width, np.minimum(values, 0.0)),
                'physiology_upper': values + width,
            }
        half = sure._replace(covariance=covariance).half_width(self._values, misfit)
        return fields | {'response_lower': response - half, 'response_upper': response + half}


def condition_number(matrix: FloatArray) -> float:
    """Return the condition number of a symmetric matrix, rows scaled to 1; 0 if unknown."""
    scale = np.sqrt(np.diag(matrix))
    if not scale.min() > 0.0:
        return 0.0
    magnitude = np.abs(np.linalg.eigvalsh(matrix / np.outer(scale, scale), UPLO='L'))
    return float(magnitude.max() / magnitude.min()) if magnitude.min() > 0.0 else math.inf
