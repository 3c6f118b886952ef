# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Monitors of a stream: checks of the sensor, and those registered by other packages.

A package adds one by an entry point of the group ``rpms_ros.monitors``: its name is what
`StreamSettings.monitors` and the identifier's parameter call it, its object a class derived from
`Monitor` that is called without arguments.

Passes the samples, predictions and estimates of a stream to its monitors, cell by cell.

A sensor that does not follow the force: frozen, at the end of its range, or dead.

Short excursions of the force from the course of the neighbouring samples.

The force of a muscle rises for at least 20 ms and falls more slowly.  A lasting change of the
muscle or of the sensor is no excursion, however large it is, and is learnt from.

Samples that jump away from the predicted force, and back again.

In a fast stream neighbouring samples show an excursion of less than 10 ms.  The prediction also
shows a longer one, or a single sample of a slow sensor, if it was good before.  A deviation that
lasts is no outlier, however large it is: the muscle has changed, or the patient pulls.  Nor is
one that begins or ends smoothly: the force of a muscle does not jump from one sample to the next.

Two sensors on one topic: the force alternates between two courses.

Force that the model does not predict although it did before.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from typing import Any, ClassVar, TypeVar

import numba
import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.stream import faults
from rpms_ros.identification.stream.faults import FaultCounter
from rpms_ros.identification.stream.monitors import Monitor, ProcessedSamples, Window
from rpms_ros.pulses import BoolArray, FloatArray, IntArray
from rpms_ros.saved_state import Restorable, State, expect

# Shorter repetitions of one value come from the resolution of the sensor.
_FROZEN_NS = 80_000_000
# The force just before distinguishes a frozen sensor from a force that has come to rest.
_APPROACH_NS = 20_000_000
_APPROACH_SHARE = 0.1
_CONSTANT_NS = 3_000_000_000
_MEMORY_OF_STEPS = 0.05
# The highest value is the end of the range if it occurs so often, and so many times as often as
# the one below; near a smooth peak the two counts are similar.
_CLIPPED_COUNT = 10
_CLIPPED_RATIO = 4.0
# A force that is cut off stays at the end of the range; a smooth peak has two equal samples at
# most, though a train without noise repeats it to the last digit.
_CLIPPED_RUN = 3
# A force without noise approaches its extreme by the last digits of a double; a limit is reached
# by a step of at least this share of the range of the force.
_CREEP_SHARE = 1e-9
# Share of the stimulation of a tenth of a second that still acts in the next; the correlation with
# the force that tells in which direction it pulls, and how many tenths of a second it needs.
_MEMORY_OF_PULSES = 0.6
_CORRELATED = 0.3
_LEAST_CELLS = 30
# Places in the record of extremes: a value and its count, the next one inwards and its count; how
# many of the latest samples have the first value, and the longest run of it.
_TOP, _TOP_COUNT, _NEXT, _NEXT_COUNT, _RUN, _LONGEST_RUN = range(6)


