# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses stamped long before the force: late, or the first ones after a clock has jumped back."""

from collections import deque

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import PulseTrain

# A stray pulse counts as late when the force has gone on at least this long [ns].
_PATIENCE_NS = NANOSECONDS_PER_SECOND
_MOST = 1000


class StrayPulses(Restorable):
    """Keeps stray pulses until the force shows whether the clock has jumped.

    The result does not depend on how the stream is cut into blocks.

    Parameters
    ----------
    overtaking_ns : int
        How long before the force a pulse of a new time line may arrive [ns].
    """

    _kept: deque[tuple[int, PulseTrain]]
    _count: int
    _late: deque[tuple[int, int]]

    def __init__(self, overtaking_ns: int) -> None:
        self._overtaking_ns = overtaking_ns
        # While a pulse may be of a new time line, it is not late.
        self._patience_ns = max(_PATIENCE_NS, overtaking_ns)
        self._kept = deque()
        self._count = 0
        self._late = deque()

    def add(self, pulses: PulseTrain, newest_ns: int) -> None:
        """Keep pulses that arrived when the newest force was at `newest_ns`; they may be none."""
        if not len(pulses):
            return
        while self._kept and self._kept[0][0] + self._overtaking_ns < newest_ns:
            self._count -= len(self._kept.popleft()[1])
        kept = pulses[: max(_MOST - self._count, 0)]
        if len(kept):
            self._kept.append((newest_ns, kept))
            self._count += len(kept)
        before = self._late.pop()[1] if self._late and self._late[-1][0] == newest_ns else 0
        self._late.append((newest_ns, before + len(pulses)))

    def taken(self, newest_ns: int) -> PulseTrain:
        """Return the pulses that arrived just before the clock jumped; the others are late."""
        kept, self._kept, self._count = self._kept, deque(), 0
        recent = [one for one in kept if one[0] >= newest_ns - self._overtaking_ns]
        late = dict(self._late)
        for since, train in recent:
            late[since] -= len(train)
        self._late = deque(late.items())
        return PulseTrain.joined([PulseTrain.of([]), *(train for _, train in recent)])

    def given_up(self, until_ns: int | None) -> int:
        """Return how many are late, now that the force has come to `until_ns` [ns].

        None: the session ends.
        """
        count = 0
        while self._late and (until_ns is None or self._late[0][0] + self._patience_ns < until_ns):
            count += self._late.popleft()[1]
        if until_ns is None:
            self._kept, self._count = deque(), 0
        return count
