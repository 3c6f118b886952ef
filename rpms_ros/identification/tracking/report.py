# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rates, changes, disturbance and reasons of an estimate of `tracking`."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.plausibility import REASON
from rpms_ros.identification.plausibility import RESIDUALS_ALIKE
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.tracking.change_watch import FoundChange
from rpms_ros.identification.tracking.stretching import slowed
from rpms_ros.identification.tracking.tremor import Tremor
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.pulses import FloatArray

RATE_NAMES = ('force_percent', 'time_constant_percent', 'u_thr', 'u_sat')
_MINUTE = 60.0
# A muscle does not tire evenly between two knots: deviation of a rate as a share of it, so that
# nineteen of twenty intervals hold the mean rate of the last knot (bench/rates.py).
_UNEVEN = 0.06
# The disturbance counts as lively above this share of the force, by `LIVELINESS`.
_LIVELY = 6
# Above this factor neighbouring residuals are more alike than a muscle of the model leaves them,
# which is 1.1 at most once it is known: a lively disturbance then takes up what is the muscle's.
_ALIKE = 1.5
_WIDE = 0.05


def described_fit(
    estimate: Estimate,
    fit: WindowFit,
    found: Sequence[FoundChange],
    count: int,
    deliberating: bool,
    knot_s: float,
    interval_s: float,
    area: FloatArray,
    tremor: Tremor,
) -> Estimate:
    """Return the estimate with rates, changes, disturbance, doubts and reasons added.

    Parameters
    ----------
    estimate : Estimate
        The muscle now.
    fit : WindowFit
        Where the fit of the window stands.
    found : sequence of FoundChange
        The newest changes.
    count : int
        How many changes there were.
    deliberating : bool
        Whether the newest samples are not learnt from for the moment.
    knot_s, interval_s : float
        Distance of the knots of gain and slowing, and length of an interval [s].
    area : ndarray (functions,)
        Integrals of the functions [s^1/2].
    tremor : Tremor
        What is taken off the samples.
    """
    names, rate, deviation = _rates(fit, knot_s, interval_s, area)
    half = (
        float(ndtri(0.5 + 0.5 * estimate.confidence)) * deviation if estimate.confidence else 0.0
    )
    rest = _rest_level(fit.levels)
    doubts = (RESIDUALS_ALIKE,) if estimate.curve_known and _leaves_alike(fit) else ()
    return replace(
        estimate,
        doubts=(*estimate.doubts, *doubts),
        rate_names=names,
        rate=rate,
        rate_lower=rate - half,
        rate_upper=rate + half,
        changes=count,
        change_kinds=tuple(one.kind for one in found),
        change_ago=np.array([1e-9 * (estimate.stamp_ns - one.stamp_ns) for one in found]),
        disturbance=float(fit.levels[-1]) - rest,
        disturbance_deviation=_level_deviation(fit, estimate.stamp_ns * 1e-9 / interval_s),
        reasons=(*_reasons(estimate, fit, deliberating, tremor), *(REASON[one] for one in doubts)),
    )


def _leaves_alike(fit: WindowFit) -> bool:
    """Tell whether neighbouring residuals are alike, and more than the model's own error."""
    left = fit.misfit * fit.weighed
    return fit.together > _ALIKE and left > 0.5 * fit.variance


def _rest_level(levels: FloatArray) -> float:
    """Return the level of the disturbance without effort [N]."""
    return float(np.median(levels)) if len(levels) else 0.0


def _level_deviation(fit: WindowFit, now: float) -> float:
    """Return the standard deviation of the newest level at a time in intervals [N]."""
    behind = max(now - (fit.first + len(fit.levels) - 1), 0.0) + 1.0
    slope = abs(float(fit.levels[-1] - fit.levels[-2])) if len(fit.levels) > 1 else 0.0
    return math.hypot(fit.level_deviation, slope * min(behind, 4.0))


def _rates(
    fit: WindowFit, knot_s: float, interval_s: float, area: FloatArray
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return names, rates a minute and their standard deviations; nothing without a past."""
    knots = len(fit.point.gain)
    if not knots:
        return (), np.empty(0), np.empty(0)
    base = PARAMETERS + len(fit.point.linear)
    # a slower twitch of the same height has a larger area, and so a larger steady force
    steady = float(area @ fit.point.linear)
    by_slowing = float(area @ slowed(fit.point.linear)) / steady if steady else 0.0
    # the parameters are past minus present: a force that was larger has fallen
    scale = 100.0 * _MINUTE / knot_s
    matrix = np.zeros((len(RATE_NAMES), len(fit.covariance)))
    matrix[0, base], matrix[0, base + knots] = -scale, -scale * by_slowing
    matrix[1, base + knots] = -scale
    matrix[2, -2] = matrix[3, -1] = -_MINUTE / interval_s
    gain, slowing = float(fit.point.gain[0]), float(fit.point.slowing[0])
    changed = np.zeros(len(fit.covariance))
    changed[base], changed[base + knots], changed[-2:] = gain, slowing, fit.point.slope
    variance = np.einsum('ij,jk,ik->i', matrix, fit.covariance, matrix)
    rate = matrix @ changed
    variance[:2] += np.square(_UNEVEN * rate[:2])
    return RATE_NAMES, rate, np.sqrt(np.maximum(variance, 0.0))


def _reasons(
    estimate: Estimate, fit: WindowFit, deliberating: bool, tremor: Tremor
) -> tuple[str, ...]:
    """Return why intervals are wide or samples are not learnt from, as sentences."""
    found = []
    if deliberating:
        found.append('the newest samples do not fit the muscle; looking for what has changed')
    if tremor.frequency:
        # without a unit: an estimator is not told whether it is a force or a torque
        found.append(
            f'a tremor of {tremor.frequency:.1f} Hz with an amplitude of '
            f'{tremor.amplitude:.2g} is taken off'
        )
    if fit.scales.disturbance > _LIVELY:
        found.append('a lively disturbance cannot be told from the muscle everywhere')
    if estimate.curve_known and len(estimate.curve_upper):
        width = float(np.max(estimate.curve_upper - estimate.curve_lower))
        if width > 2.0 * _WIDE * float(np.max(np.abs(estimate.curve_force))):
            found.append('the pulses so far do not tell the recruitment curve')
    return tuple(found)
