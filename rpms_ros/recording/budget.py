# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How much may be made of a recording: small files that unpack into enormous ones are refused."""

from rpms_ros.errors import RecordingError

LEAST = 1_000_000_000
"""What any recording may take [bytes]."""
PER_BYTE = 4
"""What it may take besides for each of its bytes [bytes]."""
_UNPACKED_PER_BYTE = 100
# Number, time, place and mark of each message, twice while they are joined.
_PER_MESSAGE = 100
_CHUNKS = 8


class Budget:
    """Bounds on memory and, since work is proportional to what is unpacked, on time.

    Parameters
    ----------
    size : int
        Size of all files of the recording [bytes].
    memory : int or None
        What reading may take [bytes]; None for 1 GB and four times the size.

    Attributes
    ----------
    memory : int
        What reading may take [bytes].
    chunk : int
        What a single chunk or message may unpack into [bytes].
    """

    def __init__(self, size: int, memory: int | None = None) -> None:
        self.memory = LEAST + PER_BYTE * size if memory is None else memory
        self.chunk = self.memory // _CHUNKS
        self._unpacked = self.memory + _UNPACKED_PER_BYTE * size
        self._messages = self.memory // _PER_MESSAGE

    def unpack(self, size: int, what: str) -> None:
        """Count what is unpacked [bytes].

        Raises
        ------
        RecordingError
            If it is too much, at once or in all.
        """
        self._unpacked -= size
        if size > self.chunk or self._unpacked < 0:
            raise self.exceeded(f'{what} with {size} bytes unpacked')

    def load(self, size: int, what: str) -> None:
        """Look at what is held as a whole for a while [bytes].

        Raises
        ------
        RecordingError
            If it is too much.
        """
        if size > self.memory:
            raise self.exceeded(f'{what} of {size} bytes')

    def hold(self, size: int) -> None:
        """Count what is kept beside the numbers of messages [bytes].

        Raises
        ------
        RecordingError
            If it is too much.
        """
        self.keep(-(-size // _PER_MESSAGE))

    def keep(self, messages: int) -> None:
        """Count messages whose numbers are kept.

        Raises
        ------
        RecordingError
            If they are too many.
        """
        self._messages -= messages
        if self._messages < 0:
            raise self.exceeded('more messages')

    def exceeded(self, found: str) -> RecordingError:
        """Return the error for what does not fit."""
        return RecordingError(
            f'expected a recording that can be read within {self.memory / 1e9:.3g} GB '
            f'(--max-memory allows more), got {found}'
        )
