# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses stamped far after the newest force: kept for a limited time in case it follows."""

import numpy as np

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import PulseTrain

# A pulse is far beyond this, and is given up when the force went on as long without it [ns].
FAR_NS = 10 * NANOSECONDS_PER_SECOND
# Pulses of more than an hour at 20 Hz.
MOST_PULSES = 100_000


class FarPulses(Restorable):
    """Keeps far pulses, by the newest stamp of the force when they arrived."""

    _kept: list[tuple[int | None, PulseTrain]]
    _count: int
    _nearest_ns: int
    _given_up: int

    def __init__(self) -> None:
        self._kept = []
        self._count = 0
        self._nearest_ns = 0
        self._given_up = 0

    def take(self, pulses: PulseTrain, newest_ns: int | None) -> PulseTrain:
        """Keep the far pulses; return the others."""
        if not len(pulses):
            return pulses
        first_ns = newest_ns if newest_ns is not None else int(pulses.onset_ns.min())
        far = pulses.onset_ns > first_ns + FAR_NS
        if far.any():
            self._keep(pulses[far], newest_ns)
        return pulses[~far]

    def come_near(self, until_ns: int) -> tuple[list[PulseTrain], int]:
        """Return the pulses no longer far at `until_ns` [ns], and how many were given up."""
        near: list[PulseTrain] = []
        if self._count and (self._nearest_ns <= until_ns + FAR_NS or self._due(until_ns)):
            kept, self._kept, self._count = self._kept, [], 0
            for newest_ns, train in kept:
                far = train.onset_ns > until_ns + FAR_NS
                near.append(train[~far])
                if newest_ns is not None and until_ns > newest_ns + FAR_NS:
                    self._given_up += int(np.count_nonzero(far))
                elif far.any():
                    self._keep(train[far], newest_ns)
        given_up, self._given_up = self._given_up, 0
        return near, given_up

    def _due(self, until_ns: int) -> bool:
        """Return whether the force went on so long that some pulses are given up."""
        oldest = self._kept[0][0]
        return oldest is not None and until_ns > oldest + FAR_NS

    def _keep(self, pulses: PulseTrain, newest_ns: int | None) -> None:
        """Keep pulses; the farthest are given up if there are too many."""
        nearest_ns = int(pulses.onset_ns.min())
        self._nearest_ns = min(self._nearest_ns, nearest_ns) if self._count else nearest_ns
        if self._kept and self._kept[-1][0] == newest_ns:
            pulses = PulseTrain.joined([self._kept.pop()[1], pulses])
            self._count = sum(len(train) for _, train in self._kept)
        self._kept.append((newest_ns, pulses))
        self._count += len(pulses)
        if self._count > MOST_PULSES:
            everything = np.concatenate([train.onset_ns for _, train in self._kept])
            limit_ns = np.partition(everything, MOST_PULSES - 1)[MOST_PULSES - 1]
            kept = [(since, train[train.onset_ns <= limit_ns]) for since, train in self._kept]
            self._kept = [(since, train) for since, train in kept if len(train)]
            before, self._count = self._count, sum(len(train) for _, train in self._kept)
            self._given_up += before - self._count
