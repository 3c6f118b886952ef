# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How late delivered pulses were against their schedule."""

from dataclasses import dataclass

from rpms_ros.pulses import NANOSECONDS_PER_SECOND


@dataclass
class Lateness:
    """Running mean and maximum.

    Attributes
    ----------
    count : int
        Delivered pulses.
    sum_ns, max_ns : int
        Sum and maximum of actual minus scheduled onset [ns].
    """

    count: int = 0
    sum_ns: int = 0
    max_ns: int = 0

    def add(self, late_ns: int) -> None:
        """Take one delivered pulse into account."""
        self.count += 1
        self.sum_ns += late_ns
        self.max_ns = max(self.max_ns, late_ns)

    @property
    def mean_s(self) -> float:
        """Mean [s]; 0 before the first pulse."""
        return self.sum_ns / self.count / NANOSECONDS_PER_SECOND if self.count else 0.0

    @property
    def max_s(self) -> float:
        """Maximum [s]."""
        return self.max_ns / NANOSECONDS_PER_SECOND
