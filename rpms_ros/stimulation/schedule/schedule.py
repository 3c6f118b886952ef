# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules: segments in a row, repeated or not, and the pulses that they stand for.

A schedule is known in full before its first pulse: counts, duration and intensities follow from
its description and its seed, so a device's limits can be held against all of it.

A segment of a schedule: what every kind of excitation has, and silence.

A segment puts its first pulse at its own start and none at or after its end.  Times are integer
nanoseconds from the start of the segment; intensities are shares of the stimulator's maximum.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import (
    MAGNETIC_PULSE_WIDTH,
    NANOSECONDS_PER_SECOND,
    FloatArray,
    IntArray,
    PulseTrain,
    nanoseconds,
)
from rpms_ros.stimulation.schedule.fields import LONGEST_NAME, Bound, Bounded, bounded, read_text

# One pulse in 1000 s; bounded below so that no onset leaves the range of an integer.
LOWEST_RATE_HZ = 1e-3
HIGHEST_RATE_HZ = 1000.0
LONGEST_S = 86_400.0
DURATION = Bound(1e-6, LONGEST_S, 's')


@dataclass(frozen=True)
class Segment(Bounded, ABC):
    """A piece of a schedule; every kind is a subclass with a ``duration_s``."""

    kind: ClassVar[str]

    @property
    def length_s(self) -> float:
        """Time from its start to the start of the next segment [s]."""
        return float(getattr(self, 'duration_s'))  # noqa: B009 - of the subclasses

    @property
    @abstractmethod
    def pulse_count(self) -> int:
        """Number of pulses, known before any is computed."""

    @abstractmethod
    def onsets_ns(self) -> IntArray:
        """Return the onsets [ns] from the start of the segment, shape (pulses,)."""

    @abstractmethod
    def intensities(self, onset_s: FloatArray, random: np.random.Generator, /) -> FloatArray:
        """Return the intensities (share 0..1) of pulses at ``onset_s`` [s], shape (pulses,)."""


@dataclass(frozen=True)
class Pause(Segment):
    """Silence."""

    kind: ClassVar[str] = 'pause'
    duration_s: float = bounded(DURATION)

    @property
    def pulse_count(self) -> int:
        """None."""
        return 0

    def onsets_ns(self) -> IntArray:
        """Return an empty array."""
        return np.empty(0, dtype=np.int64)

    def intensities(self, onset_s: FloatArray, _: np.random.Generator, /) -> FloatArray:
        """Return an empty array."""
        return np.zeros_like(onset_s)


MOST_PULSES = 500_000


@dataclass(frozen=True)
class _Row(Bounded):
    """Segments in a row, once or several times; nothing is worked out to count them."""

    segments: tuple['Segment | Repeat', ...]
    times: ClassVar[int] = 1

    @cached_property
    def pulse_count(self) -> int:
        """Number of pulses of all repetitions."""
        return self.times * sum(segment.pulse_count for segment in self.segments)

    @cached_property
    def length_s(self) -> float:
        """Duration of all repetitions [s]."""
        return self.times * sum(segment.length_s for segment in self.segments)

    @cached_property
    def pieces(self) -> int:
        """Number of segments that it unrolls to."""
        inner = (item.pieces if isinstance(item, Repeat) else 1 for item in self.segments)
        return self.times * sum(inner)


@dataclass(frozen=True)
class Repeat(_Row):
    """Segments that are given several times in a row.

    Attributes
    ----------
    times : int
        How often.
    segments : tuple of Segment or Repeat
        What is repeated; random segments without a seed of their own differ each time.
    """

    times: int = bounded(Bound(1, 100_000, whole=True), 2)  # type: ignore[misc]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.segments:
            raise StimulationError('expected at least one segment to repeat, got none')


