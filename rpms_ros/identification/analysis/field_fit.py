# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recruitment field from steady forces, with intervals and a check of its shape."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis import field_model
from rpms_ros.identification.analysis.field_model import intensity_factor
from rpms_ros.identification.analysis.field_model import rate_factor
from rpms_ros.identification.analysis.monotone import rising_product
from rpms_ros.identification.analysis.steady import SteadyPoint
from rpms_ros.muscle import RecruitmentField
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray

LEAST_INTENSITIES = 5
LEAST_RATES = 3
CONFIDENCE = 0.95
_PRIOR = 0.3
_STARTS = ((0.48, 0.98), (0.3, 0.8), (0.6, 0.9), (0.7, 1.2))


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class FieldAnalysis:
    """Recruitment by intensity and rate.

    Attributes
    ----------
    recruitment : RecruitmentField
        rho_u and rho_f; rho(1, 20 Hz) = 1.
    maximum_force : Interval
        Steady force at full intensity and 20 Hz [N].
    parameters : tuple of (str, Interval)
        Numbers of Eqs. (9) and (10); rates in Hz.
    rates_fitted : bool
        Whether there were enough rates to fit rho_f; else it is the average of Table 3.
    points : tuple of SteadyPoint
        Steady forces that were fitted.
    residual : float
        Standard deviation of the residual [share of the greatest force].
    worst_interval : float
        Greatest half width of the 95 % interval of rho over the measured intensities and rates
        [share of its maximum].
    shape_difference : float
        Greatest difference between the formula and the monotone regression, which assumes no
        formula [share of the maximum].
    monotone_intensity, monotone_share : ndarray, shape (levels,)
        Monotone regression by intensity, 1 at its end.
    """

    recruitment: RecruitmentField
    maximum_force: Interval
    parameters: tuple[tuple[str, Interval], ...]
    rates_fitted: bool
    points: tuple[SteadyPoint, ...]
    residual: float
    worst_interval: float
    shape_difference: float
    monotone_intensity: FloatArray
    monotone_share: FloatArray


def fit_field(points: Sequence[SteadyPoint]) -> FieldAnalysis:
    """Fit rho_u and rho_f to steady forces, jointly.

    Raises
    ------
    IdentificationError
        If there are fewer than 5 intensities, or no force rises above the baseline.
    """
    intensity = np.array([point.intensity for point in points])
    rate = np.array([point.rate_hz for point in points])
    force = np.array([point.force for point in points])
    levels = len(np.unique(np.round(intensity, 3)))
    if levels < LEAST_INTENSITIES:
        raise IdentificationError(
            f'expected steady forces at {LEAST_INTENSITIES} intensities or more, got {levels}'
        )
    if not force.max() > 0:
        raise IdentificationError(f'expected a force above the baseline, got {force.max():.3g}')
    several = len(np.unique(np.round(rate))) >= LEAST_RATES
    free = np.ones(1 + len(field_model.NAMES), dtype=np.bool_)
    free[5:8] = several
    theta, jacobian = _fitted(intensity, rate, force / force.max(), free)
    return _described(tuple(points), intensity, rate, force, theta, jacobian, free)


