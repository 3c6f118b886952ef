# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw records: bytes of many messages of one topic, not yet decoded.

Raw messages of several topics in one order, ready to be written.

What was found wrong with a recording while reading what can be read.

How much may be made of a recording: small files that unpack into enormous ones are refused.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable
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
    """

    topic: str
    type_name: str
    definition: str = ''
    definition_encoding: str = 'ros2msg'
    serialization: str = 'cdr'


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


@dataclass(frozen=True)
class Batch:
    """Messages with the numbers of their topics.

    Attributes
    ----------
    topic : ndarray of int64, shape (messages,)
        Number of the topic that the writer gave.
    records : Records
        The messages.
    """

    topic: IntArray
    records: Records

    def __len__(self) -> int:
        return len(self.topic)


def merged(topics: Mapping[int, Records]) -> Batch:
    """Return the messages of several topics in the order of reception.

    The order within a topic is kept, also where its clock was set back.  If that happened equally
    often in every topic, what came after it is merged by the times after it.  At equal times the
    topic that comes first in `topics` is first: give pulses before forces.
    """
    records = list(topics.values())
    shift = np.cumsum([0, *(len(part.buffer) for part in records)])
    number = [np.full(len(part), key, np.int64) for key, part in topics.items()]
    time_ns = _joined([part.time_ns for part in records])
    order = _order_of_reception([part.time_ns for part in records])
    begins = [part.start + offset for part, offset in zip(records, shift, strict=False)]
    ends = [part.end + offset for part, offset in zip(records, shift, strict=False)]
    whole = Records(
        np.concatenate([part.buffer for part in records]), _joined(begins), _joined(ends), time_ns
    )
    return Batch(_joined(number)[order], whole.select(order))


def _order_of_reception(times_ns: Sequence[IntArray]) -> IntArray:
    """Return what sorts the joined times of all topics without changing the order within one."""
    lines = [
        np.cumsum(np.diff(times, prepend=times[:1]) < 0, dtype=np.int64) for times in times_ns
    ]
    if len({int(line[-1]) for line in lines if len(line)}) > 1:
        rising = [np.maximum.accumulate(times) for times in times_ns]
        return np.argsort(_joined(rising), kind='stable')
    return np.lexsort((_joined(times_ns), _joined(lines)))


def _joined(parts: Sequence[IntArray]) -> IntArray:
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


# A file of damaged chunks must not become a screen full of lines, nor a memory full of them.
_MOST_REMARKS = 10


@dataclass
class Findings:
    """Faults by kind, and one line for people on each.

    Attributes
    ----------
    counts : Counter of str
        How often each kind of fault was met, such as ``truncated_file``.
    """

    counts: Counter[str] = field(default_factory=Counter)
    _remarks: dict[str, list[str]] = field(default_factory=dict)
    _left_out: Counter[str] = field(default_factory=Counter)

    def add(self, kind: str, remark: str, count: int = 1) -> None:
        """Count a fault and note it in words."""
        self.counts[kind] += count
        remarks = self._remarks.setdefault(kind, [])
        if len(remarks) < _MOST_REMARKS:
            remarks.append(printable(remark))
        else:
            self._left_out[kind] += 1

    @property
    def remarks(self) -> list[str]:
        """Lines that name what is missing or odd, a few of each kind."""
        lines: list[str] = []
        for kind, remarks in self._remarks.items():
            lines += remarks
            if more := self._left_out[kind]:
                lines.append(f'{more} more of {kind}')
        return lines


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
