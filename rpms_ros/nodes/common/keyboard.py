# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Single keys of a terminal, read without waiting for Enter."""

import contextlib
import os
import select
import sys
import termios
import tty
from typing import Any


class Keyboard:
    """Reads keys from a terminal; `close` restores its settings.

    Parameters
    ----------
    descriptor : int, optional
        Of the terminal; standard input if not given.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._before: Any = None
        self.there = os.isatty(self._descriptor)
        if self.there:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)

    def read(self) -> str:
        """Return the keys since the last call; a terminal that is gone is not `there` any more."""
        found = b''
        while self.there and select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                read = os.read(self._descriptor, 64)
            except OSError:
                read = b''
            self.there = bool(read)
            found += read
        return found.decode('utf-8', 'replace')

    def close(self) -> None:
        """Restore the settings of the terminal."""
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None
