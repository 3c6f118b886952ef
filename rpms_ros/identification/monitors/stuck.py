# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor that does not follow the force: frozen, at the end of its range, or dead."""

import math
from collections.abc import Mapping
from typing import ClassVar

import numba
import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import ProcessedSamples
from rpms_ros.identification.monitors.interface import Window
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

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
