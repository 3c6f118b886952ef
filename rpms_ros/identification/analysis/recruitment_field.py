# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The recruitment field from steady forces, with intervals and a check of its shape.

The recruitment field in the parameters of a fit (Eqs. 8 to 10).

.. math:: F(u, f) = A \, \frac{n(u) - n(0)}{n(1) - n(0)} \cdot \frac{m(f) + d}{m(20) + d}
   + A c

A is the steady force at full intensity and 20 Hz; n is the bend of Eq. (9) and m that of
Eq. (10), each without its gain and offset, which follow from A, c and d.  The parameters are not
redundant: seven of the shape, one force, one offset.

Monotone regression: a check of the shape of the recruitment that assumes no formula.

Steady force of long levels, to which the recruitment field is fitted (Sec. 2.2, Fig. 9).

It is the mean over whole periods of the pulses, after the force has settled, above a baseline that
is linear from the rest before one group to the rest before the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import (
    AnalysisSettings,
    CleanTrace,
    Level,
    PulseGroup,
)
from rpms_ros.muscle import IntensityRecruitment, RateRecruitment, RecruitmentField
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds

REFERENCE_RATE = 20.0
NAMES = (
    'threshold',
    'saturation',
    'threshold_slope',
    'saturation_slope',
    'rate_saturation',
    'rate_slope',
    'rate_offset',
    'zero_offset',
)
CENTRE = np.array([0.48, 0.98, np.log(5.0), np.log(4.0), 25.0, np.log(0.05), -0.321 / 0.0597, 0.0])
# Standard deviations of a prior: the spread among people (Table 6), or wider than data resolve.
SPREAD = np.array([0.15, 0.15, 0.5, 0.8, 8.0, 0.8, 5.0, 0.05])
LOWEST = np.array([0.0, 0.3, np.log(0.5), np.log(0.5), 5.0, np.log(0.003), -12.0, -0.3])
HIGHEST = np.array([1.0, 1.8, np.log(60.0), np.log(60.0), 60.0, np.log(1.0), 40.0, 0.3])


def intensity_factor(theta: FloatArray, intensity: FloatArray) -> FloatArray:
    """Return rho_u, 0 at no and 1 at full intensity, plus the offset; shape (...)."""
    threshold, saturation = theta[0], theta[1]
    low, high = np.exp(theta[2]), np.exp(theta[3])

    def bend(u: FloatArray) -> FloatArray:
        above, beyond = u - threshold, u - saturation
        value: FloatArray = above * np.arctan(low * above) - beyond * np.arctan(high * beyond)
        return value

    zero, full = bend(np.array([0.0, 1.0]))
    share: FloatArray = (bend(np.asarray(intensity)) - zero) / (full - zero) + theta[7]
    return share


def rate_factor(theta: FloatArray, rate_hz: FloatArray) -> FloatArray:
    """Return rho_f, 1 at 20 Hz; shape (...)."""
    rate = np.asarray(rate_hz, dtype=np.float64)
    slope = np.exp(theta[5])

    def bend(f: FloatArray) -> FloatArray:
        excess = f - theta[4]
        value: FloatArray = f - excess * (np.arctan(slope * excess) / np.pi + 0.5)
        return value

    factor: FloatArray = (bend(rate) + theta[6]) / (bend(np.array(REFERENCE_RATE)) + theta[6])
    return factor


def as_recruitment(theta: FloatArray) -> tuple[IntensityRecruitment, RateRecruitment]:
    """Return Eqs. (9) and (10) with these parameters (8,), gains and offsets included."""
    plain = IntensityRecruitment(
        float(theta[0]), float(theta[1]), float(np.exp(theta[2])), float(np.exp(theta[3]))
    ).normalised()
    by_intensity = IntensityRecruitment(
        plain.threshold,
        plain.saturation,
        plain.threshold_slope,
        plain.saturation_slope,
        plain.gain,
        plain.offset + float(theta[7]),
    )
    unit = RateRecruitment(float(theta[4]), float(np.exp(theta[5])), 1.0, 0.0)
    gain = 1.0 / (float(unit(REFERENCE_RATE)) + float(theta[6]))
    by_rate = RateRecruitment(
        float(theta[4]), float(np.exp(theta[5])), gain, gain * float(theta[6])
    )
    return by_intensity, by_rate


_ROUNDS = 200
_SETTLED = 1e-10


