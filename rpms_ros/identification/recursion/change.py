# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A test of the a-priori errors that finds sudden changes of the muscle.

The logarithm of the mean square q of the a-priori errors of a block is compared with that of the
last blocks: ``z = (log q - mean) / deviation``, limited to -3..3.  The sum
``c <- max(0, c + z - 1)`` (Page's cumulative sum) stays near zero while the muscle does not
change.  A block adds at most 2, so at least ten blocks, half a second of pulses at 20 Hz, are
needed to exceed 20: a knock or a single spike is no change.
"""

import math

from rpms_ros.identification.recursion.kinds import UNKNOWN
from rpms_ros.identification.saved_state import Restorable

# Most blocks over which mean and deviation are taken.
_BLOCKS = 200.0
_MOST, _DRIFT, _LIMIT = 3.0, 1.0, 20.0
# Standard deviation of the logarithm of a mean of 50 squares of white noise.
_LEAST_DEVIATION = 0.2
# Before this time the errors fall because the recursion learns [s].
_SETTLING_TIME = 5.0


class ChangeTest(Restorable):
    """State of the test.

    Attributes
    ----------
    learnt_s : float
        Time in which pulses acted since the start or the last change [s].
    changes : int
        How many changes were found.
    changed_ns : int or None
        When the newest change began [ns]; None before one, and after a jump of the clock.
    kind : str
        What the newest change was of.
    """

    learnt_s: float
    changes: int
    changed_ns: int | None
    kind: str
    _mean: float
    _variance: float
    _blocks: float
    _sum: float
    _begun_ns: int

    def __init__(self) -> None:
        self.learnt_s = 0.0
        self.changes = 0
        self.changed_ns = None
        self.kind = UNKNOWN
        self._mean = 0.0
        self._variance = 0.0
        self._blocks = 0.0
        self._sum = 0.0
        self._begun_ns = 0

    @property
    def suspects(self) -> bool:
        """Whether the sum has risen: a change may have begun."""
        return self._sum > 0.0

    def interrupt(self) -> None:
        """Reset the sum and forget when a change was: the next blocks are of another clock."""
        self._sum = 0.0
        self.changed_ns = None

    def take(self, start_ns: int, seconds: float, mean_square: float) -> bool:
        """Add a block in which pulses act; return whether the muscle has changed.

        Parameters
        ----------
        start_ns : int
            When the block began [ns].
        seconds : float
            How long it was [s].
        mean_square : float
            Mean square of its a-priori errors, above zero [N^2].
        """
        self.learnt_s += seconds
        value = math.log(mean_square)
        if self.learnt_s > _SETTLING_TIME:
            deviation = max(math.sqrt(self._variance), _LEAST_DEVIATION)
            away = min(max((value - self._mean) / deviation, -_MOST), _MOST)
            if self._sum == 0.0:
                self._begun_ns = start_ns
            self._sum = max(0.0, self._sum + away - _DRIFT)
            if self._sum > _LIMIT:
                self.changes += 1
                self.changed_ns = self._begun_ns
                self._sum = self.learnt_s = self._blocks = 0.0
                return True
            if self._sum > 0.0:
                return False
        self._blocks = min(self._blocks + 1.0, _BLOCKS)
        away = value - self._mean
        self._mean += away / self._blocks
        self._variance += (away * (value - self._mean) - self._variance) / self._blocks
        return False
