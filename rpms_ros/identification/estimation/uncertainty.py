# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Estimates from a fit: curve, response, physiology, each with its interval.

**Uncertainty.** The covariance of [theta, w] is ``s^2 (M + C)^-1`` with M the Gauss-Newton
matrix of the joint problem and C that of the prior. ``s^2`` is the variance of the residuals,
times the factor by which sums of neighbouring residuals vary more than those of white noise:
drift, an artifact or a misfit of the basis correlate neighbouring residuals, and then a sample
informs less than an independent one.

**Parameters.** u_thr, u_sat and both alpha are those of the arctangents that are nearest to the
recruitment curve (`model.recruitment`): the paper's parameters where it does not deviate.

**Identifiability.**

* not informed: the standard deviation is above 0.7 of that of the prior: the data have not halved
  the variance.
* converged: it is below `SETTLED`, and the last step was smaller than that.
* informed: neither.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
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
from rpms_ros.identification.model.physiology import MISFIT, PHYSIOLOGY_NAMES, TwitchReader
from rpms_ros.identification.model.recruitment import (
    nearest_arctangents,
    recruitment_curve,
)
from rpms_ros.muscle.recruitment import PARAMETER_NAMES
from rpms_ros.pulses import FloatArray, IntArray


@dataclass(frozen=True)
class Uncertainty:
    """Gaussian uncertainty of [theta, w], alpha as logarithms.

    Attributes
    ----------
    covariance : ndarray (recruitment + functions, recruitment + functions)
        Of theta, with 4 or 24 elements, and w.
    confidence : float
        Level of the intervals.
    """

    covariance: FloatArray
    confidence: float

    @property
    def quantile(self) -> float:
        """Half width of an interval in standard deviations."""
        return float(ndtri(0.5 + 0.5 * self.confidence))

    def half_width(self, gradient: FloatArray, misfit: FloatArray | float = 0.0) -> FloatArray:
        """Return half the interval (n,) of quantities with this gradient (n, unknowns).

        `misfit` is the standard deviation (n,) of the error of the model itself.
        """
        variance = np.einsum('ij,jk,ik->i', gradient, self.covariance, gradient)
        width: FloatArray = self.quantile * np.sqrt(np.maximum(variance, 0.0) + misfit**2)
        return width


@dataclass(frozen=True)
class Muscle:
    """What a fit has found.

    Attributes
    ----------
    theta, linear : ndarray (4,) or (24,), (functions,)
        Recruitment, and w.
    levels : ndarray (levels,)
        Levels of the baseline [N].
    moved : float
        Largest change of theta in the last step, alpha as logarithms.
    damping, condition : float
        Of the last step, and condition number of the equations of w; 0 if there is none.
    area_error : float
        Standard deviation of the area of the response by what the functions miss of it [N s].
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray
    moved: float
    damping: float = 0.0
    condition: float = 0.0
    area_error: float = 0.0


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
        parameters, derivative = nearest_arctangents(found.theta)
        fields: dict[str, Any] = {}
        if sure is not None:
            part = slice(len(found.theta))
            covariance = derivative @ sure.covariance[part, part] @ derivative.T
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
        fields |= self._curve(found, sure, counters.intensity_span)
        fields |= self._response(found, sure)
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

    def _curve(
        self, found: Muscle, sure: Uncertainty | None, span: float
    ) -> dict[str, FloatArray]:
        """Return K rho(u) and its bounds [N]; empty if there was one intensity only."""
        if not span >= SMALLEST_INTENSITY_SPAN:
            return {'curve_force': np.empty(0)}
        area = self._rate_hz * self._basis.area
        rho, slopes = recruitment_curve(CURVE_INTENSITY, found.theta)
        gain = float(area @ found.linear)
        curve = gain * rho
        if sure is None:
            return {'curve_force': curve}
        misfit = self._rate_hz * found.area_error * rho
        half = sure.half_width(np.hstack((gain * slopes, np.outer(rho, area))), misfit)
        return {'curve_force': curve, 'curve_lower': curve - half, 'curve_upper': curve + half}

    def _response(self, found: Muscle, sure: Uncertainty | None) -> dict[str, Any]:
        """Return the response to a pulse of full intensity, and its physiology."""
        linear = found.linear
        rho, slopes = recruitment_curve(np.ones(1), found.theta)
        response = rho[0] * (self._values @ linear)
        if sure is None:
            return {'response_force': response}
        to_coefficients = np.hstack((np.outer(linear, slopes[0]), rho[0] * np.eye(len(linear))))
        area = abs(float(self._basis.area @ linear))
        share = max(MISFIT, found.area_error / max(area, found.area_error, 1e-300))
        misfit = share * rho[0] * np.linalg.norm(linear) * np.linalg.norm(self._values, axis=1)
        half = sure.half_width(self._values @ to_coefficients, misfit)
        fields: dict[str, Any] = {
            'response_force': response,
            'response_lower': response - half,
            'response_upper': response + half,
        }
        covariance = to_coefficients @ sure.covariance @ to_coefficients.T
        twitch = self._reader.read(rho[0] * linear, covariance, share)
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


def condition_number(matrix: FloatArray) -> float:
    """Return the condition number of a symmetric matrix, rows scaled to 1; 0 if unknown."""
    scale = np.sqrt(np.diag(matrix))
    if not scale.min() > 0.0:
        return 0.0
    magnitude = np.abs(np.linalg.eigvalsh(matrix / np.outer(scale, scale), UPLO='L'))
    return float(magnitude.max() / magnitude.min()) if magnitude.min() > 0.0 else math.inf