class FrozenSensor(Monitor):
    """Finds `force_frozen`: one value is repeated although the force varied just before."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_FROZEN: 0.01}

    _step: float
    _begun_ns: int
    _value: float
    _steep: bool

    def __init__(self) -> None:
        self._step = 0.0
        self._begun_ns = 0
        self._value = float('nan')
        self._steep = False

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples that repeat a frozen value."""
        found = np.zeros_like(window.found)
        changes = window.force[1:] != window.force[:-1]
        begins = np.concatenate(([0], np.flatnonzero(changes) + 1))
        ends = np.append(begins[1:], len(window.force))
        # Most values occur once; the first may have begun before, the last may occur again.
        again = window.stamp_ns[ends - 1] - window.stamp_ns[begins] >= _FROZEN_NS
        again |= (begins < window.first) | (ends >= window.last)
        again &= (ends > window.first) & (begins < window.last)
        for begin, end in zip(begins[again].tolist(), ends[again].tolist(), strict=True):
            begun_ns, steep = self._beginning(window, begin)
            if steep and window.stamp_ns[end - 1] - begun_ns >= _FROZEN_NS:
                found[max(begin - window.first, 0) : end - window.first] = True
            if end > window.last - 1:
                self._begun_ns, self._steep = begun_ns, steep
                self._value = float(window.force[window.last - 1])
        steps = np.abs(np.diff(window.force))
        edges = window.edges[1:-1]
        frozen = np.concatenate(([0], np.cumsum(found)))[edges - window.first]
        steps = medians(steps, edges[:-1], edges[1:] - 1)
        for step in steps[np.diff(frozen) == 0].tolist():
            if not math.isnan(step):
                share = _MEMORY_OF_STEPS if self._step else 1.0
                self._step += share * (step - self._step)
        return {faults.FORCE_FROZEN: found} if found.any() else {}

    def restart(self) -> None:
        """Forget the value that may be frozen."""
        self._value = float('nan')

    def _beginning(self, window: Window, begin: int) -> tuple[int, bool]:
        """Return the stamp of the first of equal values, and whether the force varied before."""
        if begin < window.first and window.force[begin] == self._value:
            return self._begun_ns, self._steep
        begun_ns = int(window.stamp_ns[begin])
        low = int(np.searchsorted(window.stamp_ns, begun_ns - _APPROACH_NS))
        steps = np.abs(np.diff(window.force[low : begin + 1]))
        varied = len(steps) > 0 and self._step > 0.0
        return begun_ns, bool(varied and np.median(steps) >= _APPROACH_SHARE * self._step)


class ClippedSensor(Monitor):
    """Finds `force_clipped`: values at the end of the range.

    A force that comes to rest also stays at one value, so the end counts towards which pulses
    pull.  Until they show it, that is the one away from the force at the beginning.
    """

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_CLIPPED: 0.01}

    _highest: FloatArray
    _lowest: FloatArray
    _rest: float | None
    _acting: float
    _moments: FloatArray

    def __init__(self) -> None:
        self._highest = np.array([-np.inf, 0.0, -np.inf, 0.0, 0.0, 0.0])
        self._lowest = self._highest.copy()
        self._rest = None
        self._acting = 0.0
        # Sums over cells of products of 1, the stimulation that acts, and the force.
        self._moments = np.zeros((3, 3))

    def _check_restored(self) -> None:
        fits = self._highest.shape == self._lowest.shape == (6,)
        fits = fits and self._moments.shape == (3, 3)
        expect(fits, 'ClippedSensor', 'records of six numbers and moments of three')

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples at an end of the range."""
        force = window.force[window.first : window.last]
        if self._rest is None:
            first, _ = next(window.cells())
            self._rest = float(np.median(force[first]))
        count_extremes(force, self._highest)
        count_extremes(-force, self._lowest)
        found = np.zeros_like(window.found)
        span = self._highest[_TOP] + self._lowest[_TOP]
        pull = self._pull()
        for sign, record in ((1.0, self._highest), (-1.0, self._lowest)):
            away_from_rest = record[_TOP] - sign * self._rest > 0.5 * span
            pulled = sign * pull > 0.0 if pull else away_from_rest
            if pulled and _cut_off(record, span):
                found |= force == sign * record[_TOP]
        return {faults.FORCE_CLIPPED: found} if found.any() else {}

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Learn in which direction pulses pull."""
        dose = np.diff(np.concatenate(([0.0], np.cumsum(samples.intensity)))[samples.pulse_edges])
        rows = np.ones((3, len(dose)))
        rows[2] = medians(samples.force, samples.edges[:-1], samples.edges[1:])
        for cell, added in enumerate(dose.tolist()):
            # Pulses are known a tenth of a second ahead: what acts here came with those before.
            rows[1, cell] = self._acting
            self._acting = _MEMORY_OF_PULSES * self._acting + added
        self._moments += rows @ rows.T
        return {}

    def _pull(self) -> float:
        """Return the correlation of stimulation and force; 0 if it tells nothing."""
        count, dose, force = self._moments[0]
        if count < _LEAST_CELLS:
            return 0.0
        covariance = self._moments[1:, 1:] - np.outer((dose, force), (dose, force)) / count
        scale = math.sqrt(max(covariance[0, 0] * covariance[1, 1], 0.0))
        found = float(covariance[0, 1]) / scale if scale else 0.0
        return found if abs(found) > _CORRELATED else 0.0


