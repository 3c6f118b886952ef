# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Estimates from a fit: curve, response, physiology, each with its interval.

**Uncertainty.** The covariance of [theta, w] is ``s^2 (M + C)^-1`` with M the Gauss-Newton
matrix of the joint problem and C that of the prior. ``s^2`` is the variance of the residuals,
times the factor by which sums of neighbouring residuals vary more than those of white noise:
drift, an artifact or a misfit of the basis correlate neighbouring residuals, and then a sample
informs less than an independent one.

**Misfit.** A response that lacks an area ``a_k`` in the time between ``k`` and ``k + 1``
blocks after its pulse leaves residuals whose sum over block b is ``sum_k a_k rho_(b-k) / dt``.
With intensities that differ from pulse to pulse the mean square of these sums is that of
``rho`` times ``sum_k a_k^2``, beyond what white residuals have. The signs are not known: taken
as random, the error of the area, to which the recruitment curve is proportional, is the root
of ``sum_k a_k^2``. The fit has taken up a part of what is missing, so it is multiplied by
`_SHOWN`.

Drift, voluntary effort and a changed muscle leave such sums too, and are an error of the curve
too.

**Identifiability.**

* not informed: the standard deviation is above 0.7 of that of the prior: the data have not halved
  the variance.
* converged: it is below `SETTLED`, and the last step was smaller than that.
* informed: neither.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification.estimation.gauss_newton import Fit, weak_ridge
from rpms_ros.identification.estimation.settings import PARAMETERS, Prior
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import (
    CONVERGED,
    CURVE_INTENSITY,
    INFORMED,
    NOT_INFORMED,
    SMALLEST_INTENSITY_SPAN,
    Estimate,
)
from rpms_ros.identification.model.physiology import MISFIT, PHYSIOLOGY_NAMES, TwitchReader
from rpms_ros.muscle.recruitment import (
    PARAMETER_NAMES,
    RecruitmentParameters,
    identified_recruitment_with_gradient,
)
from rpms_ros.pulses import FloatArray, IntArray

_ROUNDING = 1e-12
# Lengths over which residuals are summed to find their correlation [ns].
_BLOCK_NS = (100_000_000, 500_000_000, 2_000_000_000)
# Error of theta, alpha as logarithms, where the area of the response is wrong by all of it.
_TAKEN_UP: FloatArray = np.array([0.1, 0.1, 1.0, 1.0])
SHORTEST_CELL_NS = _BLOCK_NS[0]
"""Shortest of them [ns]."""


