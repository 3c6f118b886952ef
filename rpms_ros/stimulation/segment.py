# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A segment of a schedule: what every kind of excitation has, and silence.

A segment puts its first pulse at its own start and none at or after its end.  Times are integer
nanoseconds from the start of the segment; intensities are shares of the stimulator's maximum.
"""

from abc import ABC
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import check_bounds

# One pulse in 1000 s; bounded below so that no onset leaves the range of an integer.
LOWEST_RATE_HZ = 1e-3
HIGHEST_RATE_HZ = 1000.0
SHORTEST_S = 1e-6
LONGEST_S = 86_400.0
DURATION = Bound(SHORTEST_S, LONGEST_S, 's')


@dataclass(frozen=True)
class Segment(ABC):
    """A piece of a schedule; every kind is a subclass."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    @abstractmethod
    def length_s(self) -> float:
        """Time from its start to the start of the next segment [s]."""

    @property
    @abstractmethod
    def pulse_count(self) -> int:
        """Number of pulses, known before any is computed."""

    @abstractmethod
    def onsets_ns(self) -> IntArray:
        """Return the onsets [ns] from the start of the segment, shape (pulses,)."""

    @abstractmethod
    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the intensities (share 0..1) of pulses at ``onset_s`` [s], shape (pulses,)."""


@dataclass(frozen=True)
class Pause(Segment):
    """Silence."""

    kind: ClassVar[str] = 'pause'
    duration_s: float = bounded(DURATION)

    @property
    def length_s(self) -> float:
        """Time without a pulse [s]."""
        return self.duration_s

    @property
    def pulse_count(self) -> int:
        """None."""
        return 0

    def onsets_ns(self) -> IntArray:
        """Return an empty array."""
        return np.empty(0, dtype=np.int64)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return an empty array."""
        del random
        return np.zeros_like(onset_s)
