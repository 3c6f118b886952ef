# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Segments of repetitive pulses: one rate, constant or changing, and an intensity over time."""

import math
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
from rpms_ros.stimulation.segment import LOWEST_RATE_HZ
from rpms_ros.stimulation.segment import Segment

RATE = Bound(LOWEST_RATE_HZ, HIGHEST_RATE_HZ, 'Hz')
SEED = Bound(0, 2**53, whole=True, optional=True)

# Rate times duration is rarely a whole number in floating point; a millionth of a period decides
# whether the pulse at the very end belongs to the segment (it does not).
_PERIOD_SLACK = 1e-6


def refuse_swapped(low: float, high: float) -> None:
    """Raise StimulationError unless ``low`` <= ``high``."""
    if low > high:
        raise StimulationError(f'expected low <= high, got {low:g} and {high:g}')


@dataclass(frozen=True)
class Repetitive(Segment):
    """Pulses at a repetition rate that is constant or changes linearly in time.

    Attributes
    ----------
    rate_hz : float
        Repetition rate at the start [Hz].
    duration_s : float
        Length of the segment [s].
    final_rate_hz : float, optional
        Repetition rate at the end [Hz]; as ``rate_hz`` if it is missing.
    """

    rate_hz: float = bounded(RATE)
    duration_s: float = bounded(DURATION)
    final_rate_hz: float | None = bounded(
        Bound(LOWEST_RATE_HZ, HIGHEST_RATE_HZ, 'Hz', optional=True), None
    )

    @property
    def length_s(self) -> float:
        """Length of the segment [s]."""
        return self.duration_s

    @property
    def pulse_count(self) -> int:
        """Number of periods that begin within the segment: mean rate times duration, upwards."""
        final = self.rate_hz if self.final_rate_hz is None else self.final_rate_hz
        periods = 0.5 * (self.rate_hz + final) * self.duration_s
        return max(1, math.ceil(periods - _PERIOD_SLACK))

    def onsets_ns(self) -> IntArray:
        """Return the times at which the phase f t + (f_end - f) t^2 / (2 T) is whole [ns]."""
        phase = np.arange(self.pulse_count, dtype=np.float64)
        if self.final_rate_hz is None:
            return np.rint(phase * (NANOSECONDS_PER_SECOND / self.rate_hz)).astype(np.int64)
        slope = (self.final_rate_hz - self.rate_hz) / self.duration_s
        # the root of the quadratic in the form that does not cancel when the slope is small
        root = np.sqrt(np.maximum(self.rate_hz**2 + 2.0 * slope * phase, 0.0))
        onset_s = 2.0 * phase / (self.rate_hz + root)
        return np.rint(onset_s * NANOSECONDS_PER_SECOND).astype(np.int64)


@dataclass(frozen=True)
class Constant(Repetitive):
    """One intensity."""

    kind: ClassVar[str] = 'constant'
    intensity: float = share(1.0)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the same intensity for every pulse."""
        del random
        return np.full_like(onset_s, self.intensity)


@dataclass(frozen=True)
class Ramp(Repetitive):
    """Intensity that changes linearly from ``start`` to ``end``."""

    kind: ClassVar[str] = 'ramp'
    start: float = share(0.0)
    end: float = share(1.0)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the straight line through (0, start) and (duration, end)."""
        del random
        return self.start + (self.end - self.start) * (onset_s / self.duration_s)


@dataclass(frozen=True)
class Staircase(Repetitive):
    """Levels of equal length, one after another."""

    kind: ClassVar[str] = 'staircase'
    levels: tuple[float, ...] = bounded(
        Bound(0.0, 1.0, several=True), (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
    )

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return the level of the step that each onset falls into."""
        del random
        # a pulse due exactly at an edge belongs to the step that begins there, rounding or not
        step = np.floor(onset_s / self.duration_s * len(self.levels) + _PERIOD_SLACK)
        last = len(self.levels) - 1
        return np.asarray(self.levels)[np.minimum(step.astype(np.int64), last)]


@dataclass(frozen=True)
class Sinusoid(Repetitive):
    """Intensity between ``low`` and ``high``, starting at ``low`` (Sec. 3.3.1: period 9 s)."""

    kind: ClassVar[str] = 'sinusoid'
    low: float = share(0.0)
    high: float = share(1.0)
    period_s: float = bounded(DURATION, 9.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_swapped(self.low, self.high)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return low + (high - low) (1 - cos(2 pi t / period)) / 2."""
        del random
        rise = 0.5 - 0.5 * np.cos(2.0 * math.pi / self.period_s * onset_s)
        return self.low + (self.high - self.low) * np.clip(rise, 0.0, 1.0)


@dataclass(frozen=True)
class UniformRandom(Repetitive):
    """Independent intensities, uniform between ``low`` and ``high`` (Eq. 29)."""

    kind: ClassVar[str] = 'uniform_random'
    low: float = share(0.0)
    high: float = share(1.0)
    seed: int | None = bounded(SEED, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_swapped(self.low, self.high)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator) -> FloatArray:
        """Return draws from ``random``, or from the segment's own seed if it has one."""
        own = random if self.seed is None else np.random.default_rng(self.seed)
        return own.uniform(self.low, self.high, len(onset_s))
