"""Whether samples of a sensor prove that it lives: new stamps, and the frame that is expected."""


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
        """Return why a sample is no sign of life, None if it is one."""
        if frame_id != self._frame_id:
            return f'expected force in frame {self._frame_id!r}, got {frame_id!r}'
        last, self._last_ns = self._last_ns, stamp_ns
        if last is not None and stamp_ns <= last:
            moved_ns = stamp_ns - last
            return f'expected a force sample after the last one, got its stamp moved {moved_ns} ns'
        return None
