# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Takes force samples in the order of arrival and returns them with rising stamps.

Samples that are not finite, larger than a limit, repeated or stamped wrongly are dropped and
counted; a stamp far from its predecessor is accepted when a second one follows it.
"""

from collections import deque
from typing import Protocol

import numpy as np

from rpms_ros.identification.stream import faults
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, ForceTrace, IntArray
from rpms_ros.saved_state import Restorable, expect

# Most samples that may wait: a block of the batch at 100 kHz, and the delays before and after it.
MOST_WAITING = 200_000
# So many samples out of order within this time are treated as a fault that lasts [1], [ns].
_DISORDER = 3
_DISORDER_NS = NANOSECONDS_PER_SECOND


class TimeLine(Protocol):
    """Receiver of the faults and gaps that the intake finds."""

    def postpone(self, name: str) -> None:
        """Count a fault when the samples up to here are processed."""

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Do not learn from samples after `start_ns` up to `end_ns`."""

    def meet_gap(self, until_ns: int) -> None:
        """Continue after a gap that ends at `until_ns` [ns]."""

    def jump_back(self, stamp_ns: int) -> None:
        """Process the waiting samples, then continue from an earlier stamp."""


class ForceIntake(Restorable):
    """Checks samples and keeps them until they are processed.

    Parameters
    ----------
    line : TimeLine
        Receiver of faults and gaps.
    longest_gap_ns : int
        Longest step of the stamps that is accepted without confirmation [ns].
    memory_ns : int
        How long learning is suspended after samples out of order [ns].
    largest_force : float
        Larger forces, of either sign, are dropped [N].
    """

    _waiting: list[tuple[IntArray, FloatArray]]
    _count: int
    newest_ns: int | None
    _newest_force: float
    _alone: tuple[int, float] | None
    _out_of_order: deque[int]

    def __init__(
        self, line: TimeLine, longest_gap_ns: int, memory_ns: int, largest_force: float
    ) -> None:
        self._line = line
        self.gap_ns = longest_gap_ns
        self._memory_ns = memory_ns
        self._largest_force = largest_force
        self._waiting = []
        self._count = 0
        self.newest_ns = None
        self._newest_force = 0.0
        self._alone = None
        self._out_of_order = deque(maxlen=_DISORDER)

    @property
    def in_doubt(self) -> bool:
        """Whether a sample waits for another one to confirm its stamp."""
        return self._alone is not None

    def add(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        if not len(forces):
            return
        finite = np.isfinite(forces.force)
        bad = ~self.believes(forces.force)
        start = 0
        for place in (*np.flatnonzero(bad).tolist(), len(bad)):
            if place > start:
                self._take(forces.stamp_ns[start:place], forces.force[start:place])
            if place < len(bad):
                name = faults.FORCE_OUT_OF_BOUNDS if finite[place] else faults.FORCE_NOT_FINITE
                self._line.postpone(name)
            start = place + 1

    def believes(self, force: FloatArray) -> BoolArray:
        """Return which values (samples,) can be forces."""
        with np.errstate(invalid='ignore'):
            believed: BoolArray = np.abs(force) <= self._largest_force
        return believed

    def take(self, until_ns: int) -> tuple[IntArray, FloatArray, int]:
        """Return all waiting samples (samples,), and how many have stamps up to `until_ns` [ns].

        The latter are removed.
        """
        if not self._waiting:
            return np.empty(0, dtype=np.int64), np.empty(0), 0
        stamps = np.concatenate([stamps for stamps, _ in self._waiting])
        values = np.concatenate([values for _, values in self._waiting])
        due = int(np.searchsorted(stamps, until_ns, side='right'))
        self._waiting = [(stamps[due:], values[due:])] if due < len(stamps) else []
        self._count = len(stamps) - due
        return stamps, values, due

    def drop_alone(self) -> None:
        """Drop the sample whose stamp was not confirmed."""
        if self._alone is not None:
            self._line.postpone(faults.FORCE_STAMP_ALONE)
            self._alone = None

    def _check_restored(self) -> None:
        fits = all(len(stamps) == len(values) for stamps, values in self._waiting)
        fits = fits and self._count == sum(len(stamps) for stamps, _ in self._waiting)
        fits = fits and len(self._waiting) <= self._count
        expect(fits, 'ForceIntake', 'as many stamps as forces')

    def _take(self, stamps: IntArray, values: FloatArray) -> None:
        """Take samples (samples,) of possible values, with stamps of any kind."""
        steps = np.diff(stamps)
        irregular = np.flatnonzero((steps <= 0) | (steps > self.gap_ns)) + 1
        ends = np.append(irregular, len(stamps))
        start = 0
        while start < len(stamps):
            if not self._goes_on(int(stamps[start]), float(values[start])):
                start += 1
                continue
            end = int(ends[np.searchsorted(ends, start, side='right')])
            self._keep(stamps[start:end], values[start:end])
            start = end

    def _goes_on(self, stamp_ns: int, value: float) -> bool:
        """Return whether a sample continues the time line."""
        if self.newest_ns is None:
            return True
        step = stamp_ns - self.newest_ns
        if -self.gap_ns <= step <= 0:
            self._refuse(step, value)
            return False
        if abs(step) > self.gap_ns and not self._follow_alone(stamp_ns, value):
            return False
        self.drop_alone()
        return True

    def _keep(self, stamps: IntArray, values: FloatArray) -> None:
        room = MOST_WAITING - self._count
        for _ in range(len(stamps) - room):
            self._line.postpone(faults.FORCE_QUEUE_FULL)
        if room > 0:
            self._waiting.append((stamps[:room], values[:room]))
            self._count += len(stamps[:room])
        self.newest_ns = int(stamps[-1])
        self._newest_force = float(values[-1])

    def _refuse(self, step: int, value: float) -> None:
        """Count a sample that is stamped like or before its predecessor."""
        assert self.newest_ns is not None
        if step == 0 and value == self._newest_force:
            self._line.postpone(faults.FORCE_DUPLICATE)
            return
        if step == 0:
            self._line.postpone(faults.FORCE_CONFLICT)
            self._line.exclude(self.newest_ns - 1, self.newest_ns)
        else:
            self._line.postpone(faults.FORCE_STAMP_NOT_AFTER_LAST)
        self._out_of_order.append(self.newest_ns)
        first_ns = self._out_of_order[0]
        if len(self._out_of_order) == _DISORDER and self.newest_ns - first_ns <= _DISORDER_NS:
            self._line.exclude(first_ns - 1, self.newest_ns + self._memory_ns)

    def _follow_alone(self, stamp_ns: int, value: float) -> bool:
        """Accept a stamp far from its predecessor when a second one follows it.

        Otherwise one wrong stamp would count as two jumps of the clock.  Returns whether
        `stamp_ns` confirms the sample that is waiting alone; if not, it waits in its place.
        """
        if self._alone is None or not 0 < stamp_ns - self._alone[0] <= self.gap_ns:
            self.drop_alone()
            self._alone = (stamp_ns, value)
            return False
        (first_ns, first), self._alone = self._alone, None
        assert self.newest_ns is not None
        if first_ns < self.newest_ns:
            self._line.jump_back(first_ns)
        else:
            self._line.meet_gap(first_ns)
        self._out_of_order.clear()
        self._keep(np.array([first_ns]), np.array([first]))
        return True
