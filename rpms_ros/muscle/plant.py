# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated plant: pulses in, force samples on an exact grid out."""

import math
from collections import Counter
from fractions import Fraction

import numpy as np

from rpms_ros.muscle.state import Muscle
from rpms_ros.muscle.surroundings import Surroundings
from rpms_ros.muscle.truth import Truth
from rpms_ros.muscle.truth import truth_at
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import Pulse
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

# Faults of a pulse.
INTENSITY = 'pulse_intensity_out_of_range'
WIDTH = 'pulse_width_out_of_range'
LATE = 'pulse_late'

# After this time an artifact with a time constant of 5 ms has decayed to exp(-40).
_ARTIFACT_MEMORY_NS = NANOSECONDS_PER_SECOND // 5


class SampledPlant:
    """A muscle with a force sensor that is sampled at stamps ``start + k / rate``.

    Parameters
    ----------
    muscle : Muscle
        The muscle, before any pulse.
    surroundings : Surroundings
        Efforts and sensor.
    rate : float
        Force samples a second [Hz].
    """

    def __init__(self, muscle: Muscle, surroundings: Surroundings, rate: float) -> None:
        self._muscle = muscle
        self._surroundings = surroundings
        # A fraction keeps the sampling grid exact, however long the session is.
        self._period_ns = NANOSECONDS_PER_SECOND / Fraction(rate)
        self._first_ns = 0
        self._produced = 0
        self._recent: list[Pulse] = []
        self.faults: Counter[str] = Counter()

    def begin(self, start_ns: int) -> None:
        """Begin the grid at the first multiple of the sampling period from `start_ns` on."""
        self._first_ns = round(math.ceil(start_ns / self._period_ns) * self._period_ns)
        self._produced = 0
        self._muscle.begin(self._first_ns)
        self._surroundings.begin(self._first_ns)

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest sample, or one period before the first [ns]."""
        return self._stamp(self._produced - 1)

    def add(self, pulse: Pulse) -> str | None:
        """Add a pulse; return the name of its fault, if it has one.

        An invalid pulse has no effect.  A late one, whose twitch should have begun before samples
        that were already produced, acts exactly on the samples still to come.
        """
        fault = _fault_of(pulse)
        if fault is None:
            self._muscle.add_pulses(pulse.onset_ns, pulse.intensity)
            self._recent.append(pulse)
            latency_ns = nanoseconds(self._muscle.subject.latency)
            if self._produced and pulse.onset_ns + latency_ns < self.newest_ns:
                fault = LATE
        if fault is not None:
            self.faults[fault] += 1
        return fault

    def due(self, now_ns: int) -> int:
        """Return how many samples up to `now_ns` [ns] have not been produced yet."""
        begun = (now_ns - self._first_ns) // self._period_ns + 1
        return max(0, begun - self._produced)

    def sample(self, count: int) -> ForceTrace:
        """Return the next `count` samples; a sensor fault may leave some out or double them."""
        indices = range(self._produced, self._produced + count)
        stamps = np.array([self._stamp(index) for index in indices], dtype=np.int64)
        self._produced += count
        force = self._muscle.force(stamps)
        return self._surroundings.measured(stamps, force, self._acting_pulses(stamps))

    def truth(self) -> Truth:
        """Return the true state at the newest sample."""
        return truth_at(self._muscle, self._surroundings, self.newest_ns)

    def _stamp(self, index: int) -> int:
        return self._first_ns + round(index * self._period_ns)

    def _acting_pulses(self, stamps: IntArray) -> PulseTrain:
        """Return the pulses that may leave an artifact in these samples, ascending."""
        if len(stamps):
            limit = int(stamps[0]) - _ARTIFACT_MEMORY_NS
            self._recent = sorted(pulse for pulse in self._recent if pulse.onset_ns >= limit)
        return PulseTrain.of(self._recent)


def _fault_of(pulse: Pulse) -> str | None:
    if not 0.0 <= pulse.intensity <= 1.0:
        return INTENSITY
    if not 0.0 <= pulse.width < math.inf:
        return WIDTH
    return None