@dataclass(frozen=True)
class Plan:
    """A schedule worked out, pulse by pulse.

    Attributes
    ----------
    onset_ns : ndarray of int64, shape (pulses,)
        Onsets from the start of the schedule [ns].
    intensity : ndarray of float64, shape (pulses,)
        Shares of the maximum, 0..1.
    segment : ndarray of int64, shape (pulses,)
        Index of the outermost segment that each pulse belongs to.
    duration_ns : int
        Length of the schedule [ns].
    """

    onset_ns: IntArray
    intensity: FloatArray
    segment: IntArray
    duration_ns: int

    def __len__(self) -> int:
        return len(self.onset_ns)

    @property
    def duration_s(self) -> float:
        """Length [s]."""
        return self.duration_ns / NANOSECONDS_PER_SECOND

    @property
    def highest_rate_hz(self) -> float:
        """Largest rate between two pulses [Hz], 0 with fewer than two."""
        gaps = np.diff(self.onset_ns)
        return NANOSECONDS_PER_SECOND / float(gaps.min()) if len(gaps) else 0.0


@dataclass(frozen=True)
class Schedule(_Row):
    """Segments in a row.

    Attributes
    ----------
    segments : tuple of Segment or Repeat
        In the order in which they are given.
    name : str
        What people call it.
    seed : int
        Of every random segment that has none of its own.
    width_s : float
        Duration of every pulse [s].
    """

    name: str = 'schedule'
    seed: int = bounded(Bound(0, 2**53, whole=True), 0)
    width_s: float = bounded(Bound(1e-6, 0.01, 's'), MAGNETIC_PULSE_WIDTH)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, 'name', read_text({'name': self.name}, 'name', '', LONGEST_NAME))
        if not self.segments:
            raise StimulationError('expected at least one segment, got none')
        for what, value, most in (
            ('pulses', self.pulse_count, MOST_PULSES),
            ('segments after unrolling', self.pieces, MOST_PULSES),
            ('seconds', self.length_s, LONGEST_S),
        ):
            if value > most:
                raise StimulationError(f'expected at most {most:g} {what}, got {value:g}')

    @cached_property
    def plan(self) -> Plan:
        """All pulses; the same for the same description and seed."""
        random, end_ns = np.random.default_rng(self.seed), 0
        parts: list[tuple[IntArray, FloatArray, IntArray]] = []
        for owner, item in enumerate(self.segments):
            for piece in _unrolled(item):
                onset_ns = piece.onsets_ns()
                values = piece.intensities(onset_ns / NANOSECONDS_PER_SECOND, random)
                owners = np.full(len(onset_ns), owner, dtype=np.int64)
                parts.append((onset_ns + end_ns, np.clip(values, 0.0, 1.0), owners))
                end_ns += nanoseconds(piece.length_s)
        onset_ns, intensity, segment = (np.concatenate(part) for part in zip(*parts, strict=True))
        plan = Plan(onset_ns, intensity, segment, end_ns)
        _refuse_disorder(plan)
        return plan

    def pulses(self, start_ns: int = 0) -> PulseTrain:
        """Return the pulses of the schedule when it starts at ``start_ns`` [ns]."""
        plan = self.plan
        return PulseTrain.numbered(plan.onset_ns + start_ns, plan.intensity, self.width_s)


def _unrolled(item: Segment | Repeat) -> Iterator[Segment]:
    if not isinstance(item, Repeat):
        yield item
        return
    for _ in range(item.times):
        for inner in item.segments:
            yield from _unrolled(inner)


def _refuse_disorder(plan: Plan) -> None:
    """Raise StimulationError unless onsets rise and lie within their segments.

    Bounds of the fields leave no way to this; what is fired does not rest on that alone.
    """
    if not len(plan):
        return
    ascending = bool(np.all(np.diff(plan.onset_ns) >= 0))
    if not ascending or plan.onset_ns[0] < 0 or plan.onset_ns[-1] > plan.duration_ns:
        fault = f'expected onsets that ascend from 0 to {plan.duration_ns} ns'
        raise StimulationError(f'{fault}, got {plan.onset_ns.min()} to {plan.onset_ns.max()} ns')
    if not np.all(np.isfinite(plan.intensity)):
        raise StimulationError('expected finite intensities, got some that are not')
