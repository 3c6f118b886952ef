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

    def examine(self, window: Window) -> Mapping[str, BoolArray]:
        """Return all samples of the cell if they alternate between two courses."""
        limit = _LIMIT if len(window.force) >= _MANY_SAMPLES else _LIMIT_OF_FEW
        if alternation(window.force) >= limit:
            return {}
        return {faults.FORCE_ALTERNATING: np.ones(window.last - window.first, dtype=np.bool_)}


@numba.njit(cache=True)
def distances(force: FloatArray, nearest: FloatArray, best: FloatArray) -> None:
    """Write the distance of samples to the line through the nearest two, and to the best line.

    Parameters
    ----------
    force : ndarray (samples,)
        [N]
    nearest, best : ndarray (samples - 6,)
        Of all samples but three at each end [N].
    """
    for place in range(len(best)):
        index = place + _REACH
        here = force[index]
        nearest[place] = abs(here - 0.5 * (force[index - 1] + force[index + 1]))
        best[place] = nearest[place]
        for before in range(1, _REACH + 1):
            for after in range(1, _REACH + 1):
                line = after * force[index - before] + before * force[index + after]
                best[place] = min(best[place], abs(here - line / (before + after)))


def alternation(force: FloatArray) -> float:
    """Return the relative distance of samples from a line through two neighbours.

    Parameters
    ----------
    force : ndarray (samples,)
        Force [N].

    Returns
    -------
    float
        Mean distance to the best of the lines through one of the three samples before and one of
        the three after, over the mean distance to the line through the nearest two: 1 on any
        smooth course, about 0.35 in white noise, 0 where two smooth courses alternate.  1 if
        there are too few samples.
    """
    if len(force) < _LEAST_SAMPLES:
        return 1.0
    count = len(force) - 2 * _REACH
    nearest, best = np.empty((2, count))
    distances(force, nearest, best)
    total = float(nearest.sum())
    if total == 0.0:
        return 1.0
    # With a coarse resolution samples agree by chance: half a digit is added to the distance.
    steps = np.abs(np.diff(force))
    level = float(np.min(steps, initial=np.inf, where=steps > 0.0))
    return min((float(best.sum()) + 0.5 * level * count) / total, 1.0)
