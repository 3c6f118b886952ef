# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Interlocks: what has to be true for a pulse to be possible, and the stop that is latched.

Two kinds.  A *sign of life* (heartbeat, executor, supervisor, force samples) has to keep coming
and is held against its age at every single pulse, not by a timer that could itself be late.  A
*condition* (emergency stop, force, temperature) is open or closed.  Whatever opens while a pulse
is possible is latched: closing it again is not enough, somebody has to reset it.

Whether samples show that a sensor works: new stamps, of now, and the frame that is expected.
"""

import threading
from collections.abc import Callable, Mapping

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.records.clocks import slept_ns

SUSPEND = 'suspend'
# the clocks are not read at one instant
_NAP_NS = 20_000_000
_READINGS = 5

BUSY = 'computer too busy: pulses stopped; '
"""Begins the reason where a thread of the driver itself has missed its time."""

HOLD_SHARE = 0.4
"""Share of the longest silence of a hearer of stops after which pulses are held back."""


class Refused(StimulationError):
    """A driver does not do what it was asked to; ``limit`` names the limit or interlock."""

    def __init__(self, limit: str, reason: str) -> None:
        super().__init__(reason)
        self.limit = limit


class Interlocks:
    """Signs of life and conditions.  Every method but `reset` only notes or looks something up.

    Parameters
    ----------
    timeouts_s : mapping of str to float
        Longest age of each sign of life [s].
    slept : callable
        For how long the machine has slept since its start [ns].
    """

    def __init__(
        self, timeouts_s: Mapping[str, float], slept: Callable[[], int] = slept_ns
    ) -> None:
        self._slept = slept
        self.awake()
        self._timeouts_ns: dict[str, int] = {}
        self._holds_ns: dict[str, int] = {}
        self._lock = threading.Lock()
        self._seen_ns: dict[str, int] = {}
        self._conditions: dict[str, str] = {}
        self._latched: dict[str, str] = {}
        for name, timeout_s in timeouts_s.items():
            self.require(name, timeout_s)

    def require(self, name: str, timeout_s: float, hold_s: float | None = None) -> None:
        """Ask for a sign of life.

        Parameters
        ----------
        name : str
            Of whom.
        timeout_s : float
            Longest silence [s]; then it is a problem.
        hold_s : float, optional
            Of a thread of the driver: silence [s] from which pulses are held back.
        """
        with self._lock:
            self._timeouts_ns[name] = nanoseconds(timeout_s)
            if hold_s is not None:
                self._holds_ns[name] = nanoseconds(hold_s)

    @property
    def latched(self) -> bool:
        """Whether a stop is latched."""
        return bool(self._latched)

    @property
    def latched_reason(self) -> str:
        """The first cause of the latched stop in plain words; empty without one."""
        with self._lock:
            return next(iter(self._latched.values()), '')

    def awake(self) -> None:
        """Note that the machine is awake: what it has slept so far does not count."""
        # the largest: of one that is read while the thread waits, the others are too large
        self._slept_ns = max(self._slept() for _ in range(_READINGS))

    @property
    def slept(self) -> bool:
        """Whether the machine has slept since `awake`."""
        return self._sleep() is not None

    def seen(self, name: str, now_ns: int) -> None:
        """Note a sign of life."""
        with self._lock:
            self._seen_ns[name] = now_ns

    def open(self, name: str, reason: str) -> None:
        """Note that a condition does not hold."""
        with self._lock:
            self._conditions[name] = reason

    def close(self, name: str) -> None:
        """Note that a condition holds again."""
        with self._lock:
            self._conditions.pop(name, None)

    def held_by(self, now_ns: int) -> str | None:
        """Return the sign of life whose silence delays pulses, None if there is none."""
        with self._lock:
            for name, hold in self._holds_ns.items():
                if now_ns - self._seen_ns.get(name, now_ns) > hold:
                    return name
            return None

    def problem(self, now_ns: int, since_ns: int | None = None) -> tuple[str, str] | None:
        """Return name and reason of the first open interlock, None if all are closed.

        Parameters
        ----------
        now_ns : int
            Now [ns].
        since_ns : int, optional
            A silence counts from then at the earliest [ns].
        """
        with self._lock:
            for name, reason in self._conditions.items():
                return name, reason
            for name, timeout in self._timeouts_ns.items():
                seen = self._seen_ns.get(name)
                if seen is None:
                    return name, f'{name}: expected a sign of life, got none yet'
                if since_ns is not None:
                    seen = max(seen, since_ns)
                if now_ns - seen > timeout:
                    age = (now_ns - seen) / 1e9
                    whose = BUSY if name in self._holds_ns else ''
                    return name, (
                        f'{whose}{name}: expected a sign of life within {timeout / 1e9:g} s, '
                        f'got none for {age:.3g} s'
                    )
            return self._sleep()

    def _sleep(self) -> tuple[str, str] | None:
        """Return that the machine has slept: no age has grown meanwhile."""
        asleep_ns = self._slept() - self._slept_ns
        if asleep_ns <= _NAP_NS:
            return None
        return SUSPEND, (
            f'{SUSPEND}: expected the machine to stay awake while pulses are possible, got it '
            f'asleep for {asleep_ns / NANOSECONDS_PER_SECOND:.3g} s'
        )

    def latch(self, name: str, reason: str) -> None:
        """Latch a stop; the first cause is kept in front."""
        with self._lock:
            self._latched.setdefault(name, reason)

    def reset(self, now_ns: int) -> None:
        """Reset a latched stop.

        Raises
        ------
        Refused
            If a cause is still there.
        """
        with self._lock:
            for name, reason in self._conditions.items():
                raise Refused(name, f'reset: expected the cause {name} gone, got {reason}')
            for name in self._latched:
                seen = self._seen_ns.get(name)
                timeout = self._timeouts_ns.get(name)
                if timeout is not None and (seen is None or now_ns - seen > timeout):
                    raise Refused(name, f'reset: expected {name} to come again, got nothing')
            self._latched.clear()


class SensorLife:
    """Judges the samples of one sensor.

    Parameters
    ----------
    frame_id : str
        Frame that the samples have to be of.
    timeout_s : float
        How far a stamp may be from the driver's time [s]: a recording that is played is of
        another day, and a sensor that falls behind shows what was.
    """

    def __init__(self, frame_id: str, timeout_s: float) -> None:
        self._frame_id = frame_id
        self._timeout_ns = nanoseconds(timeout_s)
        self._last_ns: int | None = None

    def refusal(self, stamp_ns: int, frame_id: str, now_ns: int) -> str | None:
        """Return why a sample does not count as a sign of life, None if it does.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the sample [ns].
        frame_id : str
            Its frame.
        now_ns : int
            Time by the clock that the driver stamps its pulses with [ns].
        """
        if frame_id != self._frame_id:
            return f'expected force in frame {self._frame_id!r}, got {frame_id!r}'
        age_ns = now_ns - stamp_ns
        if abs(age_ns) > self._timeout_ns:
            limit_s = self._timeout_ns / NANOSECONDS_PER_SECOND
            return (
                f'expected a force sample within {limit_s:g} s of the time of the driver, '
                f'got one of {age_ns / NANOSECONDS_PER_SECOND:.3g} s ago'
            )
        last, self._last_ns = self._last_ns, stamp_ns
        if last is not None and stamp_ns <= last:
            moved_ns = stamp_ns - last
            return f'expected a force sample after the last one, got its stamp moved {moved_ns} ns'
        return None
