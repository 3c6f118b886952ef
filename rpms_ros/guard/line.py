# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The serial line of the guard: one command and its answer at a time."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

from rpms_ros.guard import rapid2

# The kernel lets one process at a time write to a port: the other is told to try again.
_PATIENCE_S = 0.05
_PAUSE_S = 0.0002


class LineError(Exception):
    """The line is gone."""


class LineBusy(LineError):
    """Another process writes to the line at this moment, or what was written before never left."""


def write_silence(descriptor: int, raw: bytes) -> None:
    """Write everything, and wait up to 50 ms while another process writes to the same port.

    A driver that silences the instrument past its guard and a guard that does the same may
    meet here.

    Raises
    ------
    LineError
        If the port does not take it.
    """
    end = time.monotonic() + _PATIENCE_S
    while True:
        try:
            write(descriptor, raw)
        except LineBusy:
            if time.monotonic() > end:
                raise
            time.sleep(_PAUSE_S)
        else:
            return


def write(descriptor: int, raw: bytes) -> None:
    """Write everything at once.

    Raises
    ------
    LineBusy
        If nothing, or only a part, can be written now.
    LineError
        If the port is gone.
    """
    try:
        taken = os.write(descriptor, raw)
    except BlockingIOError as error:
        raise LineBusy(f'expected a line to write to, got {error}') from error
    except OSError as error:
        raise LineError(f'expected a line to write to, got {error}') from error
    if taken != len(raw):
        raise LineBusy(f'expected a line that takes {len(raw)} bytes, got {taken}')


@dataclass
class Exchange:
    """A command that was written, and as much of its answer as came.

    Attributes
    ----------
    command : bytes
        Without its check byte.
    length : int
        Of the answer.
    sequence : int or None
        Of the driver's request; None for one of the guard itself.
    written_ns : int
        When the command was written [ns].
    answer : bytes
        What came so far.
    """

    command: bytes
    length: int
    sequence: int | None
    written_ns: int
    answer: bytes = b''

    @property
    def complete(self) -> bool:
        """Whether the answer is whole."""
        return rapid2.complete(self.answer, self.length)


class Line:
    """One exchange at a time over an open serial port that does not block.

    Parameters
    ----------
    descriptor : int
        Of the port.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(self, descriptor: int, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.descriptor = descriptor
        self.outstanding: Exchange | None = None
        self.written_ns = clock()
        self._clock = clock

    def ask(self, command: bytes, length: int, sequence: int | None = None) -> None:
        """Write a command; `heard` collects its answer.

        Raises
        ------
        LineBusy
            If it cannot be written now: who else writes to the port is the driver, which
            silences the instrument past this guard.  No command follows that.
        LineError
            If the port does not take it.
        """
        write(self.descriptor, rapid2.framed(command))
        self.written_ns = self._clock()
        self.outstanding = Exchange(command, length, sequence, self.written_ns)

    def silence(self, raw: bytes) -> None:
        """Write what sets the instrument to zero and disarms it, or gives it back.

        Raises
        ------
        LineError
            If the port does not take it: it is gone, or what was written before never left.
        """
        write_silence(self.descriptor, raw)
        self.written_ns = self._clock()

    def read(self) -> bytes:
        """Return what has come.

        Raises
        ------
        LineError
            If the port is gone.
        """
        try:
            raw = os.read(self.descriptor, 4096)
        except BlockingIOError:
            return b''
        except OSError as error:
            raise LineError(f'expected a line to read from, got {error}') from error
        if not raw:
            raise LineError('expected a line to read from, got its end')
        return raw

    def heard(self) -> tuple[Exchange | None, bytes]:
        """Return the exchange that is complete now, if one is, and what nobody has asked for."""
        raw, asked = self.read(), self.outstanding
        if asked is None:
            return None, raw
        for position in range(len(raw)):
            asked.answer += raw[position : position + 1]
            if asked.complete:
                self.outstanding = None
                return asked, raw[position + 1 :]
        return None, b''
