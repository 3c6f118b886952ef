# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording was that of one muscle: the answer that every command goes by.

That the muscle changed is said by the fit of everything, part by part
(`rpms_ros.identification.estimation.batch`), and stands among the doubts of its estimate.  By how
much and when is seen in the force simulated with the estimate
(`rpms_ros.identification.quality.stationarity`), also that of an estimator from outside, which
says nothing of parts.

Whether the force caused by the pulses stayed the same, by an estimate of the whole session.

An estimator that assumes a constant muscle returns an average one.  The force simulated with it is
compared with the measured one in pieces, by the factor that fits best in each.  For a muscle that
tires the factor falls, after a move of the coil it jumps.  Efforts of the patient scatter the
factors; a change has to be large against that scatter.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.quality.explained_force import LAWS, simulated_force
from rpms_ros.identification.session import IdentifiedSession
from rpms_ros.identification.stream.doubts import NO_CONSTANT_MUSCLE
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, PulseTrain

# A piece has to contain several pulses of different intensity [s]; more pieces add no information.
_SHORTEST = 1.5
_MOST_PIECES = 24
_FEWEST_PIECES = 8
# With fewer pieces on one side of a jump the scatter is unknown.
_FEWEST_ASIDE = 3
# Pieces with less simulated force than this share of the usual one are not used.
_LEAST_WEIGHT = 0.05
# In standard deviations; higher for a jump, since it is tried at every place.
_SURE_SLOPE = 5.0
_SURE_JUMP = 6.0
# So many samples tell which law weights the pulses [1].
_MOST_SAMPLES = 100_000


@dataclass(frozen=True)
class ForceChange:
    """Change of the force caused by the pulses.

    Attributes
    ----------
    share : float
        Force at the end minus that at the beginning, as a share of that at the beginning [1];
        infinite if pulses caused none at the beginning.
    sudden_at_s : float or None
        Time of a jump after the first sample [s]; None for a slow change.
    """

    share: float
    sudden_at_s: float | None


def force_change(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> ForceChange | None:
    """Return the change of the force caused by the pulses; None if there is no significant one.

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
        return ForceChange(_share(jump, before), float(0.5 * (time[place - 1] + time[place])))
    if sure_slope > _SURE_SLOPE:
        middle = float(np.average(factor, weights=weight))
        begin = middle - slope * (float(np.average(time, weights=weight)) - float(time[0]))
        return ForceChange(_share(slope * float(time[-1] - time[0]), begin), None)
    return None


def _share(change: float, begin: float) -> float:
    """Return a change as a share of the beginning; infinite if there was nothing."""
    return max(change / begin, -1.0) if begin > 0.0 else math.inf


def _factors(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times [s], factors on the simulated force, and their weights, (pieces,) each."""
    time = (stamp_ns - stamp_ns[0]) / NANOSECONDS_PER_SECOND
    pieces = min(int(time[-1] / _SHORTEST), _MOST_PIECES)
    if pieces < _FEWEST_PIECES:
        return np.empty(0), np.empty(0), np.empty(0)
    some = slice(-_MOST_SAMPLES, None)
    law = max(
        LAWS,
        key=lambda one: _likeness(
            simulated_force(estimate, pulses, stamp_ns[some], one), force[some]
        ),
    )
    stated = simulated_force(estimate, pulses, stamp_ns, law)
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
    """Return values (samples,) minus the straight line through them."""
    left: FloatArray = values - lines @ np.linalg.lstsq(lines, values, rcond=None)[0]
    return left


def _likeness(stated: FloatArray, force: FloatArray) -> float:
    """Return the correlation of two forces (samples,); -1 where one never changes."""
    one, two = stated - stated.mean(), force - force.mean()
    length = math.sqrt(float(one @ one) * float(two @ two))
    return float(one @ two) / length if length > 0.0 else -1.0


def _line(time: FloatArray, factor: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return slope [1/s], its significance in standard deviations, and the residual square."""
    at = time - np.average(time, weights=weight)
    around = factor - np.average(factor, weights=weight)
    spread = float(weight @ np.square(at))
    slope = float(weight @ (at * around)) / spread
    left = float(weight @ np.square(around - slope * at))
    return slope, _sureness(slope, left / (len(time) - 2) / spread), left


def _jump(factor: FloatArray, weight: FloatArray) -> tuple[float, float, float, int]:
    """Return the best jump, its significance, the residual square, and the piece after it."""
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


FOLLOWER = 'tracking'
"""The estimator that follows a muscle that changes."""


def is_mixture(estimate: Estimate) -> bool:
    """Return whether an estimate of a whole recording is one of several muscles."""
    return NO_CONSTANT_MUSCLE in estimate.doubts


def change_over(session: IdentifiedSession, pulses: PulseTrain) -> ForceChange | None:
    """Return how the force caused by the pulses changed where one muscle explains a session.

    Parameters
    ----------
    session : IdentifiedSession
        The result.
    pulses : PulseTrain
        The recorded pulses.

    Returns
    -------
    ForceChange or None
        None if there is no significant change, or if the estimates follow changes.
    """
    last = session.last
    if len(session.estimates) > 1 or last.rate_names or not last.curve_known:
        return None
    part = session.in_order
    return force_change(last, pulses, session.stamp_ns[part], session.force[part])
