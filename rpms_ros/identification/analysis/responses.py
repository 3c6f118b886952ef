# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Responses to groups of pulses, cut out of a recording, or the reason for rejecting them.

The force is put in order and judged first: rate, saturation, noise.  The pulses are divided into
single pulses, trains and staircases.  Stimulation artifacts in the force show the stimulus instant
by the clock of the sensor: an artifact lasts one or two samples, so the force minus its running
median over five samples is the artifact and noise.  Its maximum is the paper's stimulus instant
(Sec. 2.1); its distance from the stamp of the pulse shows the offset between the clocks of
stimulator and sensor.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are asked for

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.stream.stream import LARGEST_FORCE
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
    nanoseconds,
)
from rpms_ros.schema import INTERNAL

# Intensities or intervals that differ by less are one level: drivers round, triggers jitter.
_SAME_INTENSITY = 2e-3
_SAME_INTERVAL = 0.05
_SHORTEST_LEVEL = 3
_LEVEL_SHARE = 0.8


class Kind(Enum):
    """Kind of a group of pulses."""

    SINGLE = 'single pulse'
    TRAIN = 'train'
    STAIRCASE = 'staircase'
    MODULATED = 'modulated train'
    OVERLAPPING = 'overlapping trains'


class Level(NamedTuple):
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


class PulseGroup(NamedTuple):
    """Pulses without a rest between them.

    Attributes
    ----------
    kind : Kind
        Its kind.
    first, last : int
        Indices of its first pulse and of the one after its last.
    levels : tuple of Level
        Runs of equal pulses, in the order of time.
    """

    kind: Kind
    first: int
    last: int
    levels: tuple[Level, ...]


def groups_of(pulses: PulseTrain) -> tuple[PulseGroup, ...]:
    """Return the groups of pulses that are separated by rests.

    Parameters
    ----------
    pulses : PulseTrain
        Ascending in onset.
    """
    if not len(pulses):
        return ()
    gap = np.diff(pulses.onset_ns) >= nanoseconds(REST)
    edges = np.concatenate(([0], np.flatnonzero(gap) + 1, [len(pulses)]))
    groups = []
    for first, last in pairwise(edges.tolist()):
        levels = _levels(pulses, first, last)
        groups.append(PulseGroup(_kind(levels, last - first), first, last, levels))
    return tuple(groups)


def _kind(levels: tuple[Level, ...], count: int) -> Kind:
    if count == 1:
        return Kind.SINGLE
    if len(levels) == 1:
        return Kind.TRAIN
    if all(
        not abs(one.intensity - other.intensity) > _SAME_INTENSITY
        and abs(one.rate_hz / other.rate_hz - 1.0) <= _SAME_INTERVAL
        for one, other in pairwise(levels)
    ):
        return Kind.OVERLAPPING
    lengths = [level.last - level.first for level in levels]
    held = sum(length for length in lengths if length >= _SHORTEST_LEVEL)
    return Kind.STAIRCASE if held >= _LEVEL_SHARE * count else Kind.MODULATED


def _levels(pulses: PulseTrain, first: int, last: int) -> tuple[Level, ...]:
    """Return the runs of equal intensity and equal interval to the next pulse.

    The interval between two levels belongs to neither: a single pulse that differs only by it
    belongs to the level before it.
    """
    intensity = pulses.intensity[first:last]
    if last - first == 1:
        return (Level(first, last, float(intensity[0]), math.nan),)
    gap = np.diff(pulses.onset_ns[first:last])
    interval = np.append(gap, gap[-1])
    known = ~np.isnan(intensity)
    other = known[1:] != known[:-1]
    other |= np.abs(np.nan_to_num(np.diff(intensity))) > _SAME_INTENSITY
    jump = np.abs(interval[1:] / interval[:-1] - 1.0) > _SAME_INTERVAL
    starts = np.flatnonzero(other | jump) + 1
    kept = starts[other[starts - 1] | (np.append(starts, len(intensity))[1:] - starts > 1)]
    return tuple(
        Level(
            first + low,
            first + high,
            float(intensity[low]),
            float(NANOSECONDS_PER_SECOND / np.median(interval[low : max(low + 1, high - 1)])),
        )
        for low, high in pairwise([0, *kept.tolist(), len(intensity)])
    )


# Noise never repeats its extreme value so often in a row; a sensor at the end of its range does.
_SATURATED_RUN = 5
# Trials that were put one after the other are further apart than this [ns].
_APART_NS = 5 * NANOSECONDS_PER_SECOND
_RATE_CHANGE = 0.1
_RATE_BLOCK = 100


