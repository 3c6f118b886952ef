# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses stamped far after the newest force: kept for a limited time in case it follows."""

import numpy as np

from rpms_ros.identification.pulse_room import PulseRoom
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import PulseTrain

# A pulse is far beyond this, and is given up when the force went on as long without it [ns].
FAR_NS = 10 * NANOSECONDS_PER_SECOND
# So many are kept of those that come while the force goes on by a second, or before the first of
# it: pulses of more than an hour at 20 Hz.
MOST_PULSES = 100_000
# Where the force was before its first sample.
_LONG_AGO = -(2**63)


class FarPulses(Restorable):
    """Keeps far pulses, by the newest stamp of the force when they arrived."""

    _kept: list[tuple[int | None, PulseTrain]]
    _count: int
    _nearest_ns: int
    _room: PulseRoom

    def __init__(self) -> None:
        self._kept = []
        self._count = 0
        self._nearest_ns = 0
        self._room = PulseRoom(MOST_PULSES)

    def take(self, pulses: PulseTrain, newest_ns: int | None) -> PulseTrain:
        """Keep the far pulses; return the others."""
        if newest_ns is None:
            pulses = self._admitted(pulses, _LONG_AGO)
        if not len(pulses):
            return pulses
        first_ns = newest_ns if newest_ns is not None else int(pulses.onset_ns.min())
        far = pulses.onset_ns > first_ns + FAR_NS
        if far.any():
            kept = pulses[far]
            if newest_ns is not None:
                kept = self._admitted(kept, newest_ns)
            self._keep(kept, newest_ns)
        return pulses[~far]

    def come_near(self, until_ns: int) -> tuple[list[PulseTrain], int]:
        """Return the pulses no longer far at `until_ns` [ns], and how many were given up."""
        near: list[PulseTrain] = []
        given_up = self._room.refused(until_ns)
        if self._count and (self._nearest_ns <= until_ns + FAR_NS or self._due(until_ns)):
            kept, self._kept, self._count = self._kept, [], 0
            for newest_ns, train in kept:
                far = train.onset_ns > until_ns + FAR_NS
                near.append(train[~far])
                if newest_ns is not None and until_ns > newest_ns + FAR_NS:
                    given_up += int(np.count_nonzero(far))
                elif far.any():
                    self._keep(train[far], newest_ns)
        return near, given_up

    def _admitted(self, pulses: PulseTrain, newest_ns: int) -> PulseTrain:
        return self._room.admitted(pulses, np.full(len(pulses), newest_ns, dtype=np.int64))

    def _due(self, until_ns: int) -> bool:
        """Return whether the force went on so long that some pulses are given up."""
        oldest = self._kept[0][0]
        return oldest is not None and until_ns > oldest + FAR_NS

    def _keep(self, pulses: PulseTrain, newest_ns: int | None) -> None:
        if not len(pulses):
            return
        nearest_ns = int(pulses.onset_ns.min())
        self._nearest_ns = min(self._nearest_ns, nearest_ns) if self._count else nearest_ns
        self._count += len(pulses)
        if self._kept and self._kept[-1][0] == newest_ns:
            pulses = PulseTrain.joined([self._kept.pop()[1], pulses])
        self._kept.append((newest_ns, pulses))