def rising(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the least-squares fit (points,) that never falls: pool adjacent violators.

    Parameters
    ----------
    values, weights : ndarray, shape (points,)
        Values and their weights, in the order of the abscissa.
    """
    means: list[float] = []
    sizes: list[float] = []
    counts: list[int] = []
    for value, weight in zip(values, weights, strict=True):
        means.append(float(value))
        sizes.append(float(weight))
        counts.append(1)
        while len(means) > 1 and means[-2] > means[-1]:
            total = sizes[-2] + sizes[-1]
            mean = (means[-2] * sizes[-2] + means[-1] * sizes[-1]) / max(total, 1e-300)
            means[-2:] = [mean]
            sizes[-2:] = [total]
            counts[-2:] = [counts[-2] + counts[-1]]
    return np.repeat(means, counts)


def rising_product(
    row: FloatArray, column: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Fit values at (row, column) with a product of two rising functions (Eq. 8).

    Alternates between the factors; each step is a weighted monotone regression of the ratios.

    Parameters
    ----------
    row, column : ndarray, shape (points,)
        Abscissae: intensity and rate.
    values : ndarray, shape (points,)
        Forces.

    Returns
    -------
    row_levels, row_factor : ndarray, shape (rows,)
        Distinct abscissae and the factor there, at most 1.
    column_levels, column_factor : ndarray, shape (columns,)
        The same for the other, in the unit of the values.
    """
    row_levels, row_of = np.unique(row, return_inverse=True)
    column_levels, column_of = np.unique(column, return_inverse=True)
    factor = np.linspace(0.0, 1.0, len(row_levels)) if len(row_levels) > 1 else np.ones(1)
    other = np.ones(len(column_levels))
    for _ in range(_ROUNDS):
        before = factor[row_of] * other[column_of]
        other = _factor(column_of, len(column_levels), factor[row_of], values)
        factor = _factor(row_of, len(row_levels), other[column_of], values)
        scale = max(float(np.abs(factor).max()), 1e-300)
        factor, other = factor / scale, other * scale
        change = np.abs(factor[row_of] * other[column_of] - before).max()
        if change <= _SETTLED * max(float(np.abs(values).max()), 1e-300):
            break
    return row_levels, factor, column_levels, other


def _factor(
    level_of: np.ndarray, levels: int, known: FloatArray, values: FloatArray
) -> FloatArray:
    weight = np.bincount(level_of, known**2, levels)
    product = np.bincount(level_of, known * values, levels)
    ratio = product / np.maximum(weight, 1e-300)
    return rising(np.where(weight > 0, ratio, 0.0), np.maximum(weight, 1e-12))


LEAST_PERIODS = 4
REST_SPAN = 0.2


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


@dataclass(frozen=True)
class Baseline:
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

    def at(self, moment_ns: float) -> float:
        """Return the baseline at a time [ns]."""
        return float(np.interp(moment_ns, self.time_ns, self.force))

    def place(self, moment_ns: float) -> tuple[int, float]:
        """Return the index of the rest before a time [ns], and the weight of the next rest."""
        place = float(np.interp(moment_ns, self.time_ns, np.arange(len(self.time_ns))))
        return int(place), place - int(place)


def resting_force(
    trace: CleanTrace, groups: tuple[PulseGroup, ...], onset_ns: IntArray
) -> Baseline | None:
    """Return the baseline before each group and at the end; None without any rest."""
    span = nanoseconds(REST_SPAN)
    ends = [int(onset_ns[group.first]) for group in groups]
    if groups and trace.stamp_ns[-1] - onset_ns[-1] > NANOSECONDS_PER_SECOND:
        ends.append(int(trace.stamp_ns[-1]) + 1)
    times, forces, variances = [], [], []
    for end in ends:
        part = trace.between(end - span, end)
        if part.stop > part.start:
            times.append(end - span // 2)
            forces.append(float(np.mean(trace.force[part])))
            variances.append(float(np.var(trace.force[part])) / (part.stop - part.start))
    if not times:
        return None
    return Baseline(np.array(times), np.array(forces), float(np.sqrt(np.mean(variances))))


def steady_point(
    trace: CleanTrace,
    onset_ns: IntArray,
    level: Level,
    baseline: Baseline,
    settings: AnalysisSettings,
) -> SteadyPoint | str:
    """Return the steady force of a level, or why there is none."""
    if not np.isfinite(level.intensity):
        return 'intensity not recorded'
    start = int(onset_ns[level.first])
    period = NANOSECONDS_PER_SECOND / level.rate_hz
    end = float(onset_ns[level.last - 1]) + period
    settled = start + settings.settling * NANOSECONDS_PER_SECOND
    periods = int((end - settled) / period + 1e-6)
    if periods < LEAST_PERIODS:
        return f'level shorter than {settings.settling:g} s and {LEAST_PERIODS} periods'
    first = end - periods * period
    part = trace.between(round(first), round(end))
    if part.stop - part.start < 0.9 * (end - first) / (
        trace.sample_period * NANOSECONDS_PER_SECOND
    ):
        return 'force samples missing'
    if trace.saturated[part].any():
        return 'sensor saturated'
    force: FloatArray = trace.force[part] - baseline.at(0.5 * (first + end))
    phase = np.asarray((trace.stamp_ns[part] - first) / period % 1.0, dtype=np.float64)
    ripple = _ripple(phase, force)
    rest, share = baseline.place(0.5 * (first + end))
    return SteadyPoint(
        level.intensity,
        level.rate_hz,
        float(force.mean()),
        ripple,
        start,
        rest,
        share,
        baseline.deviation,
    )


def _ripple(phase: FloatArray, force: FloatArray) -> float:
    """Return the span of the force averaged over the phase of the period [N]."""
    part = np.minimum((phase * 10).astype(np.int64), 9)
    means = [float(np.mean(force[part == k])) for k in range(10) if (part == k).any()]
    return max(means) - min(means)


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
    free = np.ones(1 + len(NAMES), dtype=np.bool_)
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
    lowest = np.concatenate(([-3.0], LOWEST))
    highest = np.concatenate(([3.0], HIGHEST))
    centre = np.concatenate(([0.0], CENTRE))
    noise = _pure_noise(intensity, rate, force)
    weight = _PRIOR * noise / np.concatenate(([10.0], SPREAD))

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
    by_intensity, by_rate = as_recruitment(theta[1:])
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
        for k, name in enumerate(NAMES)
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
