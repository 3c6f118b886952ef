# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Detects sudden changes of the muscle by the prediction errors, and determines their kind.

If errors are larger than the noise, a step searches for a change.  If there may be one, nothing is
learnt for half a second more, because a change a few pulses ago can be explained by several kinds.
Then the best explanation is taken if it lasts: while a short event may be going on it explains the
newest samples (`window_fit.short_events`), else those after the alarm decide for it alone.
Its kind is compared with the others for some seconds more.

At every step a snapshot of the fit is kept.  When the prediction errors grow, several explanations
are fitted to the samples after each snapshot of the last seconds, with priors around it:

* nothing changed, but the patient or the sensor did something (a livelier disturbance), or the
  muscle recovered in a pause;
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

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.estimation.basis_choice import LIVELY
from rpms_ros.identification.estimation.blocks import ring_order
from rpms_ros.identification.estimation.prior import WindowPrior
from rpms_ros.identification.estimation.settings import Problem
from rpms_ros.identification.estimation.window_equations import (
    Origin,
    steady,
    time_scale_derivative,
)
from rpms_ros.identification.estimation.window_fit import (
    LIVELINESS,
    StartLevels,
    Window,
    WindowFit,
    left_after,
    most_explained,
    steps_at_fixed_scales,
)
from rpms_ros.identification.model.recruitment import coordinates
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray

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
# Of force and time constant, by a pause since.
_RECOVERED = 0.2
# Of a jump of the baseline, as a share of the force.
_JUMP = 0.5
# Largest mean square residual, relative to the noise, of samples that are explained.
_EXPLAINED = 1.25
# Newest intervals that a change has to explain while it may be a short event; as many before and
# after an alarm do not tell that it lasts.
_NEWEST_INTERVALS, _AROUND = 3, 3
NOTHING, BASELINE = 'nothing', 'baseline'
GAIN, THRESHOLDS, DYNAMICS = 'gain', 'thresholds', 'dynamics'
MUSCLE = (GAIN, THRESHOLDS, DYNAMICS)


class Snapshot(NamedTuple):
    """The fit at a time.

    Attributes
    ----------
    stamp_ns : int
        When [ns].
    covariance : ndarray (nonlinear + functions, nonlinear + functions)
        Of theta and w.
    levels : ndarray (2,)
        The newest two knots of the disturbance [N].
    number : int
        Number of the interval that ends with the newest knot.
    fit : WindowFit
        The muscle, scales, variance.
    """

    stamp_ns: int
    covariance: FloatArray
    levels: FloatArray
    number: int
    fit: WindowFit


class Present(NamedTuple):
    """What is watched for changes.

    Attributes
    ----------
    problem : Problem
        Blocks of the samples.
    window : Window
        Those that the fit explains.
    prior : WindowPrior
        Physiology and bounds.
    error, force : float
        Mean squares of the newest a-priori errors and forces, over the last second [N^2].
    samples : float
        Number of these samples.
    """

    problem: Problem
    window: Window
    prior: WindowPrior
    error: float
    force: float
    samples: float

    def is_unexpected(self, fit: WindowFit) -> bool:
        """Return whether errors are larger than the noise of a fit."""
        return self.samples >= _LEAST_SAMPLES and self.error > _SUSPICIOUS * fit.variance > 0.0


class Explanation(NamedTuple):
    """A way to explain the samples after a snapshot.

    `lasts` says whether it explains the newest ones to within the noise.
    """

    kind: str
    odds: float
    lasts: bool
    before: Snapshot
    fit: WindowFit
    knowledge: WindowPrior


def widened(covariance: FloatArray, linear: FloatArray, kind: str) -> FloatArray:
    """Return the covariance of theta and w, alpha as logarithms, after a change of a kind.

    Parameters
    ----------
    covariance : ndarray (nonlinear + functions, nonlinear + functions)
        Before.
    linear : ndarray (functions,)
        w before.
    kind : str
        What has changed.
    """
    covariance = covariance.copy()
    response = covariance[-len(linear) :, -len(linear) :]
    if kind in MUSCLE:
        response += _GAIN**2 * np.outer(linear, linear)
    if kind == THRESHOLDS:
        covariance[[0, 1], [0, 1]] += _THRESHOLD**2
    if kind == DYNAMICS:
        slower = time_scale_derivative(linear)
        response += _DYNAMICS**2 * np.outer(slower, slower)
        response += _SHAPE**2 * float(linear @ linear) * np.eye(len(linear))
    return covariance


