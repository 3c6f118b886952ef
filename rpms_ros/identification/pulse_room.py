# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Room for so many pulses in each second of stamps: what comes beyond is refused and counted."""

import numpy as np

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain


class PulseRoom(Restorable):
    """Counts pulses by seconds, first come first served.

    Who is refused follows from what came before in the same second alone: not from what has been
    processed meanwhile, which depends on how a stream is cut into blocks.

    Parameters
    ----------
    most : int
        So many pulses fit into one second.
    """

    _taken: dict[int, int]
    _refused: dict[int, int]

    def __init__(self, most: int) -> None:
        self._most = most
        self._taken = {}
        self._refused = {}

    def admitted(self, pulses: PulseTrain, stamp_ns: IntArray) -> PulseTrain:
        """Return the pulses for which there is room in the seconds of these stamps (pulses,)."""
        second = stamp_ns // NANOSECONDS_PER_SECOND
        kept: BoolArray = np.ones(len(pulses), dtype=np.bool_)
        for one in np.unique(second).tolist():
            here = np.flatnonzero(second == one)
            room = self._most - self._taken.get(one, 0)
            self._taken[one] = self._taken.get(one, 0) + min(len(here), room)
            if len(here) > room:
                kept[here[room:]] = False
                self._refused[one] = self._refused.get(one, 0) + len(here) - room
        return pulses[kept]

    def refused(self, until_ns: int) -> int:
        """Return how many were refused in seconds over by `until_ns`, which are forgotten."""
        over = [one for one in self._taken if (one + 1) * NANOSECONDS_PER_SECOND <= until_ns]
        for one in over:
            del self._taken[one]
        return sum(self._refused.pop(one, 0) for one in over)