def residual_spread(start_ns: IntArray, count: FloatArray, sums: FloatArray) -> FloatArray:
    """Return, for some lengths, the mean of (sum of residuals)^2 / samples in blocks [N^2].

    For white residuals each is their variance; where they are correlated it is larger, by the
    factor by which a naive covariance is too small.

    Parameters
    ----------
    start_ns, count, sums : ndarray (blocks,)
        Begin, number of samples and sum of the residuals of consecutive blocks.
    """
    spread = np.zeros(len(_BLOCK_NS))
    for place, length in enumerate(_BLOCK_NS):
        begins = np.flatnonzero(np.diff(start_ns // length)) + 1
        begins = np.concatenate(([0], begins))
        samples = np.add.reduceat(count, begins)
        inside = np.add.reduceat(sums, begins)
        some = samples > 0.0
        if some.any():
            spread[place] = float(np.mean(inside[some] ** 2 / samples[some]))
    return spread


@dataclass(frozen=True)
class Uncertainty:
    """Gaussian uncertainty of [theta, w], alpha as logarithms.

    Attributes
    ----------
    covariance : ndarray (4 + functions, 4 + functions)
        Of theta and w.
    theta : ndarray (4,)
        Parameters at which it is expanded.
    confidence : float
        Level of the intervals.
    """

    covariance: FloatArray
    theta: FloatArray
    confidence: float

    @property
    def parameter_covariance(self) -> FloatArray:
        """Covariance of u_thr, u_sat, alpha_sat, alpha_thr themselves (4, 4)."""
        scale = np.concatenate((np.ones(2), self.theta[2:]))
        part = self.covariance[:PARAMETERS, :PARAMETERS]
        result: FloatArray = part * np.outer(scale, scale)
        return result

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of theta, alpha as logarithms (4,)."""
        result: FloatArray = np.sqrt(np.diag(self.covariance)[:PARAMETERS])
        return result

    @property
    def quantile(self) -> float:
        """Half width of an interval in standard deviations."""
        return float(ndtri(0.5 + 0.5 * self.confidence))

    def with_misfit(self, share: float, deviation: FloatArray) -> 'Uncertainty':
        """Return the uncertainty where the response is wrong by a share of its area.

        The recruitment takes up a part of what the response lacks.  No standard deviation exceeds
        that of the prior, `deviation` (4,).
        """
        own = np.diag(self.covariance)[:PARAMETERS]
        most = np.maximum(deviation**2 - own, 0.0)
        covariance = self.covariance.copy()
        place = np.arange(PARAMETERS)
        covariance[place, place] += np.minimum((share * _TAKEN_UP) ** 2, most)
        return replace(self, covariance=covariance)

    def half_width(self, gradient: FloatArray, misfit: FloatArray | float = 0.0) -> FloatArray:
        """Return half the interval (n,) of quantities with this gradient (n, 4 + functions).

        `misfit` is the standard deviation (n,) of the error of the model itself.
        """
        variance = np.einsum('ij,jk,ik->i', gradient, self.covariance, gradient)
        width: FloatArray = self.quantile * np.sqrt(np.maximum(variance, 0.0) + misfit**2)
        return width


def uncertainty(
    fit: Fit, prior: Prior, spread: FloatArray, confidence: float
) -> Uncertainty | None:
    """Return the uncertainty of a fit whose equations are complete.

    Parameters
    ----------
    fit, prior : Fit, Prior
        State of the estimator.
    spread : ndarray (lengths,)
        See `residual_spread` [N^2].
    confidence : float
        Level of the intervals.

    Returns
    -------
    Uncertainty or None
        None while there is no sample.
    """
    if not fit.samples[0] > 0.0:
        return None
    joint = PARAMETERS + len(fit.linear)
    lower = np.tril(fit.complete)
    matrix = lower + lower.T - np.diag(np.diag(lower))
    variance = float(fit.variance[0])
    theta = np.arange(PARAMETERS)
    matrix[theta, theta] += variance / prior.deviation**2
    linear = np.arange(PARAMETERS, len(matrix))
    matrix[linear, linear] += weak_ridge(fit)
    scale = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(scale, scale) + _ROUNDING * np.eye(len(matrix))
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    inflation = max(1.0, float(spread.max(initial=0.0)) / variance)
    inverse = 0.5 * (inverse + inverse.T) * variance
    inverse[PARAMETERS:] *= np.sqrt(inflation)
    inverse[:, PARAMETERS:] *= np.sqrt(inflation)
    inverse = _inflate_parameters(inverse, prior, inflation)
    return Uncertainty(inverse[:joint, :joint], fit.theta.copy(), confidence)


def _inflate_parameters(covariance: FloatArray, prior: Prior, factor: float) -> FloatArray:
    """Inflate the covariance of theta, each deviation at most to that of the prior."""
    deviation = np.sqrt(np.maximum(np.diag(covariance)[:PARAMETERS], 0.0))
    most = np.maximum(prior.deviation / np.maximum(deviation, 1e-300), 1.0)
    scale = np.ones(len(covariance))
    scale[:PARAMETERS] = np.minimum(np.sqrt(factor), most)
    result: FloatArray = covariance * np.outer(scale, scale)
    return result


# What is missing, as a multiple of what the residuals show of it: such that intervals hold in
# bench/misfit.py, with T_a of 10 to 90 ms and latencies up to 24 ms.
_SHOWN = 2.5
# Standard deviations by which sums of white residuals vary; what is within them does not count.
_CHANCE = 1.0


@dataclass(frozen=True)
class ResidualSums:
    """Sums of residuals over cells of the time.

    Attributes
    ----------
    spread : ndarray (lengths,)
        Mean of (sum of residuals)^2 / samples in the cells of each length [N^2], the shortest
        first; see `uncertainty.residual_spread`.
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


RESPONSE_STEP = 5e-3
RESPONSE_DURATION = 0.4


@dataclass(frozen=True)
class Counters:
    """Properties of the data of an estimator.

    Attributes
    ----------
    samples, pulses : int
        How many were used.
    intensity_span : float
        Highest minus lowest intensity, share of the maximum.
    output_error : float
        A-priori error over the last second, relative to the force.
    """

    samples: int
    pulses: int
    intensity_span: float
    output_error: float


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
        See `TwitchReader`.
    """

    def __init__(
        self,
        name: str,
        basis: LaguerreBasis,
        rate_hz: float,
        confidence: float,
        wide: bool = False,
    ) -> None:
        self._name = name
        self._basis = basis
        self._rate_hz = rate_hz
        self._confidence = confidence
        self._reader = TwitchReader(basis, wide=wide)
        self._time = np.arange(0.0, RESPONSE_DURATION, RESPONSE_STEP)
        self._values = basis.evaluate(self._time)

    def make(
        self,
        stamp_ns: int,
        fit: Fit,
        prior: Prior,
        residuals: ResidualSums,
        counters: Counters,
        faults: Mapping[str, int],
    ) -> Estimate:
        """Return the estimate of a fit whose equations are complete."""
        sure = uncertainty(fit, prior, residuals.spread, self._confidence)
        missing = residuals.missing_area(float(fit.variance[0]))
        if sure is not None and missing > 0.0:
            sure = sure.with_misfit(missing / max(self._area(fit), missing), prior.deviation)
        length = float(np.linalg.norm(fit.linear) * np.linalg.norm(self._basis.area))
        by_basis = MISFIT * length / math.sqrt(len(fit.linear))
        area_error = math.hypot(by_basis, missing)
        return self.stated(stamp_ns, fit, sure, prior.deviation, counters, faults, area_error)

    def stated(
        self,
        stamp_ns: int,
        fit: Fit,
        sure: Uncertainty | None,
        deviation: FloatArray,
        counters: Counters,
        faults: Mapping[str, int],
        area_error: float = 0.0,
    ) -> Estimate:
        """Return the estimate of a fit with a given uncertainty.

        `deviation` (4,) is the standard deviation of the prior of theta, alpha as logarithms;
        `area_error` that of the area of the response by what the functions miss of it [N s].
        """
        count = len(fit.linear)
        names = tuple(f'basis_{index + 1}' for index in range(count))
        levels = tuple(f'baseline_{index + 1}' for index in range(len(fit.levels)))
        fields: dict[str, Any] = {}
        if sure is not None:
            fields |= {
                'confidence': self._confidence,
                'nonlinear_covariance': sure.parameter_covariance,
                'nonlinear_identifiability': identifiability(
                    sure.deviations, deviation, float(fit.moved[0])
                ),
                'condition_number': _condition(fit),
            }
        fields |= self._curve(fit, sure, counters.intensity_span, area_error)
        fields |= self._response(fit, sure, area_error)
        return Estimate(
            stamp_ns=stamp_ns,
            estimator=self._name,
            nonlinear_names=PARAMETER_NAMES,
            nonlinear=fit.theta.copy(),
            linear_names=names + levels,
            linear=np.concatenate((fit.linear, fit.levels)),
            repetition_rate=self._rate_hz,
            curve_intensity=CURVE_INTENSITY,
            response_time=self._time,
            output_error=counters.output_error,
            samples=counters.samples,
            pulses=counters.pulses,
            damping=float(fit.damping[0]),
            faults=dict(faults),
            **fields,
        )

    def _area(self, fit: Fit) -> float:
        """Return the size of the area of the response [N s]."""
        return abs(float(self._basis.area @ fit.linear))

    def _curve(
        self, fit: Fit, sure: Uncertainty | None, span: float, area_error: float
    ) -> dict[str, FloatArray]:
        """Return K rho(u) and its bounds [N]; empty if there was one intensity only."""
        if not span >= SMALLEST_INTENSITY_SPAN:
            return {'curve_force': np.empty(0)}
        area = self._rate_hz * self._basis.area
        rho, slopes = _recruitment(fit, CURVE_INTENSITY)
        gain = float(area @ fit.linear)
        curve = gain * rho
        if sure is None:
            return {'curve_force': curve}
        misfit = self._rate_hz * area_error * rho
        half = sure.half_width(np.hstack((gain * slopes, np.outer(rho, area))), misfit)
        return {'curve_force': curve, 'curve_lower': curve - half, 'curve_upper': curve + half}

    def _response(self, fit: Fit, sure: Uncertainty | None, area_error: float) -> dict[str, Any]:
        """Return the response to a pulse of full intensity, and its physiology."""
        rho, slopes = _recruitment(fit, np.ones(1))
        response = rho[0] * (self._values @ fit.linear)
        if sure is None:
            return {'response_force': response}
        to_coefficients = np.hstack(
            (np.outer(fit.linear, slopes[0]), rho[0] * np.eye(len(fit.linear)))
        )
        share = max(MISFIT, area_error / max(self._area(fit), area_error, 1e-300))
        misfit = share * rho[0] * np.linalg.norm(fit.linear) * np.linalg.norm(self._values, axis=1)
        half = sure.half_width(self._values @ to_coefficients, misfit)
        fields: dict[str, Any] = {
            'response_force': response,
            'response_lower': response - half,
            'response_upper': response + half,
        }
        covariance = to_coefficients @ sure.covariance @ to_coefficients.T
        twitch = self._reader.read(rho[0] * fit.linear, covariance, share)
        if twitch is not None:
            width = sure.quantile * twitch.deviations
            # No muscle answers before its pulse, and none of the others can be negative either.
            fields |= {
                'physiology_names': PHYSIOLOGY_NAMES,
                'physiology': twitch.values,
                'physiology_lower': np.maximum(twitch.values - width, 0.0),
                'physiology_upper': twitch.values + width,
            }
        return fields


def _recruitment(fit: Fit, intensity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rho (n,) and its derivatives (n, 4), by the logarithms of alpha."""
    parameters = RecruitmentParameters(*(float(value) for value in fit.theta))
    rho, slopes = identified_recruitment_with_gradient(parameters, intensity)
    return rho, slopes * np.concatenate((np.ones(2), fit.theta[2:]))


def _condition(fit: Fit) -> float:
    """Return the condition number of the normal equations of w, 0 if unknown."""
    part = slice(PARAMETERS, PARAMETERS + len(fit.linear))
    matrix = np.tril(fit.complete[part, part])
    scale = np.sqrt(np.diag(matrix))
    if not scale.min() > 0.0:
        return 0.0
    magnitude = np.abs(np.linalg.eigvalsh(matrix / np.outer(scale, scale), UPLO='L'))
    return float(magnitude.max() / magnitude.min()) if magnitude.min() > 0.0 else np.inf
