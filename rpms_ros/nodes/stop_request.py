# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signals that end a process, as a request that is not lost in callbacks."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable
from collections.abc import Sequence
from types import FrameType
from typing import Any

SUSPENDING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""Signals that would suspend the process; SIGSTOP cannot be caught."""

# Nothing can be done after a fault of the processor, in whose instruction these come.
_FAULTS = {'SIGSEGV', 'SIGBUS', 'SIGFPE', 'SIGILL', 'SIGTRAP', 'SIGSYS'}
_NEVER_CAUGHT = {'SIGKILL', 'SIGSTOP'}
# Ignored, by default or by Python.
_IGNORED = {'SIGCHLD', 'SIGCONT', 'SIGURG', 'SIGWINCH', 'SIGPIPE', 'SIGXFSZ'}


def name_of(number: int) -> str:
    """Return the name of a signal; most of those for real time have none."""
    named = number in list(signal.Signals)
    return signal.Signals(number).name if named else f'SIGRTMIN+{number - signal.SIGRTMIN}'


ENDING = tuple(
    number
    for number in sorted(signal.valid_signals() - set(SUSPENDING))
    if name_of(number) not in _FAULTS | _NEVER_CAUGHT | _IGNORED
)
"""Signals that would end the process: all that can be caught."""


class StopRequest:
    """Signals as a request to end: a process that spins finishes its callback first.

    The handlers of rclpy shut the context down at once, so that publishing in a callback fails.
    The handler of Python raises in the running code, where the exception may get lost: callbacks
    from C, as during compilation, print and discard it.  So the request is always stored too.

    Attributes
    ----------
    made : bool
        Whether a signal has come.
    """

    def __init__(self) -> None:
        self.made = False
        self._spinning = False
        self._before: dict[int, Callable[[int, FrameType | None], Any] | int | None] = {}
        self._thread: threading.Thread | None = None
        self._written = -1
        self._take_over(ENDING)

    def heed_between_callbacks(self) -> None:
        """From now on only store signals, so that the spinning loop can check for them."""
        self._spinning = True

    def call_at_once(self, callback: Callable[[str], None]) -> None:
        """Let a thread call `callback` on a signal, whatever the main thread does.

        A handler in Python waits until the main thread runs Python code; the byte that wakes this
        thread does not.  Signals that would suspend the process end it from now on.
        """
        self._take_over(SUSPENDING)
        read, self._written = os.pipe()
        os.set_blocking(self._written, False)
        signal.set_wakeup_fd(self._written, warn_on_full_buffer=False)

        def wait() -> None:
            with os.fdopen(read, 'rb', buffering=0) as pipe:
                for number in iter(lambda: pipe.read(1), b''):
                    if number[0] in self._before:
                        callback(f'signal {name_of(number[0])}')

        self._thread = threading.Thread(target=wait, name='signals', daemon=True)
        self._thread.start()

    def raise_if_made(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self.made:
            raise KeyboardInterrupt

    def restore(self) -> None:
        """Restore the earlier handlers."""
        if self._thread is not None:
            signal.set_wakeup_fd(-1)
            with contextlib.suppress(OSError):
                os.close(self._written)
            self._thread.join()
            self._thread = None
        for number, handler in self._before.items():
            # one that was not set by Python cannot be restored by it
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def _take_over(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            self._before[number] = signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        again, self.made = self.made, True
        if again or not self._spinning:
            raise KeyboardInterrupt
