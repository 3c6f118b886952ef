# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether samples show that a sensor works: new stamps, and the frame that is expected."""


class SensorLife:
    """Judges the samples of one sensor.

    Parameters
    ----------
    frame_id : str
        Frame that the samples have to be of.
    """

    def __init__(self, frame_id: str) -> None:
        self._frame_id = frame_id
        self._last_ns: int | None = None

    def refusal(self, stamp_ns: int, frame_id: str) -> str | None:
        """Return why a sample does not count as a sign of life, None if it does."""
        if frame_id != self._frame_id:
            return f'expected force in frame {self._frame_id!r}, got {frame_id!r}'
        last, self._last_ns = self._last_ns, stamp_ns
        if last is not None and stamp_ns <= last:
            moved_ns = stamp_ns - last
            return f'expected a force sample after the last one, got its stamp moved {moved_ns} ns'
        return None