def after(before: Snapshot, kind: str, knowledge: WindowPrior, window: Window) -> WindowPrior:
    """Return what is known after a change of a kind.

    Parameters
    ----------
    before : Snapshot
        What was known.
    kind : str
        What has changed.
    knowledge : WindowPrior
        Physiology and bounds.
    window : Window
        Until now; in its pauses the muscle recovers.
    """
    point = before.fit.point
    distance = (window.now_ns - before.stamp_ns) / window.length_ns
    ages = window.knots[0] - window.knots
    rested = any(pause and age < distance for age, pause in zip(ages, window.pauses, strict=False))
    recovered = _RECOVERED if rested else 0.0
    # against now, relative, at the first knot of the past
    change, slowing = point.speed[:2]
    covariance = before.covariance.copy()
    for moved in (
        (_RESTLESS + recovered + _GOES_ON * abs(change) * distance) * point.linear,
        (recovered + _GOES_ON * abs(slowing) * distance) * time_scale_derivative(point.linear),
    ):
        covariance[len(point.theta) :, len(point.theta) :] += np.outer(moved, moved)
    covariance = widened(covariance, point.linear, kind)
    scale = 1.0 / np.sqrt(np.diag(covariance))
    scaled = covariance * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
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
        before.fit.level_deviation
        + LIVELINESS[before.fit.scales.lively] * force * (1.0 + reach)
        + 0.5 * abs(slope) * reach
    )
    if kind == BASELINE:
        deviation += _JUMP * force
    return StartLevels(levels, np.full(2, max(deviation, 1e-6 * force)))


def explain(
    problem: Problem,
    before: Snapshot,
    known: WindowPrior,
    window: Window,
    kind: str,
    disturbance: int,
    force: float,
    left_out: IntArray | None,
) -> Explanation | None:
    """Explain the samples of a window that begins after a snapshot; None if it cannot be done.

    `known` is what is known after a change of this kind, see `after`.
    """
    unknowns = len(before.fit.point.theta) + len(before.fit.point.linear)
    point = steady(before.fit.point.theta, before.fit.point.linear)
    scales = replace(before.fit.scales, disturbance=disturbance, increment=0, thresholds=0)
    fit = replace(
        before.fit,
        point=point,
        scales=scales,
        levels=np.zeros(2),
        first=0,
        covariance=np.zeros((unknowns, unknowns)),
        left_out=before.fit.left_out if left_out is None else left_out,
    )
    span = replace(window.without_past, start=_start(before, window, kind, force))
    steps = _STEPS if kind == THRESHOLDS else 2
    at = steps_at_fixed_scales(problem, fit, known, span, steps)
    if at is None:
        return None
    newest = (left_after(fit, at)[1] / np.maximum(at.every.samples, 1.0))[-_NEWEST_INTERVALS:]
    most = most_explained(before.fit.variance, force**2)
    lasts = fit.scales.lively <= before.fit.scales.lively and bool(np.all(newest < most))
    return Explanation(kind, fit.evidence, lasts, before, fit, known)


def quiet(one: Explanation, disturbance: int) -> bool:
    """Return whether samples are explained without a stronger disturbance than before."""
    return one.fit.misfit < _EXPLAINED and one.fit.scales.lively <= disturbance