class CleanTrace(NamedTuple):
    """Force samples in order, with properties of the sensor.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    force : ndarray, shape (samples,)
        Finite forces [N].
    saturated : ndarray of bool, shape (samples,)
        Samples at an end of the range of the sensor.
    sample_period : float
        Median time between samples [s].
    noise : float
        Standard deviation of the white part of the noise [N].
    findings : tuple of str
        Irregularities, a sentence each; without a unit, since a force may be a torque.
    """

    stamp_ns: IntArray
    force: FloatArray
    saturated: BoolArray
    sample_period: float
    noise: float
    findings: tuple[str, ...]

    def between(self, first_ns: int, last_ns: int) -> slice:
        """Return the samples from `first_ns` up to, not including, `last_ns`."""
        first, last = np.searchsorted(self.stamp_ns, [first_ns, last_ns])
        return slice(int(first), int(last))


def clean(trace: ForceTrace) -> CleanTrace:
    """Return the trace in order, without samples that are not finite or beyond `LARGEST_FORCE`.

    Parameters
    ----------
    trace : ForceTrace
        Samples in any order.

    Raises
    ------
    IdentificationError
        If fewer than 100 samples are left: nothing can be analysed then.
    """
    findings = []
    finite = np.isfinite(trace.force)
    if missing := int((~finite).sum()):
        findings.append(f'{missing} force samples are NaN or infinite; they are not used')
    believed = finite & (np.abs(trace.force) <= LARGEST_FORCE)
    if beyond := int((finite & ~believed).sum()):
        findings.append(f'{beyond} force samples are beyond {LARGEST_FORCE:g}; they are not used')
    stamps, first = np.unique(trace.stamp_ns[believed], return_index=True)
    force = trace.force[believed][first]
    if repeated := int(believed.sum()) - len(stamps):
        findings.append(
            f'{repeated} force samples have the stamp of another; the first of each is kept'
        )
    if len(stamps) < _RATE_BLOCK:
        raise IdentificationError(f'expected at least {_RATE_BLOCK} samples, got {len(stamps)}')
    # trials one after the other have ends of their own
    trials = np.split(force, np.flatnonzero(np.diff(stamps) > _APART_NS) + 1)
    saturated = np.concatenate([_saturated(trial) for trial in trials])
    if saturated.any():
        ends = ' and '.join(f'{value:.4g}' for value in np.unique(force[saturated]))
        findings.append(
            f'the sensor is saturated in {int(saturated.sum())} samples '
            f'(at {ends}); responses with such samples are not used'
        )
    period = float(np.median(np.diff(stamps))) / NANOSECONDS_PER_SECOND
    findings += _rate_findings(stamps)
    # The median of third differences is robust against artifacts.  Third differences of white
    # noise have 20 times its variance; the median of the absolute value of a normal variable is
    # 0.6745 standard deviations.
    noise = float(np.median(np.abs(np.diff(force, 3))) / 0.6745 / np.sqrt(20.0))
    return CleanTrace(stamps, force, saturated, period, noise, tuple(findings))


def _saturated(force: FloatArray) -> BoolArray:
    """Return the samples (samples,) in runs of the greatest or the least value."""
    result = np.zeros(len(force), dtype=np.bool_)
    if force.max() == force.min():
        return result
    for end in (force.max(), force.min()):
        run_of, _ = scipy.ndimage.label(force == end)
        long = np.bincount(run_of) >= _SATURATED_RUN
        result |= long[run_of] & (run_of > 0)
    return result


def _rate_findings(stamps: IntArray) -> Iterator[str]:
    """Yield a sentence for each change of the sample rate."""
    interval = np.diff(stamps) / NANOSECONDS_PER_SECOND
    whole = len(interval) // _RATE_BLOCK * _RATE_BLOCK
    local = np.median(interval[:whole].reshape(-1, _RATE_BLOCK), axis=1)
    if not len(local):
        return
    current = local[0]
    for block, value in enumerate(local):
        steady = block + 1 == len(local) or abs(local[block + 1] / value - 1.0) < _RATE_CHANGE
        if abs(value / current - 1.0) > _RATE_CHANGE and steady:
            moment = (stamps[block * _RATE_BLOCK] - stamps[0]) / NANOSECONDS_PER_SECOND
            yield (
                f'the sample rate changes from {1 / current:.0f} to {1 / value:.0f} Hz at '
                f'{moment:.1f} s; fits use the true time of every sample'
            )
            current = value


