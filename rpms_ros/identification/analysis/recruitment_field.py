# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The recruitment field (Eqs. 8 to 10) from steady forces, with intervals.

The steady force of a long level (Sec. 2.2, Fig. 9) is the mean over whole periods of the pulses,
after the force has settled, above a baseline that is linear from the rest before one group to the
rest before the next.  To these forces is fitted

.. math:: F(u, f) = A \, \frac{n(u) - n(0)}{n(1) - n(0)} \cdot \frac{m(f) + d}{m(20) + d}
   + A c

A is the steady force at full intensity and 20 Hz; n is the bend of Eq. (9) and m that of
Eq. (10), each without its gain and offset, which follow from A, c and d.  The parameters are not
redundant: seven of the shape, one force, one offset.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for
from scipy.special import stdtrit

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import SETTLING, CleanTrace, Level, PulseGroup
from rpms_ros.identification.analysis.twitch_fits import derivatives
from rpms_ros.identification.quality.explained_force import Stated
from rpms_ros.muscle import (
    IntensityRecruitment,
    RateRecruitment,
    RecruitmentField,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.muscle.subject import REFERENCE_RATE
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds
from rpms_ros.schema import INTERNAL

_LEAST_PERIODS = 4
_REST_SPAN = 0.2


@dataclass(frozen=True)
class SteadyPoint:
    """A level whose force was steady.

    Attributes
    ----------
    intensity : float
        Share of the maximum.
    rate_hz : float
        Repetition rate [Hz].
    force : float
        Mean force above the baseline [N].
    ripple : float
        Greatest minus least mean over the phase of the period [N].
    start_ns : int
        First pulse of the level [ns].
    rest : int
        Index of the rest before the level; the baseline is interpolated to the next one.
    rest_share : float
        Weight of the next rest, 0..1.
    rest_deviation : float
        Standard deviation of the baseline at one rest [N]; its error is common to all levels
        between two rests.
    """

    intensity: float
    rate_hz: float
    force: float
    ripple: float
    start_ns: int
    rest: int = 0
    rest_share: float = 0.0
    rest_deviation: float = 0.0


class Baseline(NamedTuple):
    """Force at rest, between groups of pulses.

    Attributes
    ----------
    time_ns : ndarray of int64, shape (rests,)
        Middles of the rests [ns].
    force : ndarray, shape (rests,)
        Means [N].
    deviation : float
        Standard deviation of each of them, by the scatter of the samples at rest [N].
    """

    time_ns: IntArray
    force: FloatArray
    deviation: float


def resting_force(
    trace: CleanTrace, groups: tuple[PulseGroup, ...], onset_ns: IntArray
) -> Baseline | None:
    """Return the baseline before each group and at the end; None without any rest."""
    span = nanoseconds(_REST_SPAN)
    ends = [int(onset_ns[group.first]) for group in groups]
    if groups and trace.stamp_ns[-1] - onset_ns[-1] > NANOSECONDS_PER_SECOND:
        ends.append(int(trace.stamp_ns[-1]) + 1)
    parts = [(end - span // 2, trace.force[trace.between(end - span, end)]) for end in ends]
    if not (rests := [(time, force) for time, force in parts if len(force)]):
        return None
    return Baseline(
        np.array([time for time, _ in rests]),
        np.array([np.mean(force) for _, force in rests]),
        float(np.sqrt(np.mean([np.var(force) / len(force) for _, force in rests]))),
    )


def steady_point(
    trace: CleanTrace, onset_ns: IntArray, level: Level, baseline: Baseline
) -> SteadyPoint | str:
    """Return the steady force of a level, or why there is none."""
    if not np.isfinite(level.intensity):
        return 'intensity not recorded'
    start = int(onset_ns[level.first])
    period = NANOSECONDS_PER_SECOND / level.rate_hz
    end = float(onset_ns[level.last - 1]) + period
    periods = int((end - start - SETTLING * NANOSECONDS_PER_SECOND) / period + 1e-6)
    if periods < _LEAST_PERIODS:
        return f'level shorter than {SETTLING:g} s and {_LEAST_PERIODS} periods'
    first = end - periods * period
    part = trace.between(round(first), round(end))
    expected = (end - first) / (trace.sample_period * NANOSECONDS_PER_SECOND)
    if part.stop - part.start < 0.9 * expected:
        return 'force samples missing'
    if trace.saturated[part].any():
        return 'sensor saturated'
    middle = 0.5 * (first + end)
    force = trace.force[part] - np.interp(middle, baseline.time_ns, baseline.force)
    tenth = ((trace.stamp_ns[part] - first) / period % 1.0 * 10).astype(np.int64)
    means = [float(np.mean(force[tenth == k])) for k in range(10) if (tenth == k).any()]
    share, rest = np.modf(np.interp(middle, baseline.time_ns, np.arange(len(baseline.time_ns))))
    return SteadyPoint(
        level.intensity,
        level.rate_hz,
        float(force.mean()),
        max(means) - min(means),
        start,
        int(rest),
        float(share),
        baseline.deviation,
    )


@dataclass(frozen=True)
class FieldAnalysis:
    """Recruitment by intensity and rate.

    Attributes
    ----------
    recruitment : RecruitmentField
        rho_u and rho_f; rho(1, 20 Hz) = 1.
    maximum_force : Stated
        Steady force at full intensity and 20 Hz, with its 95 % interval [N].
    parameters : mapping of str to Stated
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
    """

    recruitment: RecruitmentField
    maximum_force: Stated
    parameters: Mapping[str, Stated]
    rates_fitted: bool
    points: tuple[SteadyPoint, ...] = field(metadata=INTERNAL)
    residual: float
    worst_interval: float


# theta is ln A, relative to the greatest measured force, and these.
_NAMES = (
    *('threshold', 'saturation', 'threshold_slope', 'saturation_slope'),
    *('rate_saturation', 'rate_slope', 'rate_offset', 'zero_offset'),
)
CENTRE = np.array(
    [0.0, 0.48, 0.98, np.log(5.0), np.log(4.0), 25.0, np.log(0.05), -0.321 / 0.0597, 0.0]
)
# Standard deviations of a prior: the spread among people (Table 6), or wider than data resolve.
_SPREAD = np.array([10.0, 0.15, 0.15, 0.5, 0.8, 8.0, 0.8, 5.0, 0.05])
_LOWEST = np.array([-3.0, 0.0, 0.3, np.log(0.5), np.log(0.5), 5.0, np.log(0.003), -12.0, -0.3])
_HIGHEST = np.array([3.0, 1.0, 1.8, np.log(60.0), np.log(60.0), 60.0, np.log(1.0), 40.0, 0.3])
_PRIOR = 0.3
# Of the greatest force.
_LEAST_NOISE = 1e-4
_STARTS = ((0.48, 0.98), (0.3, 0.8), (0.6, 0.9), (0.7, 1.2))
_LEAST_INTENSITIES = 5
_LEAST_RATES = 3
CONFIDENCE = 0.95


def field_force(theta: FloatArray, intensity: FloatArray, rate_hz: FloatArray) -> FloatArray:
    """Return the force (...) relative to the greatest measured one; theta (9,), see the module."""
    shape = RecruitmentParameters(theta[1], theta[2], np.exp(theta[4]), np.exp(theta[3]))
    share = identified_recruitment(shape, intensity) / identified_recruitment(shape, 1.0)
    bend = RateRecruitment(theta[5], np.exp(theta[6]), 1.0, 0.0)
    by_rate = (bend(rate_hz) + theta[7]) / (bend(REFERENCE_RATE) + theta[7])
    force: FloatArray = np.exp(theta[0]) * (share + theta[8]) * by_rate
    return force


def as_recruitment(theta: FloatArray) -> RecruitmentField:
    """Return Eqs. (9) and (10) with these parameters (9,), gains and offsets included."""
    threshold, saturation, low, high, rate, slope, rate_offset, offset = theta[1:].tolist()
    plain = IntensityRecruitment(threshold, saturation, np.exp(low), np.exp(high)).normalised()
    unit = RateRecruitment(rate, np.exp(slope), 1.0, 0.0)
    gain = 1.0 / (float(unit(REFERENCE_RATE)) + rate_offset)
    return RecruitmentField(
        replace(plain, offset=plain.offset + offset),
        replace(unit, gain=gain, offset=gain * rate_offset),
    )


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
    if (levels := len(np.unique(np.round(intensity, 3)))) < _LEAST_INTENSITIES:
        fault = f'expected steady forces at {_LEAST_INTENSITIES} intensities or more, got {levels}'
        raise IdentificationError(fault)
    top = float(force.max())
    if not top > 0:
        raise IdentificationError(f'expected a force above the baseline, got {top:.3g}')
    rates_fitted = len(np.unique(np.round(rate))) >= _LEAST_RATES
    free = np.ones(len(CENTRE), dtype=np.bool_)
    free[5:8] = rates_fitted
    noise = _LEAST_NOISE
    # the prior counts as much as the noise, which is known after a first fit
    for _ in range(2):
        theta, jacobian = _fitted(intensity, rate, force / top, free, noise)
        misfit = force / top - field_force(theta, intensity, rate)
        noise = max(float(np.sqrt(np.mean(misfit**2))), _LEAST_NOISE)
    spare = max(1, len(force) - int(free.sum()))
    variance = float(misfit @ misfit) / spare
    covariance = np.zeros((len(theta), len(theta)))
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    # The error of a baseline is common to all levels between two rests and does not average out.
    common = inverse @ (jacobian[: len(points)].T @ _baselines(points)) / top
    covariance[np.ix_(free, free)] = inverse * variance + common @ common.T
    reach = float(stdtrit(spare, 0.5 + CONFIDENCE / 2))
    # A (1 + c), with the offset c: its logarithm, and the gradient of that
    gradient = np.zeros(len(theta))
    gradient[0], gradient[-1] = 1.0, 1.0 / (1.0 + theta[-1])
    full, doubt = theta[0] + np.log1p(theta[-1]), float(gradient @ covariance @ gradient)
    return FieldAnalysis(
        recruitment=as_recruitment(theta),
        maximum_force=_interval(full, doubt, reach, True, top),
        parameters={
            name: _interval(theta[k], covariance[k, k], reach, name.endswith('_slope'))
            for k, name in enumerate(_NAMES, 1)
        },
        rates_fitted=rates_fitted,
        points=tuple(points),
        residual=float(np.sqrt(variance)),
        worst_interval=reach * _worst_deviation(theta, covariance, rate),
    )


def _fitted(
    intensity: FloatArray, rate: FloatArray, force: FloatArray, free: BoolArray, noise: float
) -> tuple[FloatArray, FloatArray]:
    """Return all numbers (9,) and the Jacobian of the free ones, the prior's rows included."""
    weight = _PRIOR * noise / _SPREAD

    def residual(moved: FloatArray) -> FloatArray:
        theta = CENTRE.copy()
        theta[free] = moved
        misfit = force - field_force(theta, intensity, rate)
        order = max(0.0, theta[1] + 0.02 - theta[2])
        return np.concatenate((misfit, (weight * (theta - CENTRE))[free], [10.0 * order]))

    bounds = _LOWEST[free], _HIGHEST[free]
    fit = partial(scipy.optimize.least_squares, residual, bounds=bounds, x_scale='jac')
    starts = (np.concatenate((CENTRE[:1], thresholds, CENTRE[3:]))[free] for thresholds in _STARTS)
    best = min(map(fit, starts), key=lambda result: float(result.cost))
    theta = CENTRE.copy()
    theta[free] = best.x
    return theta, np.asarray(best.jac)


def _baselines(points: Sequence[SteadyPoint]) -> FloatArray:
    """Return the change of each point by one deviation of each rest (points, rests) [N]."""
    effect = np.zeros((len(points), 2 + max(point.rest for point in points)))
    for row, point in zip(effect, points, strict=True):
        row[point.rest] = (1.0 - point.rest_share) * point.rest_deviation
        row[point.rest + 1] = point.rest_share * point.rest_deviation
    return effect


def _interval(
    value: float, variance: float, reach: float, logarithm: bool, scale: float = 1.0
) -> Stated:
    half = reach * float(np.sqrt(max(variance, 0.0)))
    ends = np.array([value, value - half, value + half])
    if logarithm:
        ends = np.exp(np.minimum(ends, 50.0))
    return Stated(*(ends * scale).tolist())


def _worst_deviation(theta: FloatArray, covariance: FloatArray, rate: FloatArray) -> float:
    """Return the greatest standard deviation of rho over u in 0..1 and the measured rates."""
    u, f = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 1.0, 41), np.unique(rate)))
    slopes = derivatives(lambda moved: field_force(moved, u, f), theta, np.full(len(theta), 1e-5))
    deviation = np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', slopes, covariance, slopes), 0.0))
    return float(deviation.max() / np.abs(field_force(theta, u, f)).max())
