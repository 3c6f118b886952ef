# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Other starts for the fit of a young window, which may hang in a local minimum."""

from collections.abc import Sequence
from dataclasses import replace

from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.identification.tracking.window_fit import explained
from rpms_ros.identification.tracking.window_fit import fresh_fit
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray

_CHALLENGED_NS = 30 * NANOSECONDS_PER_SECOND
# A window that is not quite young is challenged once in so many steps.
_RESTS, _OFTEN_NS = 4, 5 * NANOSECONDS_PER_SECOND
_STEPS = 5
# The other has to be better by so much [nat].
_DECISION = 3.0


class Challenger(Restorable):
    """Tries other starts, in turn.

    Parameters
    ----------
    starts : sequence of ndarray (4,)
        theta of each.
    """

    _turn: int

    def __init__(self, starts: Sequence[FloatArray]) -> None:
        self._starts = starts
        self._turn = 0

    def challenge(
        self, problem: Problem, fit: WindowFit, knowledge: Knowledge, window: Window
    ) -> None:
        """While the window is young try the next start; go on from there if it is better."""
        length_ns = window.now_ns - window.first_ns
        if length_ns > _CHALLENGED_NS or not fit.shows_response:
            return
        self._turn = (self._turn + 1) % (_RESTS * len(self._starts))
        if length_ns > _OFTEN_NS and self._turn % _RESTS:
            return
        other = fresh_fit(self._starts[self._turn // _RESTS], len(fit.point.linear))
        other.variance, other.together = fit.variance, fit.together
        mine = replace(fit)
        if not explained(problem, other, knowledge, window, _STEPS):
            return
        if explained(problem, mine, knowledge, window, 1) and (
            other.evidence > mine.evidence + _DECISION
        ):
            fit.point, fit.scales, fit.levels = other.point, other.scales, other.levels
            fit.first = other.first
