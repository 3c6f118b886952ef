# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Sudden changes of the muscle: their time and kind.

At every step a snapshot of the fit is kept.  When the prediction errors grow, several explanations
are fitted to the samples after each snapshot of the last seconds, with priors around it:

* nothing changed, but the patient or the sensor did something (a livelier disturbance);
* the *gain* changed: w is known but for a factor;
* the *thresholds* changed (the coil has moved): u_thr, u_sat and the gain are free again, the
  dynamics and the sharpness of the bends hold;
* the *dynamics* changed: w is free, the recruitment holds;
* the *baseline* jumped.

The evidence of each explanation is the probability of the samples under it, its free parameters
integrated out, so an explanation with a wider prior has less evidence.  A change is
declared where the best explanation beats "nothing changed" by `DECISION`: under it, odds of
``e^DECISION`` come up at most once in as many tests (Ville's inequality).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.tracking.assembly import SLOPES
from rpms_ros.identification.tracking.assembly import Point
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.knowledge import coordinates
from rpms_ros.identification.tracking.stretching import slowed
from rpms_ros.identification.tracking.window_fit import LIVELINESS
from rpms_ros.identification.tracking.window_fit import StartLevels
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.identification.tracking.window_fit import explained
from rpms_ros.pulses import FloatArray

DECISION = 30.0
_STEPS = 3
# Standard deviations of a change: factor on the force, of u_thr and u_sat, of time constant and
# latency relative to the time constant, and of the shape.
_GAIN = 0.4
_THRESHOLD = 0.1
_DYNAMICS = 0.3
_SHAPE = 0.1
# Of a muscle that does not change, relative, and of a slow change that goes on, against what it
# was so far.
_RESTLESS, _GOES_ON = 0.002, 1.5
# Of a jump of the baseline, as a share of the force.
_JUMP = 0.5
# Largest mean square residual, relative to the noise, of samples that are explained.
_EXPLAINED = 1.25
NOTHING, GAIN, THRESHOLDS, DYNAMICS, BASELINE = (
    'nothing',
    'gain',
    'thresholds',
    'dynamics',
    'baseline',
)
MUSCLE = (GAIN, THRESHOLDS, DYNAMICS)


@dataclass(frozen=True)
class Snapshot:
    """The fit at a time.

    Attributes
    ----------
    stamp_ns : int
        When [ns].
    point : Point
        The muscle.
    covariance : ndarray (4 + functions, 4 + functions)
        Of theta and w.
    levels : ndarray (2,)
        The newest two knots of the disturbance [N].
    level_deviation : float
        Of the newest [N].
    number : int
        Number of the interval that ends with the newest knot.
    fit : WindowFit
        Scales, variance.
    """

    stamp_ns: int
    point: Point
    covariance: FloatArray
    levels: FloatArray
    level_deviation: float
    number: int
    fit: WindowFit


def snapshot(fit: WindowFit, stamp_ns: int) -> Snapshot:
    """Return the snapshot of a fit at a time [ns]."""
    joint = PARAMETERS + len(fit.point.linear)
    return Snapshot(
        stamp_ns=stamp_ns,
        point=fit.point,
        covariance=fit.covariance[:joint, :joint].copy(),
        levels=fit.levels[-2:].copy(),
        level_deviation=fit.level_deviation,
        number=fit.first + len(fit.levels) - 2,
        fit=replace(fit),
    )


@dataclass(frozen=True)
class Explanation:
    """A way to explain the samples after a snapshot."""

    kind: str
    odds: float
    before: Snapshot
    fit: WindowFit
    knowledge: Knowledge


def widened(covariance: FloatArray, linear: FloatArray, kind: str) -> FloatArray:
    """Return the covariance of theta and w, alpha as logarithms, after a change of a kind.

    Parameters
    ----------
    covariance : ndarray (4 + functions, 4 + functions)
        Before.
    linear : ndarray (functions,)
        w before.
    kind : str
        What has changed.
    """
    functions = len(linear)
    covariance = covariance.copy()

    def free(start: int, values: FloatArray | float) -> None:
        direction = np.zeros(PARAMETERS + functions)
        direction[start : start + np.size(values)] = values
        covariance[:] += np.outer(direction, direction)

    if kind in MUSCLE:
        free(PARAMETERS, _GAIN * linear)
    if kind == THRESHOLDS:
        free(0, _THRESHOLD)
        free(1, _THRESHOLD)
    if kind == DYNAMICS:
        free(PARAMETERS, _DYNAMICS * slowed(linear))
        size = _SHAPE * float(np.linalg.norm(linear))
        for place in range(functions):
            free(PARAMETERS + place, size)
    return covariance


def after(before: Snapshot, kind: str, knowledge: Knowledge, distance: float) -> Knowledge:
    """Return what is known after a change of a kind.

    Parameters
    ----------
    before : Snapshot
        What was known.
    kind : str
        What has changed.
    knowledge : Knowledge
        Physiology and bounds.
    distance : float
        Time since the snapshot, in distances of the knots of the slow change [1].
    """
    point = before.point
    joint = PARAMETERS + len(point.linear)
    # against now, relative, at the first knot of the past: the change over one distance
    change = float(point.gain[0]) if len(point.gain) else 0.0
    slowing = float(point.slowing[0]) if len(point.slowing) else 0.0
    covariance = before.covariance.copy()
    for response in (
        (_RESTLESS + _GOES_ON * abs(change) * distance) * point.linear,
        _GOES_ON * abs(slowing) * distance * slowed(point.linear),
    ):
        direction = np.concatenate((np.zeros(PARAMETERS), response))
        covariance += np.outer(direction, direction)
    covariance = widened(covariance, point.linear, kind)
    scale = 1.0 / np.sqrt(np.diag(covariance))
    scaled = covariance * np.outer(scale, scale) + 1e-9 * np.eye(joint)
    information = np.linalg.inv(scaled) * np.outer(scale, scale)
    reference = np.concatenate((coordinates(point.theta), point.linear))
    return replace(knowledge, information=information, reference=reference)


def _start(before: Snapshot, window: Window, kind: str, force: float) -> StartLevels:
    """Return the prior of the disturbance after a snapshot."""
    ahead = window.first_ns // window.length_ns - before.number
    slope = before.levels[1] - before.levels[0]
    # the level continues; the slope only for a limited time
    reach = min(max(float(ahead), 0.0), 2.0)
    levels = before.levels[1] + slope * np.array([reach - 1.0, reach])
    deviation = (
        before.level_deviation
        + LIVELINESS[before.fit.scales.disturbance] * force * (1.0 + reach)
        + 0.5 * abs(slope) * reach
    )
    if kind == BASELINE:
        deviation += _JUMP * force
    return StartLevels(levels, np.full(2, max(deviation, 1e-6 * force)))


def explain(
    problem: Problem,
    before: Snapshot,
    knowledge: Knowledge,
    window: Window,
    kind: str,
    disturbance: int,
    force: float,
) -> Explanation | None:
    """Explain the samples of a window that begins after a snapshot; None if it cannot be done."""
    distance = (window.now_ns - before.stamp_ns) / (window.spacing * window.length_ns)
    known = after(before, kind, knowledge, distance)
    functions = len(before.point.linear)
    unknowns = PARAMETERS + functions + SLOPES
    point = Point(
        before.point.theta, before.point.linear, np.zeros(0), np.zeros(0), np.zeros(SLOPES)
    )
    scales = replace(before.fit.scales, disturbance=disturbance, slope=0)
    fit = replace(
        before.fit,
        point=point,
        scales=scales,
        levels=np.zeros(2),
        first=0,
        covariance=np.zeros((unknowns, unknowns)),
    )
    span = replace(window, start=_start(before, window, kind, force), knots=0)
    steps = _STEPS if kind == THRESHOLDS else 2
    if not explained(problem, fit, known, span, steps):
        return None
    return Explanation(kind, fit.evidence, before, fit, known)


def quiet(one: Explanation, disturbance: int) -> bool:
    """Return whether samples are explained without a stronger disturbance than before."""
    return one.fit.misfit < _EXPLAINED and one.fit.scales.disturbance <= disturbance


def judged(
    problem: Problem,
    before: Snapshot,
    knowledge: Knowledge,
    window: Window,
    force: float,
    doubted: bool = True,
) -> Mapping[str, Explanation]:
    """Return the explanations of a window by kind, each with its odds against no change.

    While it is `doubted` that the muscle has changed, no change of the muscle is tried if a
    disturbance or the baseline explains the samples.
    """
    now = before.fit.scales.disturbance
    lively = len(LIVELINESS) - 2
    found: dict[str, Explanation] = {}
    for kind in (NOTHING, BASELINE, *MUSCLE):
        if doubted and kind in MUSCLE and any(quiet(one, now) for one in found.values()):
            break
        best: Explanation | None = None
        for disturbance in sorted({now, lively}):
            other = explain(problem, before, knowledge, window, kind, disturbance, force)
            if other is not None and (best is None or other.odds > best.odds):
                best = other
        if best is not None:
            found[kind] = best
    if NOTHING not in found:
        return MappingProxyType({})
    base = found[NOTHING].odds
    return MappingProxyType(
        {kind: replace(one, odds=one.odds - base) for kind, one in found.items()}
    )
