# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Segments of few pulses: single, doublet, N-let."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import share
from rpms_ros.stimulation.segment import DURATION
from rpms_ros.stimulation.segment import HIGHEST_RATE_HZ
from rpms_ros.stimulation.segment import LONGEST_S
from rpms_ros.stimulation.segment import Segment


@dataclass(frozen=True)
class PulseBurst(Segment):
    """``count`` pulses ``interval_s`` apart (an N-let), then silence to the end of the segment."""

    kind: ClassVar[str] = 'n_let'
    intensity: float = share(1.0)
    count: int = bounded(Bound(1, 1000, whole=True), 3)
    interval_s: float = bounded(Bound(1.0 / HIGHEST_RATE_HZ, LONGEST_S, 's'), 0.01)
    duration_s: float = bounded(DURATION, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.pulse_count - 1) * self.interval_s >= self.duration_s:
            raise StimulationError(
                f'expected a duration above {(self.pulse_count - 1) * self.interval_s:g} s, the '
                f'length of {self.pulse_count} pulses, got {self.duration_s:g}'
            )

    @property
    def length_s(self) -> float:
        """Length of the segment with the silence after the pulses [s]."""
        return self.duration_s

    @property
    def pulse_count(self) -> int:
        """Number of pulses."""
        return self.count

    def onsets_ns(self) -> IntArray:
        """Return multiples of the interval [ns], shape (count,)."""
        number = np.arange(self.pulse_count, dtype=np.float64)
        return np.rint(number * (self.interval_s * NANOSECONDS_PER_SECOND)).astype(np.int64)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the same intensity for every pulse."""
        del random
        return np.full_like(onset_s, self.intensity)


@dataclass(frozen=True)
class Single(Segment):
    """One pulse, then silence to the end of the segment."""

    kind: ClassVar[str] = 'single'
    intensity: float = share(1.0)
    duration_s: float = bounded(DURATION, 1.0)

    @property
    def length_s(self) -> float:
        """Length of the segment with the silence after the pulse [s]."""
        return self.duration_s

    @property
    def pulse_count(self) -> int:
        """One."""
        return 1

    def onsets_ns(self) -> IntArray:
        """Return the start of the segment."""
        return np.zeros(1, dtype=np.int64)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the intensity."""
        del random
        return np.full_like(onset_s, self.intensity)


@dataclass(frozen=True)
class Doublet(PulseBurst):
    """Two pulses."""

    kind: ClassVar[str] = 'doublet'
    count: int = bounded(Bound(2, 2, whole=True), 2)
