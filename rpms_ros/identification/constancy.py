# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the force that pulses cause stayed the same, seen by an estimate of the whole session.

An estimator that takes the muscle for one that does not change answers with the muscle in the
middle.  The force that it states is held against the measured one in pieces: by which factor does
it have to be multiplied in each?  A muscle that tires needs a factor that falls, one whose coil
has moved a factor that jumps.  Efforts of the patient scatter the factors, and that scatter is
what a change is measured by.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.simulated_fit import LAWS
from rpms_ros.identification.simulated_fit import simulated_force
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

# A piece has to hold several pulses of different intensity [s]; more pieces tell no more.
_SHORTEST = 1.5
_MOST_PIECES = 24
_FEWEST_PIECES = 8
# Fewer on one side of a jump show no scatter.
_FEWEST_ASIDE = 3
# A piece with less stated force than this share of the usual tells nothing of its factor.
_LEAST_WEIGHT = 0.05
# In standard deviations: a slope is looked for once, a jump at every place.
_SURE_SLOPE = 5.0
_SURE_JUMP = 6.0


@dataclass(frozen=True)
class ForceChange:
    """How the force that the pulses cause changed.

    Attributes
    ----------
    share : float
        Force at the end less that at the beginning, as a share of that at the beginning [1].
    sudden_at_s : float or None
        When it jumped [s after the first sample]; None if it changed slowly.
    """

    share: float
    sudden_at_s: float | None


def force_change(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> ForceChange | None:
    """Return how the force that pulses cause changed; None if no change is sure.

    Parameters
    ----------
    estimate : Estimate
        One muscle for the whole session.
    pulses : PulseTrain
        In any order.
    stamp_ns, force : ndarray (samples,)
        Usable samples at ascending times [ns], [N].
    """
    time, factor, weight = _factors(estimate, pulses, stamp_ns, force)
    if len(time) < _FEWEST_PIECES or not np.average(factor, weights=weight) > 0.0:
        return None
    slope, sure_slope, left_by_slope = _line(time, factor, weight)
    jump, sure_jump, left_by_jump, place = _jump(factor, weight)
    if left_by_jump < left_by_slope and sure_jump > _SURE_JUMP:
        before = float(np.average(factor[:place], weights=weight[:place]))
        return ForceChange(jump / before, float(0.5 * (time[place - 1] + time[place])))
    if sure_slope > _SURE_SLOPE:
        middle = float(np.average(factor, weights=weight))
        begin = middle - slope * (float(np.average(time, weights=weight)) - float(time[0]))
        return ForceChange(slope * float(time[-1] - time[0]) / begin, None)
    return None


def _factors(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times [s], factors of the stated force, and their weights, (pieces,) each."""
    time = (stamp_ns - stamp_ns[0]) / NANOSECONDS_PER_SECOND
    pieces = min(int(time[-1] / _SHORTEST), _MOST_PIECES)
    if pieces < _FEWEST_PIECES:
        return np.empty(0), np.empty(0), np.empty(0)
    stated = max(
        (simulated_force(estimate, pulses, stamp_ns, law) for law in LAWS),
        key=lambda one: _likeness(one, force),
    )
    edges = np.searchsorted(time, np.linspace(0.0, time[-1], pieces + 1))
    rows = []
    for start, end in pairwise(edges.tolist()):
        if end - start < 3:
            continue
        at = time[start:end] - time[start:end].mean()
        lines = np.column_stack((np.ones(end - start), at))
        part = _without(lines, stated[start:end])
        power = float(part @ part)
        if power > 0.0:
            rows.append((float(time[start:end].mean()), part @ force[start:end] / power, power))
    found = np.array(rows).reshape(-1, 3)
    found = found[found[:, 2] > _LEAST_WEIGHT * np.median(found[:, 2])] if len(found) else found
    return found[:, 0], found[:, 1], found[:, 2]


def _without(lines: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (samples,) less the straight line through them."""
    left: FloatArray = values - lines @ np.linalg.lstsq(lines, values, rcond=None)[0]
    return left


def _likeness(stated: FloatArray, force: FloatArray) -> float:
    """Return the correlation of two forces (samples,); -1 where one never changes."""
    one, two = stated - stated.mean(), force - force.mean()
    length = math.sqrt(float(one @ one) * float(two @ two))
    return float(one @ two) / length if length > 0.0 else -1.0


def _line(time: FloatArray, factor: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return slope [1/s], how sure it is in standard deviations, and the square that is left."""
    at = time - np.average(time, weights=weight)
    around = factor - np.average(factor, weights=weight)
    spread = float(weight @ np.square(at))
    slope = float(weight @ (at * around)) / spread
    left = float(weight @ np.square(around - slope * at))
    return slope, _sureness(slope, left / (len(time) - 2) / spread), left


def _jump(factor: FloatArray, weight: FloatArray) -> tuple[float, float, float, int]:
    """Return the best jump, how sure it is, the square that is left, and the piece after it."""
    best = (0.0, 0.0, math.inf, 0)
    for place in range(_FEWEST_ASIDE, len(factor) - _FEWEST_ASIDE + 1):
        sides = (slice(None, place), slice(place, None))
        means = [float(np.average(factor[one], weights=weight[one])) for one in sides]
        left = sum(
            float(weight[one] @ np.square(factor[one] - mean))
            for one, mean in zip(sides, means, strict=True)
        )
        if left < best[2]:
            variance = left / (len(factor) - 2) * sum(1.0 / weight[one].sum() for one in sides)
            jump = means[1] - means[0]
            best = (jump, _sureness(jump, float(variance)), left, place)
    return best


def _sureness(value: float, variance: float) -> float:
    """Return how many standard deviations a value is from 0."""
    if variance > 0.0:
        return abs(value) / math.sqrt(variance)
    return math.inf if value else 0.0
