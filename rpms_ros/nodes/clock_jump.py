# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tell a clock that jumps from a process that was held up."""

import time

from rpms_ros.pulses import NANOSECONDS_PER_SECOND

# Largest difference of two steps that is no jump.
_LARGEST_STEP_NS = NANOSECONDS_PER_SECOND


class JumpDetector:
    """Compares the steps of a clock with those of the steady clock."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None

    def at(self, now_ns: int, steady_ns: int | None = None) -> bool:
        """Return whether the clock, which shows `now_ns`, has jumped since the last call."""
        steady_ns = time.monotonic_ns() if steady_ns is None else steady_ns
        last, self._last = self._last, (now_ns, steady_ns)
        if last is None:
            return False
        return abs((now_ns - last[0]) - (steady_ns - last[1])) > _LARGEST_STEP_NS
