# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw records: bytes of many messages of one topic, not yet decoded."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.pulses import IntArray

ByteArray = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Channel:
    """A topic with one type, as a recording describes it.

    Attributes
    ----------
    topic : str
        Name of the topic.
    type_name : str
        Name of the message.
    definition : str
        Text of its definition, empty if the recording carries none.
    definition_encoding : str
        ``ros2msg`` or ``ros2idl``.
    serialization : str
        ``cdr`` wherever this package can decode.
    publisher : str
        Identity of who published the messages, empty if the recording does not tell.
    """

    topic: str
    type_name: str
    definition: str = ''
    definition_encoding: str = 'ros2msg'
    serialization: str = 'cdr'
    publisher: str = ''


@dataclass(frozen=True)
class Records:
    """Messages in the order of the file, as places in one buffer.

    Attributes
    ----------
    buffer : ndarray of uint8
        Bytes that hold the messages, among others.
    start, end : ndarray of int64, shape (messages,)
        Where each message starts and ends in the buffer.
    time_ns : ndarray of int64, shape (messages,)
        When each was received [ns].
    place : ndarray of int64, shape (messages,), or None
        Which message of the recording each is, over all topics; None before that is counted.
    """

    buffer: ByteArray
    start: IntArray
    end: IntArray
    time_ns: IntArray
    place: IntArray | None = None

    def __len__(self) -> int:
        return len(self.start)

    def select(self, chosen: slice | npt.NDArray[Any]) -> 'Records':
        """Return the messages of a slice, a mask or indices."""
        place = None if self.place is None else self.place[chosen]
        return Records(
            self.buffer, self.start[chosen], self.end[chosen], self.time_ns[chosen], place
        )

    def message(self, index: int) -> bytes:
        """Return the bytes of one message."""
        return self.buffer[self.start[index] : self.end[index]].tobytes()

    @classmethod
    def of(
        cls, messages: Sequence[bytes], time_ns: IntArray, place: IntArray | None = None
    ) -> 'Records':
        """Return messages that come as one object each."""
        end = np.cumsum(np.fromiter(map(len, messages), np.int64, len(messages)))
        start = np.zeros_like(end)
        start[1:] = end[:-1]
        return cls(np.frombuffer(b''.join(messages), np.uint8), start, end, time_ns, place)


def windows(buffer: ByteArray, kind: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a view with one value of type `kind` from every byte on, aligned or not."""
    kind = np.dtype(kind)
    return np.ndarray((max(0, len(buffer) - kind.itemsize + 1),), kind, buffer, strides=(1,))


def gather(buffer: ByteArray, position: IntArray, kind: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the values of type `kind` that start at these positions, aligned or not.

    Parameters
    ----------
    buffer : ndarray of uint8, contiguous
        Bytes.
    position : ndarray of int64, shape (values,)
        Starts; each value must lie within the buffer.
    kind : dtype
        Type with its byte order.

    Returns
    -------
    ndarray of `kind`, shape (values,)
    """
    return windows(buffer, kind)[position]
