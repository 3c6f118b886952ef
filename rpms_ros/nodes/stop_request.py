"""SIGINT and SIGTERM as a request that cannot get lost."""

import signal
from collections.abc import Callable
from types import FrameType
from typing import Any


class StopRequest:
    """SIGINT and SIGTERM: a process that spins finishes its callback first.

    rclpy's own handlers shut the context down at once, and what a callback is about to publish
    fails half-way with an error of its own.  Python's own handler raises in whatever runs, and
    what runs may swallow it: compiled code is born in callbacks from C, where an exception is
    printed and forgotten.  So the request is noted in any case.

    Attributes
    ----------
    made : bool
        Whether a signal has come.
    """

    def __init__(self) -> None:
        self.made = False
        self._spinning = False
        self._before: dict[int, Callable[[int, FrameType | None], Any] | int | None] = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._on_signal)

    def heed_between_callbacks(self) -> None:
        """From now on only note signals, so that the spinning loop can look at them."""
        self._spinning = True

    def raise_if_made(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self.made:
            raise KeyboardInterrupt

    def restore(self) -> None:
        """Put the handlers back that were there before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        again, self.made = self.made, True
        if again or not self._spinning:
            raise KeyboardInterrupt