# Orders of the twitch that are compared (Eq. 2).
ORDERS = (2, 3, 4)
# Silence that separates one response from the next [s].
REST = 0.4
# How much force before the first and after the last pulse belongs to a response [s].
BEFORE, AFTER = 0.05, 0.5
# Length of the moving average before the derivative [s]: 9 samples at 1 kHz (Sec. 2.1).
FILTER_SPAN = 9e-3
# Time after a pulse that is not fitted if the recording shows artifacts [s].
BLANKING = 4e-3
# Largest distance of an artifact from the stamp of its pulse [s].
ARTIFACT_SEARCH = 20e-3
# Smallest peak of a twitch that is analysed, in standard deviations of the noise.
LEAST_RESPONSE = 8.0
# A twitch with a longer latency is not a response to its pulse [s].
LONGEST_LATENCY = 60e-3
# Smallest fit of a twitch that is accepted, 1 - |residual| / |force - mean|.
LEAST_FIT = 0.5
# Time after a change of the stimulation until the force counts as steady [s].
SETTLING = 0.5
# Share of a response that may be left when the next one begins.
LEFT_OVER = 0.05


# Of 40 samples of white noise one in a million trials exceeds six standard deviations.
_STANDS_OUT = 6.0
_LEAST_SHARE = 0.5
_LEAST_OF_RESPONSE = 0.02
_MEDIAN_SPAN = 5


@dataclass(frozen=True)
class Artifacts:
    """Offset between the clocks of force and pulses, by the artifacts.

    Attributes
    ----------
    offset : ndarray, shape (pulses,)
        Artifact's maximum minus stamp [s]; NaN where no artifact stands out.
    found : bool
        Whether the recording shows artifacts at all.
    median_offset, spread : float
        Median and scaled interquartile range of the offsets [s].
    clock_offset : float
        Clock of the sensor minus clock of the stimulator [s]; 0 if the artifacts agree with the
        stamps within the sampling.
    """

    offset: FloatArray = field(metadata=INTERNAL)
    found: bool
    median_offset: float
    spread: float
    clock_offset: float

    @property
    def count(self) -> int:
        """Number of pulses with an artifact."""
        return int(np.isfinite(self.offset).sum())


def find_artifacts(trace: CleanTrace, onset_ns: IntArray) -> Artifacts:
    """Return the offsets of the artifacts of pulses.

    Parameters
    ----------
    trace : CleanTrace
        Force.
    onset_ns : ndarray of int64, shape (pulses,)
        Stamps of the pulses, ascending [ns].
    """
    offset = np.full(len(onset_ns), np.nan)
    reach = _reaches(onset_ns)
    noise = max(trace.noise, 1e-12)
    least = max(_STANDS_OUT * noise, _LEAST_OF_RESPONSE * float(np.ptp(trace.force)))
    for index, onset in enumerate(onset_ns):
        part = trace.between(int(onset - reach[index]), int(onset + reach[index]) + 1)
        if part.stop - part.start < _MEDIAN_SPAN:
            continue
        force = trace.force[part]
        standing = np.abs(force - scipy.ndimage.median_filter(force, _MEDIAN_SPAN, mode='nearest'))
        best = int(np.argmax(standing))
        if standing[best] > least:
            offset[index] = (trace.stamp_ns[part.start + best] - onset) / NANOSECONDS_PER_SECOND
    return _judged(offset, trace.sample_period)


def near_pulses(stamp_ns: IntArray, onset_ns: IntArray, sample_period: float) -> BoolArray:
    """Return the samples (samples,) that an artifact may affect.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    onset_ns : ndarray of int64, shape (pulses,)
        Pulses in the clock of the sensor, ascending, at least one [ns].
    sample_period : float
        Time between samples: clocks that count as equal may differ by 1.5 of it [s].
    """
    margin = nanoseconds(1.5 * sample_period)
    latest = np.searchsorted(onset_ns, stamp_ns + margin, side='right') - 1
    since = stamp_ns - onset_ns[np.maximum(latest, 0)]
    return (latest >= 0) & (since < BLANKING * NANOSECONDS_PER_SECOND)


def without_artifacts(trace: CleanTrace, onset_ns: IntArray) -> CleanTrace:
    """Return the trace with straight lines where artifacts were."""
    touched = near_pulses(trace.stamp_ns, onset_ns, trace.sample_period)
    clear = ~touched
    if not touched.any() or not clear.any():
        return trace
    force = trace.force.copy()
    time = trace.stamp_ns - trace.stamp_ns[0]
    force[touched] = np.interp(time[touched], time[clear], trace.force[clear])
    return trace._replace(force=force)


