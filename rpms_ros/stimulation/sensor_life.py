# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether samples show that a sensor works: new stamps, of now, and the frame that is expected."""

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import nanoseconds


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
