# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Short excursions of the force from the course of the neighbouring samples.

The force of a muscle rises for at least 20 ms and falls more slowly.  A lasting change of the
muscle or of the sensor is no excursion, however large it is, and is learnt from.
"""

from collections.abc import Mapping
from typing import ClassVar

import numba
import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import Window
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

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