def _reaches(onset_ns: IntArray) -> IntArray:
    """Return how far from each stamp to search without reaching a neighbour (pulses,) [ns]."""
    reach = np.full(len(onset_ns), nanoseconds(ARTIFACT_SEARCH), dtype=np.int64)
    if len(onset_ns) > 1:
        half = np.diff(onset_ns) // 2
        reach = np.minimum(reach, np.minimum(np.append(half, half[-1]), np.append(half[0], half)))
    return reach


def _judged(offset: FloatArray, period: float) -> Artifacts:
    """Return the offsets, and whether they are artifacts: these have one distance from stamps."""
    seen = offset[np.isfinite(offset)]
    if not len(seen):
        return Artifacts(offset, False, float('nan'), float('nan'), 0.0)
    low, median, high = np.percentile(seen, [25, 50, 75])
    steady = np.abs(seen - median) <= 2.0 * period
    found = len(seen) >= 2 and bool(steady.mean() >= _LEAST_SHARE)
    # The first sample after the pulse comes half a period late on average.
    shift = float(median - 0.5 * period)
    clock = shift if found and abs(shift) > 1.5 * period else 0.0
    return Artifacts(offset, found, float(median), float((high - low) / 1.349), clock)


_LEAST_SAMPLES = 50
LEAST_BEFORE = 10
_GAP = 5.0


@dataclass(frozen=True)
class Response:
    """Force around the pulses of one group.

    Attributes
    ----------
    onset : ndarray, shape (pulses,)
        Pulses, the first at 0 [s].
    lag : ndarray, shape (samples,)
        Time since the first pulse [s].
    force : ndarray, shape (samples,)
        Force [N].
    usable : ndarray of bool, shape (samples,)
        Samples that no artifact affects.
    intensity : float
        Of the first pulse, share of the maximum; NaN if it is not recorded.
    artifact : float
        Time of the artifact of the first pulse after that pulse [s]; NaN without one.
    """

    onset: FloatArray
    lag: FloatArray = field(metadata=INTERNAL)
    force: FloatArray = field(metadata=INTERNAL)
    usable: BoolArray = field(metadata=INTERNAL)
    intensity: float
    artifact: float

    @property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """Lags [s] and forces [N] of the usable samples."""
        return self.lag[self.usable], self.force[self.usable]

    @property
    def baseline(self) -> float:
        """Mean force before the first pulse [N]."""
        return float(np.mean(self.force[self.lag < 0]))


def cut(
    trace: CleanTrace, pulses: PulseTrain, artifacts: Artifacts, group: PulseGroup
) -> Response | str:
    """Return the response to a group of pulses, or why it does not qualify.

    Parameters
    ----------
    trace : CleanTrace
        Force.
    pulses : PulseTrain
        Pulses, ascending, in the sensor's clock.
    artifacts : Artifacts
        Of these pulses.
    group : PulseGroup
        One of their groups.
    """
    start = int(pulses.onset_ns[group.first])
    end = int(pulses.onset_ns[group.last - 1]) + nanoseconds(AFTER)
    if group.last < len(pulses):
        end = min(end, int(pulses.onset_ns[group.last]))
    part = trace.between(start - nanoseconds(BEFORE), end)
    lag = (trace.stamp_ns[part] - start) / NANOSECONDS_PER_SECOND
    if reason := _missing(lag, end - start):
        return reason
    if trace.saturated[part].any():
        return 'sensor saturated'
    onset_ns, force = pulses.onset_ns[group.first : group.last], trace.force[part]
    usable = np.ones(len(lag), dtype=np.bool_)
    if artifacts.found:
        usable = ~near_pulses(trace.stamp_ns[part], onset_ns, trace.sample_period)
    # the fits divide by the spread of the force
    if not usable.any() or not np.ptp(force[usable]):
        return 'the force never changes'
    return Response(
        (onset_ns - start) / NANOSECONDS_PER_SECOND,
        lag,
        force,
        usable,
        float(pulses.intensity[group.first]),
        float(artifacts.offset[group.first] - artifacts.clock_offset),
    )


def _missing(lag: FloatArray, length_ns: int) -> str:
    """Return why samples of a response are missing, empty if none is."""
    if (lag < 0).sum() < LEAST_BEFORE:
        return 'no force before the pulse'
    if len(lag) < _LEAST_SAMPLES:
        return 'too few force samples'
    step = np.diff(lag)
    usual = float(np.median(step))
    if step.max() > _GAP * usual:
        return 'force samples missing'
    if lag[-1] < length_ns / NANOSECONDS_PER_SECOND - _GAP * usual:
        return 'recording ends within the response'
    return ''


def counted_reasons(reasons: Mapping[str, int]) -> str:
    """Return reasons of rejection with their numbers, for a finding."""
    return ', '.join(f'{count} x {reason}' for reason, count in reasons.items())
