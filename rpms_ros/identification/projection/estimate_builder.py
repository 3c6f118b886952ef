# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates from a fit: curve, response, physiology, each with its interval."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpms_ros.identification.estimate import CURVE_INTENSITY
from rpms_ros.identification.estimate import SMALLEST_INTENSITY_SPAN
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.physiology import MISFIT
from rpms_ros.identification.physiology import PHYSIOLOGY_NAMES
from rpms_ros.identification.physiology import TwitchReader
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.identifiability import identifiability
from rpms_ros.identification.projection.missing_area import ResidualSums
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.uncertainty import Uncertainty
from rpms_ros.identification.projection.uncertainty import uncertainty
from rpms_ros.muscle.identified_form import PARAMETER_NAMES
from rpms_ros.muscle.identified_form import RecruitmentParameters
from rpms_ros.muscle.identified_form import identified_recruitment_with_gradient
from rpms_ros.pulses import FloatArray

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