def _cut_off(record: FloatArray, span: float) -> bool:
    """Return whether the highest value of a record (6,) is a limit; `span` of the force [N]."""
    often = record[_TOP_COUNT] >= _CLIPPED_COUNT
    alone = record[_TOP_COUNT] > _CLIPPED_RATIO * record[_NEXT_COUNT]
    stays = record[_LONGEST_RUN] >= _CLIPPED_RUN
    stepped = record[_TOP] - record[_NEXT] > _CREEP_SHARE * span
    return bool(often and alone and stays and stepped)


class ConstantForce(Monitor):
    """Finds `force_constant`: the force has been exactly constant for three seconds."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_CONSTANT: 0.0}

    _value: float
    _since_ns: int

    def __init__(self) -> None:
        self._value = float('nan')
        self._since_ns = 0

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Return how many samples equal those of the three seconds before."""
        changes = np.flatnonzero(np.diff(samples.force, prepend=self._value) != 0.0)
        end = int(changes[0]) if len(changes) else len(samples.force)
        count = int(np.count_nonzero(samples.stamp_ns[:end] - self._since_ns >= _CONSTANT_NS))
        if len(changes):
            self._value = float(samples.force[-1])
            self._since_ns = int(samples.stamp_ns[changes[-1]])
        return {faults.FORCE_CONSTANT: count} if count else {}

    def restart(self) -> None:
        """Forget since when the force has been constant."""
        self._value = float('nan')


@numba.njit(cache=True)
def medians(values: FloatArray, begin: IntArray, end: IntArray) -> FloatArray:
    """Return the medians of the parts of values (n,) from `begin` to `end`; NaN of empty ones."""
    found = np.full(len(begin), np.nan)
    for part in range(len(begin)):
        if begin[part] < end[part]:
            found[part] = np.median(values[begin[part] : end[part]])
    return found


@numba.njit(cache=True)
def count_extremes(force: FloatArray, record: FloatArray) -> None:
    """Update a record (6,) of the two highest values and their counts by samples (samples,)."""
    for value in force:
        if value < record[_TOP]:
            record[_RUN] = 0.0
        if value == record[_TOP]:
            record[_TOP_COUNT] += 1.0
            record[_RUN] += 1.0
            record[_LONGEST_RUN] = max(record[_LONGEST_RUN], record[_RUN])
        elif value > record[_TOP]:
            record[_NEXT] = record[_TOP]
            record[_NEXT_COUNT] = record[_TOP_COUNT]
            record[_TOP] = value
            record[_TOP_COUNT] = 1.0
            record[_RUN] = 1.0
            record[_LONGEST_RUN] = 1.0
        elif value == record[_NEXT]:
            record[_NEXT_COUNT] += 1.0
        elif value > record[_NEXT]:
            record[_NEXT] = value
            record[_NEXT_COUNT] = 1.0


_REACH_NS = 10_000_000
# Neighbours on each side, at most, and on both together, at least.
_MOST = 12
_LEAST = 6
# An excursion is farther from the median of its neighbours than so many times the distance of
# their 20th and 80th percentile, and so many times the median step from sample to sample.  White
# noise reaches neither in 10^8 samples: 3 * 1.7 + 6 * 0.95 = 10.8 standard deviations.
_SPREADS = 3.0
_STEPS = 6.0


class Spikes(Monitor):
    """Finds `force_spike`."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_SPIKE: 0.01}

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples of excursions."""
        found = np.zeros_like(window.found)
        find_excursions(window.stamp_ns, window.force, window.edges, found)
        return {faults.FORCE_SPIKE: found} if found.any() else {}


