"""Heartbeats: a stamp that has to be new and to move on, or it proves nothing."""

from rpms_ros.pulses import NANOSECONDS_PER_SECOND


class Heartbeat:
    """Tells a heartbeat of now from a replayed, delayed or impossible one.

    Parameters
    ----------
    timeout_s : float
        Oldest stamp that counts, and how far one may be ahead [s].
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_ns = round(timeout_s * NANOSECONDS_PER_SECOND)
        self._last_ns: int | None = None

    def refusal(self, stamp_ns: int, now_ns: int) -> str | None:
        """Return why a heartbeat does not count, None if it does.

        Parameters
        ----------
        stamp_ns : int
            When it was sent [ns].
        now_ns : int
            Now, on the same clock [ns].
        """
        age_s = (now_ns - stamp_ns) / NANOSECONDS_PER_SECOND
        limit_s = self._timeout_ns / NANOSECONDS_PER_SECOND
        if now_ns - stamp_ns > self._timeout_ns:
            return f'expected a heartbeat of at most {limit_s:g} s ago, got one of {age_s:.3g} s'
        if stamp_ns - now_ns > self._timeout_ns:
            return f'expected a heartbeat of now, got one {-age_s:.3g} s in the future'
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            return 'expected a heartbeat after the last one, got one that repeats or goes back'
        self._last_ns = stamp_ns
        return None
