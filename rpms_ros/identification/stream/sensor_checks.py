# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the sensor: the monitors of this package, and those registered by others.

A package adds one by an entry point of the group ``rpms_ros.monitors``: its name is what
`StreamSettings.monitors` and the identifier's parameter call it, its object a class derived from
`Monitor` that is called without arguments.

The force of a muscle rises for at least 20 ms and falls more slowly, and does not jump from one
sample to the next.  In a fast stream neighbouring samples show an excursion of less than 10 ms.
The prediction also shows a longer one, or a single sample of a slow sensor, if it was good
before.  A deviation that lasts is no outlier, however large it is: the muscle has changed, or the
patient pulls.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points

import numba
import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.stream.monitors import Monitor, ProcessedSamples, Window
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

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

    def __init__(self) -> None:
        # see `find_frozen`
        self._state = (math.nan, 0, False, 0.0)

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples that repeat a frozen value."""
        found, samples = np.zeros_like(window.found), (window.stamp_ns, window.force)
        self._state = find_frozen(*samples, window.edges, self._state, found)
        return {faults.FORCE_FROZEN: found} if found.any() else {}

    def restart(self) -> None:
        """Forget the value that may be frozen."""
        self._state = (math.nan, *self._state[1:])


@numba.njit(cache=True)
def find_frozen(
    stamp_ns: IntArray,
    force: FloatArray,
    edges: IntArray,
    state: tuple[float, int, bool, float],
    found: BoolArray,
) -> tuple[float, int, bool, float]:
    """Mark frozen samples of the cells of a `Window` in `found` (last - first,).

    The state is the last value [N], since when it is repeated [ns], whether the force varied just
    before, and the usual step from sample to sample [N]; it is returned as it is afterwards.
    """
    value, begun_ns, steep, step = state
    first, last = edges[1], edges[-2]
    steps = np.abs(np.diff(force))
    begin = 0
    while begin < last:
        end = begin + 1
        while end < len(force) and force[end] == force[begin]:
            end += 1
        # most values occur once; the first may have begun before, the last may occur again
        lasts = stamp_ns[end - 1] - stamp_ns[begin] >= _FROZEN_NS
        if end > first and (lasts or begin < first or end >= last):
            if begin >= first or force[begin] != value:
                begun_ns = stamp_ns[begin]
                low = begin
                while low > 0 and stamp_ns[low - 1] >= begun_ns - _APPROACH_NS:
                    low -= 1
                before = np.median(steps[low:begin]) if low < begin else 0.0
                steep = step > 0.0 and before >= _APPROACH_SHARE * step
            if steep and stamp_ns[end - 1] - begun_ns >= _FROZEN_NS:
                found[max(begin - first, 0) : end - first] = True
            value = force[begin]
        begin = end
    for cell in range(1, len(edges) - 2):
        low, high = edges[cell], edges[cell + 1]
        if high - low > 1 and not found[low - first : high - first].any():
            share = _MEMORY_OF_STEPS if step else 1.0
            step += share * (np.median(steps[low : high - 1]) - step)
    return value, begun_ns, steep, step


class ClippedSensor(Monitor):
    """Finds `force_clipped`: values at the end of the range.

    A force that comes to rest also stays at one value, so the end counts towards which pulses
    pull.  Until they show it, that is the one away from the force at the beginning.
    """

    def __init__(self) -> None:
        self._highest = np.array([-np.inf, 0.0, -np.inf, 0.0, 0.0, 0.0])
        self._lowest = self._highest.copy()
        self._rest: float | None = None
        self._acting = 0.0
        # Sums over cells of products of 1, the stimulation that acts, and the force.
        self._moments = np.zeros((3, 3))

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
    low = high = 0
    for cell in range(len(edges) - 3):
        first, last = edges[cell + 1], edges[cell + 2]
        if first == last or edges[cell + 3] - edges[cell] <= _LEAST:
            continue
        floor = _STEPS * np.median(steps[edges[cell] : edges[cell + 3] - 1])
        for index in range(first, last):
            while stamp_ns[index] - stamp_ns[low] > _REACH_NS:
                low += 1
            while high + 1 < len(force) and stamp_ns[high + 1] - stamp_ns[index] <= _REACH_NS:
                high += 1
            # As many on either side, so that the median of a slope is its middle.
            reach = min(index - low, high - index)
            stride = (reach + _MOST - 1) // _MOST
            side = reach // stride if stride else 0
            count = 2 * side + 1
            if count <= _LEAST:
                continue
            above = below = 0
            for place in range(count):
                # the median is near: more than half of them are
                if place - above - below > side:
                    break
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


class UsualResiduals(Monitor):
    """Keeps how large residuals were in the cells of the last three seconds."""

    def __init__(self) -> None:
        self._sizes: deque[float] = deque(maxlen=_CELLS)
        self._explained: deque[bool] = deque(maxlen=_CELLS)
        self._range = 0.0

    def restart(self) -> None:
        """Forget the usual residuals: the muscle may have rested."""
        self._sizes.clear()
        self._explained.clear()

    def _limit(self, times: float) -> float:
        """Return so many times the usual residual; infinite unless the force was explained."""
        if sum(self._explained) < _EXPLAINED:
            return math.inf
        # of 30 numbers or fewer, faster than by NumPy
        ordered, middle = sorted(self._sizes), len(self._sizes) // 2
        median = 0.5 * (ordered[~middle] + ordered[middle])
        return max(times * median, _SHARE * self._range)


class Outliers(UsualResiduals):
    """Finds `force_outlier`."""

    def __init__(self) -> None:
        super().__init__()
        self._before = 0.0
        self._begun_ns: int | None = None
        self._count = 0
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT_CELLS)

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples that are briefly far from their prediction."""
        limit = self._limit(_OUTLIER_TIMES)
        if window.prediction is None or math.isinf(limit):
            self._begun_ns = None
            return {}
        residual = window.force[window.first : window.last] - window.prediction
        beyond = (np.abs(residual) > limit) & ~window.found
        found = np.zeros_like(window.found)
        if beyond.any():
            self._mark_runs(window.stamp_ns[window.first : window.last], residual, beyond, found)
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
            self._sizes.append(largest)
            self._explained.append(follows or largest < _SHARE * self._range)
            if follows:
                self._range = max(self._range, explained)
        return {}

    def restart(self) -> None:
        """Forget the usual residuals, and the run that may have begun."""
        super().restart()
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

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return all samples of the cells that alternate between two courses."""
        sizes = window.edges[3:] - window.edges[:-3]
        limit = np.where(sizes >= _MANY_SAMPLES, _LIMIT, _LIMIT_OF_FEW)
        alternates = alternation(window.force, window.edges) < limit
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


# A residual is unexplained if it exceeds so many times the usual one.
_RESIDUAL_TIMES = 8.0
# Cells that have to be explained before.
_LEARNT = 100


class Unexplained(UsualResiduals):
    """Finds `force_unexplained`.

    The usual residual is the median over three seconds: a lasting change is reported for half of
    that time.  Predictions that have explained the force for less than ten seconds are not held
    to be good: the first rise of a slow sinusoid does not tell the muscle.
    """

    def __init__(self) -> None:
        super().__init__()
        self._learnt = 0

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Return the number of used samples if residuals are far larger than usual."""
        known = len(self._sizes) == _CELLS and self._learnt >= _LEARNT
        limit = self._limit(_RESIDUAL_TIMES) if known else math.inf
        count = 0
        for used, error, _, explained in samples.fits:
            count += used if error > limit else 0
            self._sizes.append(error)
            self._explained.append(explained > 3.0 * error)
            if self._explained[-1]:
                self._learnt += 1
                self._range = max(self._range, explained)
        return {faults.FORCE_UNEXPLAINED: count} if count else {}


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
        if name not in MONITORS and name not in registered:
            known = ', '.join(sorted({*MONITORS, *registered}))
            raise IdentificationError(f'expected monitors of {known}, got {name!r}')
        monitor = MONITORS[name]() if name in MONITORS else registered[name].load()()
        if not isinstance(monitor, Monitor):
            raise IdentificationError(
                f'expected a Monitor behind the entry point {name}, got {type(monitor).__name__}'
            )
        monitors.append(monitor)
    return monitors
