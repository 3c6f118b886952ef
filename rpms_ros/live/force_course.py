# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The course of the force as a browser can draw it: smallest and largest value in short bins.

A bin lasts for about a pixel, so nothing that a sample shows is lost on the way to the screen, and
the amount that is sent does not grow with the rate of the sensor.  Bins are kept in a ring.

Beside it the force that the newest estimate gives for the pulses that were delivered: the response
to one pulse at full intensity, times the recruitment of each pulse relative to full intensity,
Eq. (30), summed over the pulses, plus the newest level of the baseline if the estimate has one.
"""

import math
from collections import deque
from collections.abc import Sequence
from functools import cache

import numpy as np

from rpms_ros.axis import FORCE, Axis, along
from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.quality.explained_force import rate_weights
from rpms_ros.muscle.recruitment import (
    RateRecruitment,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray
from rpms_ros.recording.rosbag.definitions import WRENCH_STAMPED
from rpms_ros.recording.rosbag.records import Channel, Records
from rpms_ros.recording.rosbag.topic_reading import NANOSECOND, SECOND, SENSOR_TYPES, Decoder

BIN_NS = 5_000_000
KEPT = 6000
"""Bins that are kept: half a minute."""

_JUMP = 200
# Without a sample for so long, as of a slow sensor, the line goes on.
_HELD = 20
# A clock that has jumped goes on from there; a single stray stamp does not.
_STEADY = 5


class ForceBins:
    """Smallest, largest and modelled force a bin.

    Attributes
    ----------
    epoch : int
        Counts how often the stamps began anew, as after a jump of the clock.
    origin : int
        Bin of the first sample of this epoch.
    newest : int
        Newest bin that is complete, one less than `origin` if there is none.
    not_finite, stray : int
        Samples that were left out: NaN or infinite, or stamped far from the others.
    """

    def __init__(self) -> None:
        self.epoch = self.not_finite = self.stray = self.origin = 0
        self.newest = self._open = -1
        self._low = self._high = 0.0
        self._strays = (0, 0)
        self._begun = False
        self._values: FloatArray = np.full((3, KEPT), np.nan)

    @property
    def oldest(self) -> int:
        """Oldest bin that is still kept."""
        return max(self.origin, self.newest - KEPT + 1)

    def add(self, stamp_ns: int, force: float) -> None:
        """Add a sample [ns], [N]."""
        if not math.isfinite(force):
            self.not_finite += 1
            return
        place = stamp_ns // BIN_NS
        if place == self._open:
            self._low, self._high = min(self._low, force), max(self._high, force)
        elif not self._begun or not -_JUMP < place - self._open < KEPT:
            self._jumped(place, force)
        elif place > self._open:
            self._close(place)
            self._open, self._low, self._high = place, force, force

    def model(self, first: int, forces: FloatArray) -> None:
        """Put the modelled force [N] of bins from `first` on beside the measured."""
        self._values[2, (first + np.arange(len(forces))) % KEPT] = forces

    def since(self, first: int, last: int) -> FloatArray:
        """Return low, high and modelled force [N] of bins, shape (3, last - first + 1).

        Both bins have to be kept; NaN stands for a bin in a gap of more than 0.1 s.
        """
        return self._values[:, np.arange(first, last + 1) % KEPT]

    def _jumped(self, place: int, force: float) -> None:
        before, count = self._strays
        count = count + 1 if count and abs(place - before) < _JUMP else 1
        self._strays = (place, count)
        if self._begun and count < _STEADY:
            self.stray += 1
            return
        self._strays = (0, 0)
        self.epoch += self._begun
        self._begun = True
        self.origin, self.newest = place, place - 1
        self._values.fill(np.nan)
        self._open, self._low, self._high = place, force, force

    def _close(self, place: int) -> None:
        """Keep the open bin; many up to `place` stay empty, as a hole in the line."""
        self._values[:, np.arange(self._open, place) % KEPT] = np.nan
        held = place if place - self._open <= _HELD else self._open + 1
        self._values[:2, np.arange(self._open, held) % KEPT] = [[self._low], [self._high]]
        self.newest = place - 1
        self._strays = (0, 0)


# More than a second of pulses at the highest rate of a schedule.
_MOST_PULSES = 2000
_MOST_TIMES = 5000
# No response lasts so long; a much longer one could not be counted in nanoseconds.
_LONGEST_S = 100.0
# A response may become longer with the next estimate.
_LATEST_NS = 1_000_000_000


# What is left of the deviations of a law with every look.
_REMEMBERED = 0.99


class ModelledForce:
    """Sums responses to pulses; all NaN before the first estimate that has one."""

    def __init__(self) -> None:
        self._pulses: deque[tuple[int, float]] = deque(maxlen=_MOST_PULSES)
        self._estimate: Estimate | None = None
        self._missed = np.zeros(2)

    def restart(self) -> None:
        """Forget the pulses: the clock has jumped."""
        self._pulses.clear()

    def pulse(self, onset_ns: int, intensity: float) -> None:
        """Take a pulse that was delivered; its intensity is within 0..1."""
        self._pulses.append((onset_ns, intensity))

    def estimate(self, estimate: Estimate) -> None:
        """Take the newest estimate, if it can be drawn."""
        time, force = estimate.response_time, estimate.response_force
        finite = len(time) > 1 and np.isfinite(time).all() and np.isfinite(force).all()
        bounded = len(time) <= _MOST_TIMES and finite and np.abs(time).max() <= _LONGEST_S
        if bounded and (np.diff(time) > 0.0).all():
            self._estimate = estimate

    def at(self, stamp_ns: IntArray, measured: FloatArray) -> FloatArray:
        """Return the force [N] at stamps (n,), ascending, where it was measured [N] or NaN.

        By the weight of pulses by their intervals, or without it, whichever is nearer to what was
        measured of late: which one the estimator has is no part of an estimate.
        """
        if self._estimate is None or not len(stamp_ns):
            return np.full(len(stamp_ns), np.nan)
        time, response = self._estimate.response_time, self._estimate.response_force
        oldest = int(stamp_ns[0]) - math.ceil(float(time[-1]) * 1e9)
        # looking at all pulses takes longer than the rest
        while self._pulses and self._pulses[0][0] < oldest - _LATEST_NS:
            self._pulses.popleft()
        # older ones do not act any more, but tell the interval of the next
        given = [pulse for pulse in self._pulses if pulse[0] <= int(stamp_ns[-1])]
        known = zip(self._estimate.linear_names, self._estimate.linear, strict=False)
        level = [float(value) for name, value in known if name.startswith('baseline')][-1:]
        total = np.full((2, len(stamp_ns)), level[0] if np.isfinite(level).any() else 0.0)
        if given:
            onset_ns = np.array([onset for onset, _ in given], dtype=np.int64)
            share = self._estimate.relative_recruitment(np.array([u for _, u in given]))
            weight = rate_weights(self._estimate.repetition_rate, onset_ns, RateRecruitment())
            weight[~np.isfinite(weight)] = 1.0
            after = (stamp_ns[:, None] - onset_ns[None, :]) * 1e-9
            caused = np.interp(after, time, response, left=0.0, right=0.0)
            total += (caused @ np.column_stack((share, share * weight))).T
        missed = np.nansum(np.square(total - measured), axis=1)
        self._missed = _REMEMBERED * self._missed + missed
        return np.asarray(total[np.argmin(self._missed)])


def warm_up() -> None:
    """Compile and load beforehand: the page would stand still at the first pulse."""
    for quantity in SENSOR_TYPES:
        _decoder(quantity)
    identified_recruitment(RecruitmentParameters(0.3, 0.7, 6.0), np.ones(1))


@cache
def _decoder(quantity: str) -> Decoder:
    wanted = SENSOR_TYPES[quantity][WRENCH_STAMPED]
    return Decoder(Channel(FORCE, WRENCH_STAMPED), (*wanted, SECOND, NANOSECOND))


def forces_of(
    messages: Sequence[bytes], axis: Axis, quantity: str = FORCE
) -> tuple[IntArray, FloatArray]:
    """Return stamps [ns] and forces along `axis` [N], each (n,), of geometry_msgs/WrenchStamped.

    Of a sensor of `TORQUE` it is the torque about the axis [N m].  Each is what
    `rpms_ros.messages.force_of` makes of the message, in every bit; those that cannot be decoded
    are left out.
    """
    found = _decoder(quantity).decode(Records.of(messages, np.zeros(len(messages), np.int64)))
    columns = {path: column[found.good] for path, column in found.number.items()}
    second, nanosecond = (columns[name].astype(np.int64) for name in (SECOND, NANOSECOND))
    # numbers of anybody may be infinite or too large for a sum
    with np.errstate(all='ignore'):
        force: FloatArray = along(axis, [*columns.values()][:3])
    return second * NANOSECONDS_PER_SECOND + nanosecond, force.astype(np.float64, copy=False)
