# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two sensors on one topic: the force alternates between two courses."""

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
