# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats: one counts if its stamp has moved on and does not lag.

The sender's clock and the driver's need not agree and may be set while they run: what counts is
that stamps move on, and that the way of a message takes hardly longer than the shortest so far.
"""

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import nanoseconds


class Heartbeat:
    """Tells a new heartbeat from one that is repeated or was delayed.

    Parameters
    ----------
    timeout_s : float
        How much longer than the quickest one a heartbeat may have taken [s].
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_ns = nanoseconds(timeout_s)
        self._last_ns: int | None = None
        self._quickest_ns = 0

    def refusal(self, stamp_ns: int, arrival_ns: int) -> str | None:
        """Return why a heartbeat does not count, None if it does.

        Parameters
        ----------
        stamp_ns : int
            When it was sent, on the sender's clock [ns].
        arrival_ns : int
            When it came, on a clock that is never set [ns].
        """
        took_ns = arrival_ns - stamp_ns
        if self._last_ns is None:
            self._quickest_ns = took_ns
        elif stamp_ns <= self._last_ns:
            return 'expected a heartbeat after the last one, got one that repeats or goes back'
        self._quickest_ns = min(self._quickest_ns, took_ns)
        late_ns = took_ns - self._quickest_ns
        if late_ns > self._timeout_ns:
            limit_s = self._timeout_ns / NANOSECONDS_PER_SECOND
            late_s = late_ns / NANOSECONDS_PER_SECOND
            return f'expected a heartbeat of at most {limit_s:g} s ago, got one of {late_s:.3g} s'
        self._last_ns = stamp_ns
        return None