def compare_hypotheses(
    present: Present, before: Snapshot, named: bool, left_out: IntArray | None = None
) -> Mapping[str, Explanation]:
    """Return the explanations of what follows a snapshot by kind, with odds against no change.

    While no change is `named`, no change of the muscle is tried if a disturbance or the baseline
    explains the samples.  Empty if there are too few.  All since the snapshot count but those
    `left_out`, see `WindowFit`.
    """
    problem, window = present.problem, present.window
    first = first_block_after(problem, before.stamp_ns)
    if first >= int(problem.blocks.size[0]) - 2:
        return {}
    blocks = problem.blocks
    start_ns = int(blocks.start_ns[(int(blocks.head[0]) + first) % len(blocks.start_ns)])
    problem = problem._replace(first=first)
    span = replace(window, first_ns=start_ns, origin=origin_of(before))
    force = float(np.sqrt(present.force)) + 1e-9
    now = before.fit.scales.lively
    lively = len(LIVELINESS) - 2
    found: dict[str, Explanation] = {}
    for kind in (NOTHING, BASELINE, *MUSCLE):
        if not named and kind in MUSCLE and any(quiet(one, now) for one in found.values()):
            break
        known = after(before, kind, present.prior, span)
        tried = [
            explain(problem, before, known, span, kind, disturbance, force, left_out)
            for disturbance in sorted({now, lively})
        ]
        if explained := [one for one in tried if one is not None]:
            found[kind] = max(explained, key=lambda one: one.odds)
    if NOTHING not in found:
        return {}
    base = found[NOTHING].odds
    return {kind: one._replace(odds=one.odds - base) for kind, one in found.items()}


_DELIBERATION_NS = 500_000_000
_LONGEST_EVENT_NS, _LONGEST_DELIBERATION_NS = 1_500_000_000, 5 * NANOSECONDS_PER_SECOND
_NAMING_NS = 4 * NANOSECONDS_PER_SECOND
# Changes are found only after the muscle was observed for so long.
_LEAST_KNOWN_NS = 5 * NANOSECONDS_PER_SECOND
_LEAST_SNAPSHOTS = 8
_CANDIDATES = 8
# So many of the newest snapshots have to fail to explain the samples.
_NEWEST = 2
# The first search uses every second snapshot.
_FIRST_LOOK = 2
_SUSPICIOUS = 1.5
_LEAST_SAMPLES = 50.0
_IN_VAIN = 8
# Difference of the evidence from which the kind is corrected [nat].
_RENAMED = 3.0
_REMEMBERED = 10


class FoundChange(NamedTuple):
    """A sudden change of the muscle that was found.

    Attributes
    ----------
    stamp_ns : int
        Time of the change [ns].
    kind : str
        `gain`, `thresholds` or `dynamics`.
    """

    stamp_ns: int
    kind: str


