# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines of the thread that owns the device, held by the thread that supervises it."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from rpms_ros.pulses import nanoseconds


class Deadline(NamedTuple):
    """When the owner has to have finished something.

    Attributes
    ----------
    name : str
        What it does.
    limit_s : float
        How long that may take [s].
    until_ns : int
        When it must be over [ns].
    """

    name: str
    limit_s: float
    until_ns: int


class Deadlines:
    """The deadline of what the owner does now; of nested ones the inner one counts.

    Parameters
    ----------
    clock : callable
        Monotonic time [ns].
    held_up_ns : int
        A supervisor whose own turn comes this late was held up, and the owner may have been with
        it [ns].
    """

    def __init__(self, clock: Callable[[], int], held_up_ns: int) -> None:
        self._clock = clock
        self._held_up_ns = held_up_ns
        self._now: Deadline | None = None
        # when the supervisor looked last, and the deadline that it has looked past once
        self._looked_ns = clock()
        self._excused: Deadline | None = None

    @contextmanager
    def of(self, name: str, limit_s: float) -> Iterator[None]:
        """Have the supervisor watch that something ends in time."""
        outer = self._now
        self._now = Deadline(name, limit_s, self._clock() + nanoseconds(limit_s))
        try:
            yield
        finally:
            if outer is not None:
                until_ns = self._clock() + nanoseconds(outer.limit_s)
                outer = outer._replace(until_ns=until_ns)
            self._now = outer

    def missed(self, now_ns: int) -> Deadline | None:
        """Return a deadline that was missed, once; called by the supervisor at each of its turns.

        If that turn itself came late, the deadline is looked at once more in the next one: a
        machine that stood still held both threads up, and the owner may be back at once.
        """
        held_up = now_ns - self._looked_ns > self._held_up_ns
        self._looked_ns = now_ns
        missed = self._now
        if missed is None or now_ns <= missed.until_ns:
            return None
        if held_up and missed is not self._excused:
            self._excused = missed
            return None
        self._now = None
        return missed
