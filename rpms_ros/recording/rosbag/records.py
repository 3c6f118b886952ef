# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a reader of a recording gives: raw messages, not yet decoded, and what is wrong with them.

How much may be made of a recording is bounded: small files that unpack into enormous ones are
refused.  Of a part that is cut off or damaged, as much is unpacked as comes before the damage.
"""

import sys
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from lz4 import frame as lz4  # type: ignore[import-untyped]

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable
from rpms_ros.pulses import IntArray

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ByteArray = npt.NDArray[np.uint8]


class Channel(NamedTuple):
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
        start, end, time_ns = (one[chosen] for one in (self.start, self.end, self.time_ns))
        return Records(self.buffer, start, end, time_ns, place)

    def message(self, index: int) -> bytes:
        """Return the bytes of one message."""
        return self.buffer[self.start[index] : self.end[index]].tobytes()

    @classmethod
    def of(
        cls, messages: Sequence[bytes], time_ns: IntArray, place: IntArray | None = None
    ) -> 'Records':
        """Return messages that come as one object each."""
        size = np.fromiter(map(len, messages), np.int64, len(messages))
        end = np.cumsum(size)
        return cls(np.frombuffer(b''.join(messages), np.uint8), end - size, end, time_ns, place)


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
    kind = np.dtype(kind)
    count = max(0, len(buffer) - kind.itemsize + 1)
    return np.ndarray((count,), kind, buffer, strides=(1,))[position]


Batch = tuple[IntArray, Records]
"""Numbers of the topics that the writer gave (messages,), and the messages."""


# A file of damaged chunks must not become a screen full of lines, nor a memory full of them.
_MOST_REMARKS = 10


class Findings:
    """Faults by kind, and one line for people on each.

    Attributes
    ----------
    counts : Counter of str
        How often each kind of fault was met, such as ``truncated_file``.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._remarks: dict[str, list[str]] = {}
        self._left_out: Counter[str] = Counter()

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
            more = self._left_out[kind]
            lines += [*remarks, *([f'{more} more of {kind}'] if more else [])]
        return lines


# What any recording may take [bytes].
_LEAST = 1_000_000_000
# What it may take besides for each of its bytes [bytes].
_PER_BYTE = 4
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
        self.memory = _LEAST + _PER_BYTE * size if memory is None else memory
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
        fault = f'expected a recording that can be read within {self.memory / 1e9:.3g} GB'
        return RecordingError(f'{fault} (--max-memory allows more), got {found}')


class StorageFile(ABC):
    """A file of a recording.

    Parameters
    ----------
    path : Path
        The file.
    findings : Findings
        Where faults are noted.
    budget : Budget
        What reading may take.

    Attributes
    ----------
    channels : dict of int to Channel
        Channels that were met so far, by number.

    Raises
    ------
    RecordingError
        If the file is empty or of another kind.
    """

    kind: str
    magic: bytes

    def __init__(self, path: Path, findings: Findings, budget: Budget) -> None:
        self._path = path
        self._findings = findings
        self._budget = budget
        self.channels: dict[int, Channel] = {}
        with path.open('rb') as file:
            found = file.read(len(self.magic))
        if found != self.magic:
            what = repr(found) if found else 'an empty file'
            raise RecordingError(f'expected {self.kind} file at {path}, got {what}')

    @abstractmethod
    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""


ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_BLOCK = 1 << 20
# Of a damaged frame, so much at once: no more than this is lost before the damage.
_STEP = 1 << 16
_ERRORS = (zstd.ZstdError, RuntimeError, EOFError, MemoryError)

DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    'lz4': lz4.LZ4FrameDecompressor,
    'zstd': zstd.ZstdDecompressor,
}
"""What unpacks a chunk, by the name that mcap has for its compression."""


def unpacked(data: bytes | memoryview, compression: str, limit: int) -> bytes:
    """Return the content, at most `limit` bytes; of damaged data what comes before the damage.

    Parameters
    ----------
    data : bytes
        Packed bytes, of one frame or several.
    compression : str
        A key of `DECOMPRESSORS`.
    limit : int
        Never more than this is made, whatever the data say [bytes].
    """
    parts: list[bytes] = []
    decompressor = DECOMPRESSORS[compression]()
    for begin in range(0, len(data), _STEP):
        packed = data[begin : begin + _STEP]
        while packed and limit > 0:
            try:
                parts.append(decompressor.decompress(packed, max_length=limit))
            except _ERRORS:
                return b''.join(parts)
            limit -= len(parts[-1])
            packed = b''
            if decompressor.eof:
                packed = decompressor.unused_data or b''
                decompressor = DECOMPRESSORS[compression]()
    return b''.join(parts)


def unpack_file(packed: Path, target: Path, limit: int) -> bool | None:
    """Write the content of a zstd file to `target`.

    Returns
    -------
    bool or None
        Whether the file was complete; None if its content is larger than `limit` [bytes], in
        which case no more than that was written.
    """
    written = 0
    with zstd.open(packed, 'rb') as source, target.open('wb') as sink:
        try:
            while block := source.read1(_BLOCK):
                written += len(block)
                if written > limit:
                    return None
                sink.write(block)
        except _ERRORS:
            return False
    return True
