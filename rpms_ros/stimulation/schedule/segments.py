# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Segments of repetitive pulses: one rate, constant or changing, and an intensity over time.

Segments of few pulses: single, doublet, N-let.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray
from rpms_ros.stimulation.schedule.fields import Bound, Bounded, bounded, share
from rpms_ros.stimulation.schedule.schedule import (
    DURATION,
    HIGHEST_RATE_HZ,
    LONGEST_S,
    LOWEST_RATE_HZ,
    Segment,
)

RATE = Bound(LOWEST_RATE_HZ, HIGHEST_RATE_HZ, 'Hz')
SEED = Bound(0, 2**53, whole=True, optional=True)

# Of a staircase that states none.
LEVELS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)

# Rate times duration is rarely a whole number in floating point; a millionth of a period decides
# whether the pulse at the very end belongs to the segment (it does not).
_PERIOD_SLACK = 1e-6


@dataclass(frozen=True)
class Even(Bounded):
    """One intensity, which has to be stated: field of several kinds of segments."""

    intensity: float = share()

    def intensities(self, onset_s: FloatArray, _: np.random.Generator, /) -> FloatArray:
        """Return the same intensity for every pulse."""
        return np.full_like(onset_s, self.intensity)


@dataclass(frozen=True)
class Between(Bounded):
    """Intensities from ``low`` to ``high``: fields of several kinds of segments."""

    low: float = share(0.0)
    high: float = share(1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise StimulationError(f'expected low <= high, got {self.low:g} and {self.high:g}')


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
    final_rate_hz: float | None = bounded(replace(RATE, optional=True), None, named=True)

    @property
    def pulse_count(self) -> int:
        """Number of periods that begin within the segment: mean rate times duration, upwards."""
        final = self.rate_hz if self.final_rate_hz is None else self.final_rate_hz
        return max(1, math.ceil(0.5 * (self.rate_hz + final) * self.duration_s - _PERIOD_SLACK))

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
class Constant(Even, Repetitive):
    """One intensity."""

    kind: ClassVar[str] = 'constant'


@dataclass(frozen=True)
class Gradual(Repetitive):
    """Intensity that follows a course, with catch pulses among it.

    An effort of the patient that follows what is felt cannot be told from recruitment while the
    intensity changes slowly; a catch pulse has an intensity of the course, but not of its place.

    Attributes
    ----------
    catch_share : float, optional
        Share of the pulses, drawn at random, that are catch pulses; none if it is missing.
    """

    catch_share: float | None = bounded(Bound(0.0, 1.0, above=True, optional=True), None)

    @abstractmethod
    def course(self, onset_s: FloatArray) -> FloatArray:
        """Return the intensity at the onsets (pulses,) [s] without catch pulses."""

    def intensities(self, onset_s: FloatArray, random: np.random.Generator, /) -> FloatArray:
        """Return the course, in which catch pulses are drawn from ``random``."""
        course = self.course(onset_s)
        if self.catch_share is None:
            return course
        caught = random.random(len(course)) < self.catch_share
        return np.where(caught, random.permutation(course), course)


@dataclass(frozen=True)
class Ramp(Gradual):
    """Intensity that changes linearly from ``start`` to ``end``."""

    kind: ClassVar[str] = 'ramp'
    start: float = share(0.0)
    end: float = share(1.0)

    def course(self, onset_s: FloatArray) -> FloatArray:
        """Return the straight line through (0, start) and (duration, end)."""
        return self.start + (self.end - self.start) * (onset_s / self.duration_s)


@dataclass(frozen=True)
class Staircase(Gradual):
    """Levels of equal length, one after another."""

    kind: ClassVar[str] = 'staircase'
    levels: tuple[float, ...] = bounded(Bound(0.0, 1.0, several=True), LEVELS)

    def course(self, onset_s: FloatArray) -> FloatArray:
        """Return the level of the step that each onset falls into."""
        # a pulse due exactly at an edge belongs to the step that begins there, rounding or not
        step = np.floor(onset_s / self.duration_s * len(self.levels) + _PERIOD_SLACK)
        return np.asarray(self.levels)[np.minimum(step.astype(np.int64), len(self.levels) - 1)]


@dataclass(frozen=True)
class Sinusoid(Between, Gradual):
    """Intensity between ``low`` and ``high``, starting at ``low`` (Sec. 3.3.1: period 9 s)."""

    kind: ClassVar[str] = 'sinusoid'
    period_s: float = bounded(DURATION, 9.0)

    def course(self, onset_s: FloatArray) -> FloatArray:
        """Return low + (high - low) (1 - cos(2 pi t / period)) / 2."""
        rise = 0.5 - 0.5 * np.cos(2.0 * math.pi / self.period_s * onset_s)
        return self.low + (self.high - self.low) * np.clip(rise, 0.0, 1.0)


@dataclass(frozen=True)
class UniformRandom(Between, Repetitive):
    """Independent intensities, uniform between ``low`` and ``high`` (Eq. 29)."""

    kind: ClassVar[str] = 'uniform_random'
    seed: int | None = bounded(SEED, None)

    def intensities(self, onset_s: FloatArray, random: np.random.Generator, /) -> FloatArray:
        """Return draws from ``random``, or from the segment's own seed if it has one."""
        own = random if self.seed is None else np.random.default_rng(self.seed)
        return own.uniform(self.low, self.high, len(onset_s))


@dataclass(frozen=True)
class PulseBurst(Even, Segment):
    """``count`` pulses ``interval_s`` apart (an N-let), then silence to the end of the segment."""

    kind: ClassVar[str] = 'n_let'
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
    def pulse_count(self) -> int:
        """Number of pulses."""
        return self.count

    def onsets_ns(self) -> IntArray:
        """Return multiples of the interval [ns], shape (count,)."""
        number = np.arange(self.pulse_count, dtype=np.float64)
        return np.rint(number * (self.interval_s * NANOSECONDS_PER_SECOND)).astype(np.int64)


@dataclass(frozen=True)
class Single(Even, Segment):
    """One pulse, then silence to the end of the segment."""

    kind: ClassVar[str] = 'single'
    duration_s: float = bounded(DURATION, 1.0)

    @property
    def pulse_count(self) -> int:
        """One."""
        return 1

    def onsets_ns(self) -> IntArray:
        """Return the start of the segment."""
        return np.zeros(1, dtype=np.int64)


@dataclass(frozen=True)
class Doublet(PulseBurst):
    """Two pulses."""

    kind: ClassVar[str] = 'doublet'
    count: int = bounded(Bound(2, 2, whole=True), 2)