class ChangeWatch:
    """Searches for changes after snapshots of the fit."""

    def __init__(self) -> None:
        self.found: deque[FoundChange] = deque(maxlen=_REMEMBERED)
        self.count = 0
        self._snapshots: deque[Snapshot] = deque(maxlen=2 * _CANDIDATES)
        self._alarm_ns: int | None = None
        self._in_vain = 0
        self._named: Explanation | None = None

    @property
    def deliberating(self) -> bool:
        """Whether a possible change is not decided yet."""
        return self._alarm_ns is not None

    def explained_from(self, first_ns: int) -> int:
        """Return the first sample that is to be explained, of a window from `first_ns` on [ns].

        Earlier than the window's if the kind of a change may still be corrected.
        """
        return first_ns if self._named is None else min(first_ns, self._named.before.stamp_ns)

    def remember(self, fit: WindowFit, stamp_ns: int) -> None:
        """Keep a snapshot of the fit at a time [ns]."""
        joint = len(fit.point.theta) + len(fit.point.linear)
        snapshot = Snapshot(
            stamp_ns=stamp_ns,
            covariance=fit.covariance[:joint, :joint].copy(),
            levels=fit.levels[-2:].copy(),
            number=fit.first + len(fit.levels) - 2,
            fit=replace(fit),
        )
        self._snapshots.append(snapshot)

    def forget(self) -> None:
        """Forget the snapshots: they are of another time line or another basis."""
        self._snapshots.clear()
        self._alarm_ns = None
        self._named = None

    def look(self, fit: WindowFit, present: Present) -> Explanation | None:
        """Return the change after which the window has to begin, if there is one now."""
        now_ns = present.window.now_ns
        if self._named is not None:
            return self._renamed(present)
        if self._alarm_ns is None:
            suspicious = self._suspicious(fit, present)
            if suspicious and self._best(present, _FIRST_LOOK):
                self._alarm_ns = now_ns
                self._in_vain = 0
            return None
        if now_ns - self._alarm_ns < _DELIBERATION_NS:
            return None
        best = self._best(present)
        if best is not None:
            # what lasts for a moment only is no change of the muscle
            pending = now_ns // present.window.length_ns in fit.left_out
            lasts = best.lasts or None if pending else _since(best, present, fit, self._alarm_ns)
            longest_ns = _LONGEST_EVENT_NS if pending else _LONGEST_DELIBERATION_NS
            if lasts is None and now_ns - self._alarm_ns < longest_ns:
                return None
            if not (lasts or pending):
                best = None
                self._snapshots.clear()
        self._alarm_ns = None
        if best is None:
            return None
        self._named = best
        self.count += 1
        self.found.append(FoundChange(best.before.stamp_ns, best.kind))
        return best

    def _suspicious(self, fit: WindowFit, present: Present) -> bool:
        """Return whether to search for a change: rarely after many searches without a result."""
        large = len(self._snapshots) >= _LEAST_SNAPSHOTS and present.is_unexpected(fit)
        self._in_vain = self._in_vain + 1 if large else 0
        return large and (self._in_vain <= _IN_VAIN or self._in_vain % _IN_VAIN == 0)

    def _best(self, present: Present, stride: int = 1) -> Explanation | None:
        """Return the change that explains the newest samples best, if the odds decide.

        When it is decided: None if the muscle as it was known last explains them, because what
        was known earlier was less.
        """
        best = None
        explained = 0 if stride == 1 else _NEWEST
        for before in list(self._snapshots)[-_CANDIDATES:][::-stride]:
            if before.stamp_ns < present.window.first_ns + _LEAST_KNOWN_NS:
                continue
            found = compare_hypotheses(present, before, named=False)
            if explained < _NEWEST and NOTHING in found:
                if not quiet(found[NOTHING], before.fit.scales.lively):
                    explained = _NEWEST
                elif (explained := explained + 1) == _NEWEST:
                    return None
            one = _of_muscle(found)
            if one is None or one.fit.scales.lively > before.fit.scales.lively >= LIVELY:
                # from what a patient does more and more a change cannot be told
                continue
            if best is None or one.odds > best.odds:
                best = one
        return best if best is not None and best.odds >= DECISION else None

    def _renamed(self, present: Present) -> Explanation | None:
        """Return the change with another kind, if that has become more likely."""
        named = self._named
        assert named is not None
        if present.window.now_ns - named.before.stamp_ns > _NAMING_NS:
            self._named = None
            return None
        found = compare_hypotheses(present, named.before, named=True)
        best = _of_muscle(found)
        if best is None or best.kind == named.kind or named.kind not in found:
            return None
        if found[best.kind].odds < found[named.kind].odds + _RENAMED:
            return None
        self._named = best
        self.found[-1] = self.found[-1]._replace(kind=best.kind)
        return best


def _since(change: Explanation, present: Present, fit: WindowFit, alarm_ns: int) -> bool | None:
    """Return whether samples after an alarm show a change; None if they do not tell yet."""
    around = alarm_ns // present.window.length_ns + np.arange(-_AROUND, _AROUND)
    found = compare_hypotheses(present, change.before, True, np.union1d(fit.left_out, around))
    since = _of_muscle(found)
    if since is None:
        return None
    same = quiet(found[NOTHING], change.before.fit.scales.lively)
    return (since.odds > DECISION and not same) or (None if since.odds > -_RENAMED else False)


def first_block_after(problem: Problem, stamp_ns: int) -> int:
    """Return the first block that begins after a time [ns], counted from the oldest."""
    start_ns = problem.blocks.start_ns[ring_order(problem.blocks)]
    return int(np.searchsorted(start_ns, stamp_ns, side='right'))


def origin_of(before: Snapshot) -> Origin:
    """Return the muscle of a snapshot, which acts until a change right after it."""
    return Origin(before.stamp_ns + 1, before.fit.point.theta, before.fit.point.linear)


def _of_muscle(found: Mapping[str, Explanation]) -> Explanation | None:
    """Return the best explanation by a change of the muscle, its odds against all others."""
    others = [one.odds for kind, one in found.items() if kind not in MUSCLE]
    changes = [one for kind, one in found.items() if kind in MUSCLE]
    if not others or not changes:
        return None
    best = max(changes, key=lambda one: one.odds)
    return best._replace(odds=best.odds - max(others))
