# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Divides the pulses of a recording into single pulses, trains and staircases."""

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

# Intensities or intervals that differ by less are one level: drivers round, triggers jitter.
SAME_INTENSITY = 2e-3
SAME_INTERVAL = 0.05
SHORTEST_LEVEL = 3
LEVEL_SHARE = 0.8


class Kind(Enum):
    """Kind of a group of pulses."""

    SINGLE = 'single pulse'
    TRAIN = 'train'
    STAIRCASE = 'staircase'
    MODULATED = 'modulated train'
    OVERLAPPING = 'overlapping trains'


@dataclass(frozen=True)
class Level:
    """Consecutive pulses of one intensity and one rate.

    Attributes
    ----------
    first, last : int
        Indices of its first pulse and of the one after its last.
    intensity : float
        Share of the maximum; NaN if it is not recorded.
    rate_hz : float
        Repetition rate [Hz]; NaN for a single pulse.
    """

    first: int
    last: int
    intensity: float
    rate_hz: float


@dataclass(frozen=True)
class PulseGroup:
    """Pulses without a rest between them.

    Attributes
    ----------
    kind : Kind
        Its kind.
    first, last : int
        Indices of its first pulse and of the one after its last.
    start_ns, end_ns : int
        Onsets of its first and last pulse [ns].
    levels : tuple of Level
        Runs of equal pulses, in the order of time.
    """

    kind: Kind
    first: int
    last: int
    start_ns: int
    end_ns: int
    levels: tuple[Level, ...]

    @property
    def count(self) -> int:
        """Number of pulses."""
        return self.last - self.first


def in_order(pulses: PulseTrain) -> PulseTrain:
    """Return the pulses by onset, each onset once."""
    onset, first = np.unique(pulses.onset_ns, return_index=True)
    return PulseTrain(onset, pulses.intensity[first], pulses.sequence[first], pulses.width[first])


def groups_of(pulses: PulseTrain, rest: float) -> tuple[PulseGroup, ...]:
    """Return the groups of pulses that are separated by rests.

    Parameters
    ----------
    pulses : PulseTrain
        Ascending in onset.
    rest : float
        Least interval between two groups [s].
    """
    if not len(pulses):
        return ()
    gap = np.diff(pulses.onset_ns) >= nanoseconds(rest)
    edges = np.concatenate(([0], np.flatnonzero(gap) + 1, [len(pulses)]))
    return tuple(_group(pulses, int(first), int(last)) for first, last in pairwise(edges))


def _group(pulses: PulseTrain, first: int, last: int) -> PulseGroup:
    levels = _levels(pulses, first, last)
    start_ns, end_ns = int(pulses.onset_ns[first]), int(pulses.onset_ns[last - 1])
    kind = _kind(levels, last - first)
    return PulseGroup(kind, first, last, start_ns, end_ns, levels)


def _kind(levels: tuple[Level, ...], count: int) -> Kind:
    if count == 1:
        return Kind.SINGLE
    if len(levels) == 1:
        return Kind.TRAIN
    if all(_same(one, next_one) for one, next_one in pairwise(levels)):
        return Kind.OVERLAPPING
    held = sum(level.last - level.first for level in levels if _long(level))
    return Kind.STAIRCASE if held >= LEVEL_SHARE * count else Kind.MODULATED


def _same(one: Level, other: Level) -> bool:
    return (
        not abs(one.intensity - other.intensity) > SAME_INTENSITY
        and abs(one.rate_hz / other.rate_hz - 1.0) <= SAME_INTERVAL
    )


def _long(level: Level) -> bool:
    return level.last - level.first >= SHORTEST_LEVEL


def _levels(pulses: PulseTrain, first: int, last: int) -> tuple[Level, ...]:
    """Return the runs of equal intensity and equal interval to the next pulse."""
    intensity = pulses.intensity[first:last]
    if last - first == 1:
        return (Level(first, last, float(intensity[0]), float('nan')),)
    gap = np.diff(pulses.onset_ns[first:last])
    interval = np.append(gap, gap[-1])
    edges = _edges(intensity, interval)
    return tuple(
        Level(
            first + int(low),
            first + int(high),
            float(intensity[low]),
            float(NANOSECONDS_PER_SECOND / np.median(interval[low : max(low + 1, high - 1)])),
        )
        for low, high in pairwise(edges)
    )


def _edges(intensity: FloatArray, interval: IntArray) -> list[int]:
    """Return the first pulses of runs of equal pulses, and the end (runs + 1,).

    The interval between two levels belongs to neither: a single pulse that differs only by it
    belongs to the level before it.
    """
    known = ~np.isnan(intensity)
    other = known[1:] != known[:-1]
    other |= np.abs(np.nan_to_num(np.diff(intensity))) > SAME_INTENSITY
    jump = np.abs(interval[1:] / interval[:-1] - 1.0) > SAME_INTERVAL
    starts = np.flatnonzero(other | jump) + 1
    ends = np.append(starts, len(intensity))[1:]
    kept = [
        int(start)
        for start, end in zip(starts, ends, strict=True)
        if other[start - 1] or end - start > 1
    ]
    return [0, *kept, len(intensity)]
