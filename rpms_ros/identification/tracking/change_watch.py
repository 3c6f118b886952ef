# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detects sudden changes of the muscle by the prediction errors, and determines their kind.

If errors are larger than the noise, a step searches for a change.  If there may be one, nothing is
learnt for half a second more, because a change a few pulses ago can be explained by several kinds.
Then the best explanation is taken.  Its kind is compared with the others for some seconds more.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.tracking.changes import DECISION
from rpms_ros.identification.tracking.changes import MUSCLE
from rpms_ros.identification.tracking.changes import NOTHING
from rpms_ros.identification.tracking.changes import Explanation
from rpms_ros.identification.tracking.changes import Snapshot
from rpms_ros.identification.tracking.changes import judged
from rpms_ros.identification.tracking.changes import quiet
from rpms_ros.identification.tracking.intervals import Origin
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.pulses import NANOSECONDS_PER_SECOND

_DELIBERATION_NS = 500_000_000
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


class Alert(NamedTuple):
    """Sizes of the newest a-priori errors and forces.

    Attributes
    ----------
    error, force : float
        Mean squares over the last second [N^2].
    samples : float
        Number of these samples.
    """

    error: float
    force: float
    samples: float


@dataclass(frozen=True)
class FoundChange:
    """A sudden change of the muscle that was found.

    Attributes
    ----------
    stamp_ns, found_ns : int
        Time of the change, and when it was found [ns].
    kind : str
        `gain`, `thresholds` or `dynamics`.
    odds : float
        Logarithm of the odds against all other explanations.
    """

    stamp_ns: int
    found_ns: int
    kind: str
    odds: float


class ChangeWatch(Restorable):
    """Searches for changes after snapshots of the fit."""

    found: list[FoundChange]
    count: int
    _snapshots: deque[Snapshot]
    _alarm_ns: int | None
    _in_vain: int
    _named: Explanation | None

    def __init__(self) -> None:
        self.found = []
        self.count = 0
        self._snapshots = deque(maxlen=2 * _CANDIDATES)
        self._alarm_ns = None
        self._in_vain = 0
        self._named = None

    @property
    def deliberating(self) -> bool:
        """Whether a possible change is not decided yet."""
        return self._alarm_ns is not None

    def remember(self, snapshot: Snapshot) -> None:
        """Keep a snapshot of the fit."""
        self._snapshots.append(snapshot)

    def forget(self) -> None:
        """Forget the snapshots: they are of another time line or another basis."""
        self._snapshots.clear()
        self._alarm_ns = None
        self._named = None

    def forget_times(self) -> None:
        """Forget when changes were: the clock has jumped.  How many there were stays."""
        self.found = []

    def look(
        self, problem: Problem, window: Window, fit: WindowFit, prior: Knowledge, alert: Alert
    ) -> Explanation | None:
        """Return the change after which the window has to begin, if there is one now."""
        now_ns = window.now_ns
        if self._named is not None:
            return self._renamed(problem, window, prior, alert)
        if self._alarm_ns is None:
            suspicious = self._suspicious(fit, alert)
            if suspicious and self._best(problem, window, prior, alert, _FIRST_LOOK):
                self._alarm_ns = now_ns
                self._in_vain = 0
            return None
        if now_ns - self._alarm_ns < _DELIBERATION_NS:
            return None
        best = self._best(problem, window, prior, alert)
        self._alarm_ns = None
        if best is None:
            return None
        self._named = best
        self.count += 1
        self.found = [
            *self.found[1 - _REMEMBERED :],
            FoundChange(best.before.stamp_ns, now_ns, best.kind, best.odds),
        ]
        return best

    def _suspicious(self, fit: WindowFit, alert: Alert) -> bool:
        """Return whether to search for a change: rarely after many searches without a result."""
        large = (
            len(self._snapshots) >= _LEAST_SNAPSHOTS
            and alert.samples >= _LEAST_SAMPLES
            and alert.error > _SUSPICIOUS * fit.variance > 0.0
        )
        self._in_vain = self._in_vain + 1 if large else 0
        return large and (self._in_vain <= _IN_VAIN or self._in_vain % _IN_VAIN == 0)

    def _best(
        self,
        problem: Problem,
        window: Window,
        prior: Knowledge,
        alert: Alert,
        stride: int = 1,
    ) -> Explanation | None:
        """Return the change that explains the newest samples best, if the odds decide.

        When it is decided: None if the muscle as it was known last explains them, because what
        was known earlier was less.
        """
        best = None
        explained = 0 if stride == 1 else _NEWEST
        for before in list(self._snapshots)[-_CANDIDATES:][::-stride]:
            if before.stamp_ns < window.first_ns + _LEAST_KNOWN_NS:
                continue
            found = _explanations(problem, before, window, prior, alert)
            if explained < _NEWEST and NOTHING in found:
                if not quiet(found[NOTHING], before.fit.scales.disturbance):
                    explained = _NEWEST
                elif (explained := explained + 1) == _NEWEST:
                    return None
            one = _of_muscle(found)
            if one is not None and (best is None or one.odds > best.odds):
                best = one
        return best if best is not None and best.odds >= DECISION else None

    def _renamed(
        self, problem: Problem, window: Window, prior: Knowledge, alert: Alert
    ) -> Explanation | None:
        """Return the change with another kind, if that has become more likely."""
        named = self._named
        assert named is not None
        if window.now_ns - named.before.stamp_ns > _NAMING_NS:
            self._named = None
            return None
        found = _explanations(problem, named.before, window, prior, alert, doubted=False)
        best = _of_muscle(found)
        if best is None or best.kind == named.kind or named.kind not in found:
            return None
        if found[best.kind].odds < found[named.kind].odds + _RENAMED:
            return None
        self._named = best
        self.found[-1] = replace(self.found[-1], kind=best.kind)
        return best


def first_block_after(problem: Problem, stamp_ns: int) -> int:
    """Return the first block that begins after a time [ns], counted from the oldest."""
    blocks = problem.blocks
    head, size = int(blocks.head[0]), int(blocks.size[0])
    start_ns = blocks.start_ns[(head + np.arange(size)) % len(blocks.start_ns)]
    return int(np.searchsorted(start_ns, stamp_ns, side='right'))


def origin_of(before: Snapshot) -> Origin:
    """Return the muscle of a snapshot, which acts until a change right after it."""
    return Origin(before.stamp_ns + 1, before.point.theta, before.point.linear)


def _explanations(
    problem: Problem,
    before: Snapshot,
    window: Window,
    prior: Knowledge,
    alert: Alert,
    doubted: bool = True,
) -> Mapping[str, Explanation]:
    first = first_block_after(problem, before.stamp_ns)
    if first >= int(problem.blocks.size[0]) - 2:
        return {}
    blocks = problem.blocks
    start_ns = int(blocks.start_ns[(int(blocks.head[0]) + first) % len(blocks.start_ns)])
    span = replace(window, first_ns=start_ns, knots=0, origin=origin_of(before))
    force = float(np.sqrt(alert.force)) + 1e-9
    return judged(problem._replace(first=first), before, prior, span, force, doubted)


def _of_muscle(found: Mapping[str, Explanation]) -> Explanation | None:
    """Return the best explanation by a change of the muscle, its odds against all others."""
    others = [one.odds for kind, one in found.items() if kind not in MUSCLE]
    changes = [one for kind, one in found.items() if kind in MUSCLE]
    if not others or not changes:
        return None
    best = max(changes, key=lambda one: one.odds)
    return replace(best, odds=best.odds - max(others))
