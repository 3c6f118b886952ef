# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The course of the force that the stimulation does not cause, as the estimates tell it.

Each estimate that is read tells its newest value, a few times a second: the effort of a patient, a
spasm, a drift of the sensor.
"""

import math
from collections import deque

from rpms_ros.identification.estimate import Estimate
from rpms_ros.live.numbers import number

# Half a minute of estimates, and some.
_KEPT = 400
_NANOSECONDS = 1e-9


class DisturbanceCourse:
    """Keeps what the estimates of the last half minute tell.

    Attributes
    ----------
    count : int
        Estimates so far that told it.
    """

    def __init__(self) -> None:
        self.count = 0
        self._kept: deque[tuple[int, int, float, float]] = deque(maxlen=_KEPT)

    def add(self, estimate: Estimate) -> None:
        """Take an estimate; one that does not know the disturbance is passed over."""
        value, deviation = estimate.disturbance, estimate.disturbance_deviation
        if not (math.isfinite(value) and math.isfinite(deviation) and deviation > 0.0):
            return
        if self._kept and estimate.stamp_ns <= self._kept[-1][1]:
            # a clock that has jumped begins anew: a line is drawn over ascending times
            self._kept.clear()
        self.count += 1
        self._kept.append((self.count, estimate.stamp_ns, value, deviation))

    def since(self, count: int, origin_ns: int) -> list[list[float | None]]:
        """Return time after `origin_ns` [s], value and deviation [N] of those after `count`."""
        return [
            [round((stamp_ns - origin_ns) * _NANOSECONDS, 4), number(value), number(deviation)]
            for counted, stamp_ns, value, deviation in self._kept
            if counted > count and stamp_ns >= origin_ns
        ]
