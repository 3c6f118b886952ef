"""The frame of an mcap file: records of one byte of kind, eight of length, and content.

The file is walked from its start and never by its index, so that a file whose writer was killed
reads like any other.
"""

import struct
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.pulses import IntArray
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.records import ByteArray
from rpms_ros.recording.records import Records
from rpms_ros.recording.records import gather

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = range(1, 8)
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA = range(8, 13)
METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(13, 16)
RECORD_HEAD = 9
MESSAGE_HEAD = 22
"""Channel, sequence, time of logging and of publishing, before the data of a message."""


@dataclass(frozen=True)
class Frame:
    """Records that are there in full.

    Attributes
    ----------
    kind : ndarray of uint8, shape (records,)
        Opcodes.
    start, end : ndarray of int64, shape (records,)
        Content of each record, as places in the walked bytes.
    stop : int
        Where the walk ended: behind the footer or the last whole record.
    """

    kind: npt.NDArray[np.uint8]
    start: IntArray
    end: IntArray
    stop: int

    def part(self, begin: int, end: int) -> 'Frame':
        """Return the records from number `begin` up to `end`."""
        chosen = slice(begin, end)
        return Frame(self.kind[chosen], self.start[chosen], self.end[chosen], self.stop)

    def of_kind(self, kind: int) -> list[tuple[int, int]]:
        """Return start and end of every record of one kind."""
        chosen = self.kind == kind
        return list(zip(self.start[chosen].tolist(), self.end[chosen].tolist(), strict=True))


@numba.njit(cache=True)
def _count(data: ByteArray, position: int) -> int:
    count = 0
    while position + 9 <= len(data):
        size = np.uint64(0)
        for index in range(8):
            size |= np.uint64(data[position + 1 + index]) << np.uint64(8 * index)
        if size > np.uint64(len(data) - position - 9):
            break
        count += 1
        if data[position] == 2:
            break
        position += 9 + int(size)
    return count


@numba.njit(cache=True)
def _fill(
    data: ByteArray, position: int, kind: npt.NDArray[np.uint8], start: IntArray, end: IntArray
) -> None:
    for record in range(len(kind)):
        size = np.uint64(0)
        for index in range(8):
            size |= np.uint64(data[position + 1 + index]) << np.uint64(8 * index)
        kind[record] = data[position]
        start[record] = position + 9
        position += 9 + int(size)
        end[record] = position


def walk(data: ByteArray, begin: int = 0) -> Frame:
    """Return the records from `begin` on, up to the footer or to one that is cut off."""
    count = _count(data, begin)
    frame = Frame(
        np.empty(count, np.uint8), np.empty(count, np.int64), np.empty(count, np.int64), 0
    )
    _fill(data, begin, frame.kind, frame.start, frame.end)
    return Frame(frame.kind, frame.start, frame.end, int(frame.end[-1]) if count else begin)


def messages_of(data: ByteArray, frame: Frame) -> Batch:
    """Return the messages of a frame in the order of the file."""
    chosen = (frame.kind == MESSAGE) & (frame.end - frame.start >= MESSAGE_HEAD)
    start = frame.start[chosen]
    time_ns = gather(data, start + 6, '<u8').astype(np.int64)
    records = Records(data, start + MESSAGE_HEAD, frame.end[chosen], time_ns)
    return Batch(gather(data, start, '<u2').astype(np.int64), records)


class Content:
    """Reads the fields of one record from its start on."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0

    def number(self, code: str) -> Any:
        """Return the next little-endian number of a `struct` code."""
        (value,) = struct.unpack_from(f'<{code}', self._data, self.position)
        self.position += struct.calcsize(f'<{code}')
        return value

    def text(self) -> str:
        """Return the next string."""
        size = self.number('I')
        self.position += size
        return self._data[self.position - size : self.position].decode('utf-8', 'replace')