def _model(theta: FloatArray, intensity: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the force relative to the greatest measured one; theta[0] is ln A."""
    shape = intensity_factor(theta[1:], intensity) * rate_factor(theta[1:], rate)
    scaled: FloatArray = np.exp(theta[0]) * shape
    return scaled


def _fitted(
    intensity: FloatArray, rate: FloatArray, force: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return all numbers (9,) and the Jacobian of the free ones, the prior's rows included."""
    lowest = np.concatenate(([-3.0], field_model.LOWEST))
    highest = np.concatenate(([3.0], field_model.HIGHEST))
    centre = np.concatenate(([0.0], field_model.CENTRE))
    noise = _pure_noise(intensity, rate, force)
    weight = _PRIOR * noise / np.concatenate(([10.0], field_model.SPREAD))

    def residual(moved: FloatArray) -> FloatArray:
        theta = centre.copy()
        theta[free] = moved
        misfit = force - _model(theta, intensity, rate)
        order = max(0.0, theta[1] + 0.02 - theta[2])
        return np.concatenate((misfit, (weight * (theta - centre))[free], [10.0 * order]))

    found = []
    for threshold, saturation in _STARTS:
        start = centre.copy()
        start[1:3] = threshold, saturation
        found.append(
            least_squares(
                residual, start[free], bounds=(lowest[free], highest[free]), x_scale='jac'
            )
        )
    best = min(found, key=lambda result: float(result.cost))
    theta = centre.copy()
    theta[free] = best.x
    return theta, np.asarray(best.jac)


def _pure_noise(intensity: FloatArray, rate: FloatArray, force: FloatArray) -> float:
    """Return a first estimate of the noise: the residual of the monotone product."""
    rows, factor, columns, other = rising_product(intensity, rate, force)
    model = factor[np.searchsorted(rows, intensity)] * other[np.searchsorted(columns, rate)]
    return max(float(np.sqrt(np.mean((force - model) ** 2))), 1e-4)


def _described(
    points: tuple[SteadyPoint, ...],
    intensity: FloatArray,
    rate: FloatArray,
    force: FloatArray,
    theta: FloatArray,
    jacobian: FloatArray,
    free: BoolArray,
) -> FieldAnalysis:
    top = float(force.max())
    misfit = force / top - _model(theta, intensity, rate)
    spare = max(1, len(force) - int(free.sum()))
    variance = float(misfit @ misfit) / spare
    covariance = np.zeros((len(theta), len(theta)))
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    # The error of a baseline is common to all levels between two rests and does not average out.
    common = inverse @ (jacobian[: len(points)].T @ _baselines(points)) / top
    covariance[np.ix_(free, free)] = inverse * variance + common @ common.T
    reach = float(stdtrit(spare, 0.5 + CONFIDENCE / 2))
    by_intensity, by_rate = field_model.as_recruitment(theta[1:])
    rows, share, columns, other = rising_product(intensity, rate, force / top)
    return FieldAnalysis(
        recruitment=RecruitmentField(by_intensity, by_rate),
        maximum_force=_maximum_force(theta, covariance, reach, top),
        parameters=_parameters(theta[1:], np.diag(covariance)[1:], reach),
        rates_fitted=bool(free[5]),
        points=points,
        residual=float(np.sqrt(variance)),
        worst_interval=reach * _worst_deviation(theta, covariance, rate),
        shape_difference=_shape_difference(theta, rows, share, columns, other),
        monotone_intensity=rows,
        monotone_share=share,
    )


def _baselines(points: Sequence[SteadyPoint]) -> FloatArray:
    """Return the change of each point by one deviation of each rest (points, rests) [N]."""
    effect = np.zeros((len(points), 2 + max(point.rest for point in points)))
    for row, point in zip(effect, points, strict=True):
        row[point.rest] = (1.0 - point.rest_share) * point.rest_deviation
        row[point.rest + 1] = point.rest_share * point.rest_deviation
    return effect


def _maximum_force(
    theta: FloatArray, covariance: FloatArray, reach: float, top: float
) -> Interval:
    """Return the force at full intensity and 20 Hz, A (1 + c), with the offset c."""
    gradient = np.zeros(len(theta))
    gradient[0], gradient[-1] = 1.0, 1.0 / (1.0 + theta[-1])
    value = theta[0] + np.log1p(theta[-1])
    return _interval(value, float(gradient @ covariance @ gradient), reach, top, logarithm=True)


def _interval(
    value: float, variance: float, reach: float, scale: float = 1.0, logarithm: bool = False
) -> Interval:
    half = reach * float(np.sqrt(max(variance, 0.0)))
    ends = np.array([value, value - half, value + half])
    if logarithm:
        ends = np.exp(np.minimum(ends, 50.0))
    return Interval(*(float(end) * scale for end in ends))


def _parameters(
    theta: FloatArray, variance: FloatArray, reach: float
) -> tuple[tuple[str, Interval], ...]:
    return tuple(
        (name, _interval(theta[k], variance[k], reach, logarithm=name.endswith('_slope')))
        for k, name in enumerate(field_model.NAMES)
    )


def _worst_deviation(theta: FloatArray, covariance: FloatArray, rate: FloatArray) -> float:
    """Return the greatest standard deviation of rho over u in 0..1 and the measured rates."""
    grid = np.meshgrid(np.linspace(0.0, 1.0, 41), np.unique(rate))
    u, f = (axis.ravel() for axis in grid)
    slopes = np.empty((len(u), len(theta)))
    for k in range(len(theta)):
        step = np.zeros_like(theta)
        step[k] = 1e-5
        slopes[:, k] = (_model(theta + step, u, f) - _model(theta - step, u, f)) / 2e-5
    deviation = np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', slopes, covariance, slopes), 0.0))
    return float(deviation.max() / np.abs(_model(theta, u, f)).max())


def _shape_difference(
    theta: FloatArray,
    rows: FloatArray,
    share: FloatArray,
    columns: FloatArray,
    other: FloatArray,
) -> float:
    """Return the greatest distance of the formula from the monotone product, by its maximum."""
    u, f = np.meshgrid(rows, columns, indexing='ij')
    free = share[:, None] * other[None, :]
    return float(np.abs(_model(theta, u, f) - free).max() / np.abs(free).max())