@numba.njit(cache=True)
def find_excursions(
    stamp_ns: IntArray, force: FloatArray, edges: IntArray, found: BoolArray
) -> None:
    """Mark the excursions of the cells of a `Window` in `found` (last - first,)."""
    near = np.empty(2 * _MOST + 1)
    steps = np.abs(np.diff(force))
    for cell in range(len(edges) - 3):
        first, last = edges[cell + 1], edges[cell + 2]
        if first == last or edges[cell + 3] - edges[cell] <= _LEAST:
            continue
        floor = _STEPS * np.median(steps[edges[cell] : edges[cell + 3] - 1])
        for index in range(first, last):
            low = index
            while low > 0 and stamp_ns[index] - stamp_ns[low - 1] <= _REACH_NS:
                low -= 1
            high = index
            while high + 1 < len(force) and stamp_ns[high + 1] - stamp_ns[index] <= _REACH_NS:
                high += 1
            # As many on either side, so that the median of a slope is its middle.
            reach = min(index - low, high - index)
            stride = (reach + _MOST - 1) // _MOST
            side = reach // stride if stride else 0
            count = 2 * side + 1
            if count <= _LEAST:
                continue
            above = 0
            below = 0
            for place in range(count):
                near[place] = force[index + (place - side) * stride]
                above += near[place] > force[index] + floor
                below += near[place] < force[index] - floor
            # The median is that far away only if more than half of them are; else skip sorting.
            if max(above, below) <= side:
                continue
            ordered = np.sort(near[:count])
            spread = ordered[count - 1 - count // 5] - ordered[count // 5]
            away = abs(force[index] - ordered[side])
            found[index - edges[1]] = away > _SPREADS * spread + floor and away > 0.0


# Cells from which usual residuals follow, and how many of them must have been predicted well.
_CELLS = 30
_EXPLAINED = 15
# A residual is large if it exceeds so many times the largest of a usual cell, and this share of
# the largest range of the predicted force within a cell.
_OUTLIER_TIMES = 4.0
_SHARE = 0.1
# Outliers begin and end with a step of at least this share of their distance.
_STEP_SHARE = 0.5
# They last no longer than this, or so many samples of a slow sensor.
_LONGEST_NS = 20_000_000
_LONGEST_COUNT = 2
# If there are more than this share of a second, and more than so many, they are a disturbance.
_RECENT_CELLS = 10
_FEW_SHARE = 0.03
_FEW = 4


class Outliers(Monitor):
    """Finds `force_outlier`."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_OUTLIER: 0.01}

    _largest: deque[float]
    _explained: deque[bool]
    _range: float
    _before: float
    _begun_ns: int | None
    _count: int
    _recent: deque[tuple[int, int]]

    def __init__(self) -> None:
        self._largest = deque(maxlen=_CELLS)
        self._explained = deque(maxlen=_CELLS)
        self._range = 0.0
        self._before = 0.0
        self._begun_ns = None
        self._count = 0
        self._recent = deque(maxlen=_RECENT_CELLS)

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples that are briefly far from their prediction."""
        known = sum(self._explained) >= _EXPLAINED
        if window.prediction is None or not known:
            self._begun_ns = None
            return {}
        residual = window.force[window.first : window.last] - window.prediction
        usual = float(np.median(self._largest))
        limit = max(_OUTLIER_TIMES * usual, _SHARE * self._range)
        beyond = (np.abs(residual) > limit) & ~window.found
        found = np.zeros_like(window.found)
        if beyond.any():
            stamps = window.stamp_ns[window.first : window.last]
            self._mark_runs(stamps, residual, beyond, found)
        else:
            self._begun_ns = None
        self._before = float(residual[-1])
        edges = window.edges[1:-1] - window.first
        total = np.concatenate(([0], np.cumsum(found)))[edges]
        counts = zip(np.diff(total).tolist(), np.diff(edges).tolist(), strict=True)
        for cell, (marked, samples) in enumerate(counts):
            if samples:
                self._recent.append((marked, samples))
            if marked:
                of_second = np.sum(self._recent, axis=0)
                if of_second[0] > max(_FEW, _FEW_SHARE * of_second[1]):
                    found[edges[cell] : edges[cell + 1]] = False
        return {faults.FORCE_OUTLIER: found} if found.any() else {}

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Update the usual residuals."""
        for _, error, largest, explained in samples.fits:
            follows = explained > 3.0 * error
            self._largest.append(largest)
            self._explained.append(follows or largest < _SHARE * self._range)
            if follows:
                self._range = max(self._range, explained)
        return {}

    def restart(self) -> None:
        """Forget the usual residuals: the muscle may have rested."""
        self._largest.clear()
        self._explained.clear()
        self._begun_ns = None

    def _mark_runs(
        self, stamp_ns: IntArray, residual: FloatArray, beyond: BoolArray, found: BoolArray
    ) -> None:
        """Mark runs of distant samples that are short and begin and end with a step."""
        edges = np.flatnonzero(np.diff(beyond, prepend=False, append=False)).reshape(-1, 2)
        for begin, end in edges.tolist():
            if begin or self._begun_ns is None:
                before = float(residual[begin - 1]) if begin else self._before
                jumps = abs(residual[begin] - before) >= _STEP_SHARE * abs(residual[begin])
                # A run that began smoothly is no outlier: it counts as too long.
                self._begun_ns = (
                    int(stamp_ns[begin]) if jumps else int(stamp_ns[begin]) - _LONGEST_NS
                )
                self._count = 0 if jumps else _LONGEST_COUNT
            self._count += end - begin
            lasted_ns = int(stamp_ns[end - 1]) - self._begun_ns
            brief = lasted_ns < _LONGEST_NS or self._count <= _LONGEST_COUNT
            if end < len(residual):
                step = abs(residual[end - 1] - residual[end])
                brief = brief and bool(step >= _STEP_SHARE * abs(residual[end - 1]))
            found[begin:end] = brief
        if not beyond[-1]:
            self._begun_ns = None


# Neighbours on either side among which one of the same sensor is sought: two sensors need not
# alternate strictly.
_REACH = 3
_LEAST_SAMPLES = 40
_MANY_SAMPLES = 150
# `alternation` of white noise is 0.35 +- 0.02 in windows of 300 and 0.36 +- 0.04 in windows of
# 100; these are seven and six standard deviations below.
_LIMIT = 0.2
_LIMIT_OF_FEW = 0.12


class Alternation(Monitor):
    """Finds `force_alternating`."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_ALTERNATING: 0.002}

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return all samples of the cells that alternate between two courses."""
        sizes = window.edges[3:] - window.edges[:-3]
        limit = np.where(sizes >= _MANY_SAMPLES, _LIMIT, _LIMIT_OF_FEW)
        alternates = alternation(window.force, window.edges) < limit
        if not alternates.any():
            return {}
        return {faults.FORCE_ALTERNATING: np.repeat(alternates, np.diff(window.edges[1:-1]))}


@numba.njit(cache=True)
def alternation(force: FloatArray, edges: IntArray) -> FloatArray:
    """Return the relative distance of samples from a line through two neighbours.

    Parameters
    ----------
    force : ndarray (samples,)
        Force [N].
    edges : ndarray of int (cells + 3,)
        Of a `Window`.

    Returns
    -------
    ndarray (cells,)
        In each cell, the one before and the one after it: mean distance to the best of the lines
        through one of the three samples before and one of the three after, over the mean distance
        to the line through the nearest two: 1 on any smooth course, about 0.35 in white noise, 0
        where two smooth courses alternate.  1 if there are too few samples.
    """
    nearest, best = np.zeros((2, len(force)))
    for index in range(_REACH, len(force) - _REACH):
        here = force[index]
        nearest[index] = abs(here - 0.5 * (force[index - 1] + force[index + 1]))
        best[index] = nearest[index]
        for before in range(1, _REACH + 1):
            for after in range(1, _REACH + 1):
                line = after * force[index - before] + before * force[index + after]
                best[index] = min(best[index], abs(here - line / (before + after)))
    found = np.ones(len(edges) - 3)
    for cell in range(len(found)):
        low, high = edges[cell], edges[cell + 3]
        if high - low < _LEAST_SAMPLES:
            continue
        total = nearest[low + _REACH : high - _REACH].sum()
        # With a coarse resolution samples agree by chance: half a digit is added to the distance.
        level = np.inf
        for index in range(low + 1, high):
            step = abs(force[index] - force[index - 1])
            if 0.0 < step < level:
                level = step
        if total > 0.0:
            distance = best[low + _REACH : high - _REACH].sum()
            count = high - low - 2 * _REACH
            found[cell] = min((distance + 0.5 * level * count) / total, 1.0)
    return found


# Cells from which usual residuals follow, and how many of them must have been predicted well.
# A residual is large if it exceeds so many times the usual one, and this share of the largest
# range of the predicted force within a cell.
_RESIDUAL_TIMES = 8.0


class Unexplained(Monitor):
    """Finds `force_unexplained`.

    The usual residual is the median over three seconds: a lasting change is reported for half of
    that time.
    """

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_UNEXPLAINED: 0.002}

    _residuals: deque[float]
    _explained: deque[bool]
    _range: float

    def __init__(self) -> None:
        self._residuals = deque(maxlen=_CELLS)
        self._explained = deque(maxlen=_CELLS)
        self._range = 0.0

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Return the number of used samples if residuals are far larger than usual."""
        known = sum(self._explained) >= _EXPLAINED and len(self._residuals) == _CELLS
        usual = float(np.median(self._residuals)) if known else np.inf
        large = max(_RESIDUAL_TIMES * usual, _SHARE * self._range)
        count = 0
        for used, error, _, explained in samples.fits:
            count += used if error > large else 0
            self._residuals.append(error)
            self._explained.append(explained > 3.0 * error)
            if self._explained[-1]:
                self._range = max(self._range, explained)
        return {faults.FORCE_UNEXPLAINED: count} if count else {}

    def restart(self) -> None:
        """Forget the usual residual: the muscle may have rested."""
        self._residuals.clear()
        self._explained.clear()


GROUP = 'rpms_ros.monitors'

MONITORS: dict[str, Callable[[], Monitor]] = {
    'spikes': Spikes,
    'outliers': Outliers,
    'alternation': Alternation,
    'frozen': FrozenSensor,
    'clipped': ClippedSensor,
    'constant': ConstantForce,
    'unexplained': Unexplained,
}
"""Functions that build a fresh monitor of this package, by name."""


def monitors_by_name(names: Sequence[str]) -> list[Monitor]:
    """Return fresh monitors, of this package or registered by others.

    Raises
    ------
    IdentificationError
        If there is none of that name, or it is not a `Monitor`.
    """
    registered = {point.name: point for point in entry_points(group=GROUP)}
    monitors = []
    for name in names:
        if name in MONITORS:
            monitors.append(MONITORS[name]())
        elif name in registered:
            monitors.append(_made(name, registered[name].load()))
        else:
            known = ', '.join(sorted({*MONITORS, *registered}))
            raise IdentificationError(f'expected monitors of {known}, got {name!r}')
    return monitors


def _made(name: str, build: Callable[[], object]) -> Monitor:
    monitor = build()
    if not isinstance(monitor, Monitor):
        raise IdentificationError(
            f'expected a Monitor behind the entry point {name}, got {type(monitor).__name__}'
        )
    return monitor


CELL_NS = 100_000_000
# With a shorter delay there are no samples around one before it is used.
LEAST_DELAY_NS = 20_000_000
# Each fault is one bit in the marks of a sample.
_MOST_FAULTS = 62
_MONITORS = 'monitors'
Answer = TypeVar('Answer')


class Pipeline(Restorable):
    """Monitors of one stream.

    Parameters
    ----------
    monitors : sequence of Monitor
        Called in this order.
    sinks : sequence of Monitor
        Called after them; not part of the state.
    delay_ns : int
        Least time for which samples wait before they are used [ns]; a cell is at most half as
        long, so that the samples of another cell after it are known.
    look_ahead_ns : int
        Up to this time after a sample the pulses are known [ns]; cells are not longer if samples
        are predicted.
    counter : FaultCounter
        Where faults are counted.
    cells : int
        So many cells are examined at a time.
    """

    _names: list[str]
    _block: int | None
    _marks: IntArray
    _before: tuple[IntArray, FloatArray]
    _parts: list[tuple[IntArray, FloatArray, FloatArray, BoolArray, IntArray, FloatArray]]

    def __init__(
        self,
        monitors: Sequence[Monitor],
        sinks: Sequence[Monitor],
        delay_ns: int,
        look_ahead_ns: int,
        counter: FaultCounter,
        cells: int = 1,
    ) -> None:
        self._named = tuple(monitors)
        self._monitors = [*monitors, *sinks]
        self._counter = counter
        self._examines = delay_ns >= LEAST_DELAY_NS
        self.cell_ns = min(delay_ns // 2, CELL_NS) if self._examines else CELL_NS
        self._predicts = self._examines and look_ahead_ns >= LEAST_DELAY_NS // 2
        if self._predicts:
            self.cell_ns = min(self.cell_ns, look_ahead_ns)
        self.block_ns = cells * self.cell_ns
        self._cells = cells
        self._look_ahead_ns = look_ahead_ns
        self._names = []
        self._block = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        self._parts = []

    def state(self) -> State:
        """Return the state, with that of the monitors that have not failed."""
        monitors = [one.state() if one in self._monitors else None for one in self._named]
        return {**super().state(), _MONITORS: monitors}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a saved state; see `Restorable.restore`."""
        saved = state.get(_MONITORS)
        fits = isinstance(saved, list) and len(saved) == len(self._named)
        expect(fits, 'Pipeline', f'{len(self._named)} monitors')
        for monitor, one in zip(self._named, state[_MONITORS], strict=True):
            if one is None:
                self._monitors.remove(monitor)
            else:
                monitor.restore(one)
        super().restore({name: value for name, value in state.items() if name != _MONITORS})

    def _check_restored(self) -> None:
        fits = len(self._before[0]) == len(self._before[1]) and len(self._names) <= _MOST_FAULTS
        for part in self._parts:
            fits = fits and len({len(column) for column in part[:4]}) == 1
            fits = fits and len(part[0]) > 0 and len(part[4]) == len(part[5])
        expect(fits, 'Pipeline', 'columns of one length')

    def examine(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        last: int,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> IntArray:
        """Return the faults of samples first .. last - 1 of one block of cells, one bit each.

        `stamp_ns` and `force` (samples,) are all waiting samples, ascending; those before `first`
        have been examined.  `predicted` returns the prediction of the samples of a block.
        """
        if not self._examines:
            return np.zeros(last - first, dtype=np.int64)
        block = int(stamp_ns[first]) // self.block_ns
        if block != self._block:
            self._block = block
            self._marks = self._marks_of(self._window(stamp_ns, force, first, predicted))
        before = (
            np.concatenate((self._before[0], stamp_ns[first:last])),
            np.concatenate((self._before[1], force[first:last])),
        )
        kept = int(np.searchsorted(before[0], (block + 1) * self.block_ns - 2 * self.cell_ns))
        self._before = before[0][kept:], before[1][kept:]
        marks, self._marks = self._marks[: last - first], self._marks[last - first :]
        return marks

    def concerned(self, marks: IntArray) -> dict[str, BoolArray]:
        """Return which samples (samples,) have each fault."""
        found = int(np.bitwise_or.reduce(marks)) if len(marks) else 0
        return {
            name: (marks & (1 << bit)) != 0
            for bit, name in enumerate(self._names)
            if found & (1 << bit)
        }

    def add(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        prediction: FloatArray,
        usable: BoolArray,
        onset_ns: IntArray,
        intensity: FloatArray,
    ) -> None:
        """Keep processed samples until their block is complete; see `ProcessedSamples`."""
        self._parts.append((stamp_ns, force, prediction, usable, onset_ns, intensity))

    def flush(self) -> int:
        """Pass the complete block to the monitors; return how many samples it had."""
        if not self._parts:
            return 0
        columns: list[Any] = [np.concatenate(parts) for parts in zip(*self._parts, strict=True)]
        self._parts = []
        stamps, force, prediction, usable, onset_ns, intensity = columns
        edges = np.searchsorted(stamps, self._grid_ns(int(stamps[0])))
        edges = np.append(edges[:-1][np.diff(edges) > 0], len(stamps))
        known_ns = stamps[edges[1:-1] - 1] + self._look_ahead_ns
        inner = np.searchsorted(onset_ns, known_ns, side='right')
        pulse_edges = np.concatenate(([0], inner, [len(onset_ns)]))
        whole = ProcessedSamples(
            stamps, force, prediction, usable, onset_ns, intensity, edges, pulse_edges
        )
        for monitor in list(self._monitors):
            none: Mapping[str, int] = {}
            for name, count in self._ask(monitor, monitor.processed_all, whole, none).items():
                self._counter.add(name, int(count))
        return len(stamps)

    def estimated(self, estimate: Estimate) -> None:
        """Pass an estimate to the monitors."""
        for monitor in list(self._monitors):
            self._ask(monitor, monitor.estimated, estimate, None)

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped back."""
        self._block = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        for monitor in self._monitors:
            monitor.restart()

    def _window(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> Window:
        """Return the block that begins with sample `first`, and a cell before and after it."""
        grid_ns = self._grid_ns(int(stamp_ns[first]))
        high = int(np.searchsorted(stamp_ns, grid_ns[-1] + self.cell_ns))
        low = int(np.searchsorted(self._before[0], grid_ns[0] - self.cell_ns))
        stamps = np.concatenate((self._before[0][low:], stamp_ns[first:high]))
        edges = np.concatenate(([0], np.searchsorted(stamps, grid_ns), [len(stamps)]))
        return Window(
            stamps,
            np.concatenate((self._before[1][low:], force[first:high])),
            edges,
            np.zeros(edges[-2] - edges[1], dtype=np.bool_),
            predicted(stamps[edges[1] : edges[-2]]) if self._predicts else None,
        )

    def _grid_ns(self, stamp_ns: int) -> IntArray:
        """Return where the cells of the block of a stamp begin, and where the last one ends."""
        begin_ns = stamp_ns // self.block_ns * self.block_ns
        return begin_ns + self.cell_ns * np.arange(self._cells + 1, dtype=np.int64)

    def _marks_of(self, window: Window) -> IntArray:
        marks = np.zeros(window.last - window.first, dtype=np.int64)
        for monitor in list(self._monitors):
            found: Mapping[str, BoolArray] = self._ask(monitor, monitor.examine_all, window, {})
            for name, concerned in found.items():
                marks[concerned] |= 1 << self._bit(name)
                window.found[concerned] = True
        return marks

    def _bit(self, name: str) -> int:
        if name not in self._names:
            if len(self._names) >= _MOST_FAULTS:
                raise KeyError(f'expected at most {_MOST_FAULTS} faults of samples, got {name}')
            self._names.append(name)
        return self._names.index(name)

    def _ask(
        self, monitor: Monitor, method: Callable[..., Answer], what: object, otherwise: Answer
    ) -> Answer:
        """Return the result of a monitor; remove the monitor if it raises."""
        try:
            return method(what)
        # A monitor that fails must not stop the identification.
        except Exception:  # noqa: BLE001
            self._monitors.remove(monitor)
            self._counter.add(faults.MONITOR_FAILED)
            return otherwise
