# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
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
from rpms_ros.recording.crc import crc32
from rpms_ros.recording.records import ByteArray
from rpms_ros.recording.records import Records
from rpms_ros.recording.records import gather

PUBLISHER = 'publisher'
"""Name in the notes of a channel under which the identity of its publisher stands."""
MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = range(1, 8)
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA = range(8, 13)
METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(13, 16)
RECORD_HEAD = 9
FOOTER_SIZE = 20
_COUNT_SIZE = 8
_CHECKSUM_SIZE = 4
_BLOCK = 1 << 20
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

    def ends_file(self, data: ByteArray) -> bool:
        """Tell whether the last record is a footer, with nothing but the magic behind it."""
        return (
            len(self.kind) > 0
            and self.kind[-1] == FOOTER
            and self.end[-1] - self.start[-1] == FOOTER_SIZE
            and data[self.stop : self.stop + 9].tobytes() == MAGIC
        )

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


@dataclass(frozen=True)
class End:
    """What the end of a complete file states.

    Attributes
    ----------
    summary_fits : bool
        Whether the checksum of the index fits, if there is one.
    message_count : int or None
        Number of messages in the file, if it is stated.
    """

    summary_fits: bool
    message_count: int | None


def end_of(data: ByteArray, frame: Frame) -> End:
    """Return what the end of a file states whose last record is its footer."""
    footer = int(frame.start[-1])
    begin, _, checksum = struct.unpack('<QQI', data[footer : footer + FOOTER_SIZE].tobytes())
    # Without an index the checksum covers the head of the footer alone.
    covered = data[begin or footer - RECORD_HEAD : footer + FOOTER_SIZE - 4]
    fits = not checksum or crc32(covered.tobytes()) == checksum
    statistics = frame.of_kind(STATISTICS)
    if not statistics or statistics[-1][1] - statistics[-1][0] < _COUNT_SIZE:
        return End(fits, None)
    count = data[statistics[-1][0] : statistics[-1][0] + _COUNT_SIZE]
    return End(fits, int.from_bytes(count.tobytes(), 'little'))


def data_fits(data: ByteArray, frame: Frame) -> bool:
    """Tell whether the checksum of everything before the index fits, if there is one."""
    ends = frame.of_kind(DATA_END)
    if not ends or ends[-1][1] - ends[-1][0] != _CHECKSUM_SIZE:
        return True
    begin, end = ends[-1]
    checksum = int.from_bytes(data[begin:end].tobytes(), 'little')
    value = 0
    for place in range(0, begin - RECORD_HEAD, _BLOCK):
        value = crc32(data[place : min(place + _BLOCK, begin - RECORD_HEAD)].data, value)
    return not checksum or value == checksum


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
