# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Channels and raw messages of an mcap file, complete or cut off.

The library mcap parses the records.  Finding the records in a file or a chunk
stays here, compiled: the library's reader makes an object of every message, which takes ten times
as long as all of the reading of an hour at 1 kHz; it gives nothing of a chunk that is cut off; and
it unpacks whatever a chunk says it holds.  The file is walked from its start and never by its
index, so that a file whose writer was killed reads like any other.
"""

import struct
from collections.abc import Iterator
from typing import IO, Any, NamedTuple, cast

import numba
import numpy as np
import numpy.typing as npt
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import IntArray
from rpms_ros.recording.rosbag.records import (
    DECOMPRESSORS,
    Batch,
    ByteArray,
    Channel,
    Records,
    StorageFile,
    gather,
    unpacked,
)

try:
    # Ten times as quick: checking a recording then costs next to nothing of reading it.
    from isal.isal_zlib import crc32
except ImportError:
    from zlib import crc32

MAGIC = b'\x89MCAP0\r\n'
# Kind and length before the content of a record [bytes].
_RECORD_HEAD = 9
_FOOTER_SIZE = 20
# Channel, sequence, time of logging and of publishing, before the data of a message.
_MESSAGE_HEAD = 22
# Of a chunk, before the name of its compression.
_CHUNK_HEAD = 28
# A schema or channel as objects, without its texts, and the longest that is taken [bytes].
_OBJECT, _LONGEST = 1000, 4_000_000
_FAULTS = (McapError, struct.error, UnicodeDecodeError)


@numba.njit(cache=True)
def _bounds(data: ByteArray, position: int) -> IntArray:
    """Return where each whole record begins, and where the last one ends."""
    bounds = [position]
    while position + 9 <= len(data):
        size = np.uint64(0)
        for index in range(8):
            size |= np.uint64(data[position + 1 + index]) << np.uint64(8 * index)
        if size > np.uint64(len(data) - position - 9):
            break
        footer = data[position] == 2
        position += 9 + int(size)
        bounds.append(position)
        if footer:
            break
    return np.array(bounds)


class Frame(NamedTuple):
    """Records that are there in full.

    Attributes
    ----------
    kind : ndarray of uint8, shape (records,)
        Opcodes.
    start, end : ndarray of int64, shape (records,)
        Content of each record, as places in the walked bytes.
    """

    kind: npt.NDArray[np.uint8]
    start: IntArray
    end: IntArray

    def part(self, begin: int, end: int) -> 'Frame':
        """Return the records from number `begin` up to `end`."""
        chosen = slice(begin, end)
        return Frame(self.kind[chosen], self.start[chosen], self.end[chosen])

    def of_kind(self, kind: Opcode) -> list[tuple[int, int]]:
        """Return start and end of every record of one kind."""
        chosen = self.kind == kind
        return list(zip(self.start[chosen].tolist(), self.end[chosen].tolist(), strict=True))


def walk(data: ByteArray, begin: int = 0) -> tuple[Frame, int]:
    """Return the records from `begin` up to the footer or a cut, and where the last one ends."""
    bounds = _bounds(data, begin)
    return Frame(data[bounds[:-1]], bounds[:-1] + _RECORD_HEAD, bounds[1:]), int(bounds[-1])


class _Bytes:
    """A stream whose parts are views, not copies."""

    def __init__(self, data: ByteArray) -> None:
        self._data = data.data
        self._place = 0

    def read(self, size: int) -> memoryview:
        self._place += size
        return self._data[self._place - size : self._place]


def _parsed(kind: Any, content: ByteArray) -> Any:
    """Return a record as the library has it."""
    return kind.read(ReadDataStream(cast(IO[bytes], _Bytes(content))))


class McapFile(StorageFile):
    """An mcap file."""

    kind, magic = 'an mcap', MAGIC

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._count = 0
        size = self._path.stat().st_size
        self._data: ByteArray = np.asarray(np.memmap(self._path, np.uint8, 'r', shape=(size,)))
        frame, stop = walk(self._data, len(MAGIC))
        after = 0
        chunks = np.flatnonzero(frame.kind == Opcode.CHUNK).tolist()
        for chunk in chunks:
            yield from self._messages(self._data, frame.part(after, chunk))
            yield from self._chunk(int(frame.start[chunk]), int(frame.end[chunk]))
            after = chunk + 1
        yield from self._messages(self._data, frame.part(after, len(frame.kind)))
        footer = frame.of_kind(Opcode.FOOTER)
        whole = footer and footer[0][1] - footer[0][0] == _FOOTER_SIZE
        if whole and self._data[stop : stop + 9].tobytes() == MAGIC:
            self._check_end(frame, footer[0][0], chunked=bool(chunks))
            return
        lost = len(self._data) - stop
        found = f'{self._path.name} has no end: {lost} bytes from a cut-off record'
        self._findings.add('truncated_file', found)
        if lost > _RECORD_HEAD + _CHUNK_HEAD and self._data[stop] == Opcode.CHUNK:
            yield from self._chunk(stop + _RECORD_HEAD, len(self._data), cut_off=True)

    def _chunk(self, start: int, end: int, cut_off: bool = False) -> Iterator[Batch]:
        if end - start > self._budget.memory:
            raise self._budget.exceeded(f'a chunk of {end - start} bytes')
        # Read, not mapped: a mapped page costs more than its copy, and stays in memory.
        record = np.fromfile(self._path, np.uint8, end - start, offset=start)
        try:
            chunk = _parsed(mcap.Chunk, record)
        except _FAULTS:
            self._findings.add('damaged_chunk', f'chunk at byte {start} has no head')
            return
        size, packed = chunk.uncompressed_size, chunk.data
        if chunk.compression in DECOMPRESSORS:
            self._budget.unpack(size, f'a chunk of {len(packed)} bytes')
            packed = unpacked(packed, chunk.compression, size)
        elif chunk.compression:
            fault = f'expected a compression of {", ".join(DECOMPRESSORS)} in {self._path.name}'
            raise RecordingError(f'{fault}, got {chunk.compression!r}')
        content = np.frombuffer(packed, np.uint8)
        if self._is_usable(content, chunk, start, cut_off):
            yield from self._messages(content, walk(content)[0])

    def _is_usable(self, content: ByteArray, chunk: Any, start: int, cut_off: bool) -> bool:
        """Tell whether the content of a chunk can be used; note what is wrong with it."""
        size = chunk.uncompressed_size
        fits = not chunk.uncompressed_crc or crc32(content.data) == chunk.uncompressed_crc
        if len(content) < size or (fits and len(content) > size):
            if not cut_off:
                found = f'{len(content)} of {size} bytes are readable'
                self._findings.add('damaged_chunk', f'chunk at byte {start}: {found}')
            # Of a chunk that ends early, the beginning is all that there is.
            return True
        if not fits:
            found = f'chunk at byte {start} left out: its checksum does not fit'
            self._findings.add('damaged_chunk', found)
        return fits

    def _messages(self, data: ByteArray, frame: Frame) -> Iterator[Batch]:
        """Yield the messages of a frame, after a look at its schemas and channels."""
        for opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            for start, end in frame.of_kind(opcode):
                try:
                    if end - start > _LONGEST:
                        raise McapError
                    self._add(opcode, data[start:end])
                except _FAULTS:
                    found = f'{self._path.name}: a schema or channel of {end - start} bytes'
                    self._findings.add('damaged_record', f'{found} left out')
        chosen = (frame.kind == Opcode.MESSAGE) & (frame.end - frame.start >= _MESSAGE_HEAD)
        if chosen.any():
            start = frame.start[chosen]
            time_ns = gather(data, start + 6, '<u8').astype(np.int64)
            self._count += len(start)
            records = Records(data, start + _MESSAGE_HEAD, frame.end[chosen], time_ns)
            yield gather(data, start, '<u2').astype(np.int64), records

    def _add(self, opcode: Opcode, content: ByteArray) -> None:
        """Take a schema or a channel."""
        known: dict[int, Any] = self.channels
        found: Any
        if opcode == Opcode.SCHEMA:
            one, known = _parsed(mcap.Schema, content), self._schemas
            found = one.name, bytes(one.data).decode('utf-8', 'replace'), one.encoding
        else:
            one = _parsed(mcap.Channel, content)
            schema = self._schemas.get(one.schema_id, ('', '', ''))
            found = Channel(one.topic, *schema, one.message_encoding)
        if known.get(one.id) != found:
            self._budget.hold(_OBJECT + len(content))
            known[one.id] = found

    def _check_end(self, frame: Frame, start: int, chunked: bool) -> None:
        """Compare what was read with the checksums and the count at the end of the file."""
        data, name = self._data, self._path.name
        footer = _parsed(mcap.Footer, data[start : start + _FOOTER_SIZE])
        # Without an index the checksum covers the head of the footer alone.
        covered = data[footer.summary_start or start - _RECORD_HEAD : start + _FOOTER_SIZE - 4]
        if footer.summary_crc and crc32(covered.tobytes()) != footer.summary_crc:
            found = f'the checksum of the index of {name} does not fit'
            self._findings.add('wrong_checksum', found)
        elif statistics := frame.of_kind(Opcode.STATISTICS):
            begin = statistics[-1][0]
            count = int.from_bytes(data[begin : begin + 8].tobytes(), 'little')
            if count != self._count and not self._findings.counts:
                found = f'{name} states {count} messages, got {self._count}'
                self._findings.add('wrong_count', found)
        # What is in chunks has been checked chunk by chunk.
        for begin, end in [] if chunked else frame.of_kind(Opcode.DATA_END)[-1:]:
            stated = int.from_bytes(data[begin:end].tobytes(), 'little')
            if end - begin == 4 and stated not in (0, crc32(data[: begin - _RECORD_HEAD].data)):
                self._findings.add('wrong_checksum', f'the checksum of {name} does not fit')
