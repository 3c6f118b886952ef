# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Channels and raw messages of an mcap file, complete or cut off.

The frame of an mcap file: records of one byte of kind, eight of length, and content.

The file is walked from its start and never by its index, so that a file whose writer was killed
reads like any other.

An mcap file, written by the mcap library with every checksum that the format has.
"""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import numba
import numpy as np
import numpy.typing as npt
from mcap.writer import CompressionType, Writer

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import IntArray
from rpms_ros.recording.rosbag.compression import DECOMPRESSORS, crc32, unpacked
from rpms_ros.recording.rosbag.metadata import TopicEntry, qos_text
from rpms_ros.recording.rosbag.records import (
    Batch,
    Budget,
    ByteArray,
    Channel,
    Findings,
    Records,
    gather,
)

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


# Start and end time, size and checksum of the content, before the name of the compression.
_CHUNK_HEAD = 28
_LONGEST_HEAD = 4096
# A schema or channel as objects, without its texts [bytes].
_OBJECT = 1000
_Schema = tuple[str, str, str]


class McapFile:
    """An mcap file.

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
        If the file is empty or no mcap file.
    """

    def __init__(self, path: Path, findings: Findings, budget: Budget) -> None:
        self._path = path
        self._findings = findings
        self._budget = budget
        self._schemas: dict[int, _Schema] = {0: ('', '', '')}
        self.channels: dict[int, Channel] = {}
        self._count = 0
        size = path.stat().st_size
        with path.open('rb') as file:
            magic = file.read(len(MAGIC))
        if magic != MAGIC:
            found = repr(magic) if magic else 'an empty file'
            raise RecordingError(f'expected an mcap file at {path}, got {found}')
        self._data: ByteArray = np.asarray(np.memmap(path, np.uint8, 'r', shape=(size,)))

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""
        frame = walk(self._data, len(MAGIC))
        after = 0
        chunks = np.flatnonzero(frame.kind == CHUNK).tolist()
        for chunk in chunks:
            yield from self._messages(self._data, frame.part(after, chunk))
            yield from self._chunk(int(frame.start[chunk]), int(frame.end[chunk]))
            after = chunk + 1
        yield from self._messages(self._data, frame.part(after, len(frame.kind)))
        if frame.ends_file(self._data):
            self._check_end(frame, chunked=bool(chunks))
        else:
            yield from self._cut_off(frame.stop)

    def _cut_off(self, stop: int) -> Iterator[Batch]:
        lost = len(self._data) - stop
        self._findings.add(
            'truncated_file', f'{self._path.name} has no end: {lost} bytes from a cut-off record'
        )
        if lost > RECORD_HEAD + _CHUNK_HEAD and self._data[stop] == CHUNK:
            yield from self._chunk(stop + RECORD_HEAD, len(self._data), cut_off=True)

    def _chunk(self, start: int, end: int, cut_off: bool = False) -> Iterator[Batch]:
        try:
            content = self._unpacked(start, end, cut_off)
        except struct.error:
            self._findings.add('damaged_chunk', f'chunk at byte {start} has no head')
            return
        if content is not None:
            yield from self._messages(content, walk(content))

    def _unpacked(self, start: int, end: int, cut_off: bool) -> ByteArray | None:
        """Return the content of a chunk, or None where it must not be used."""
        self._budget.load(end - start, 'a chunk')
        # Read, not mapped: a mapped page costs more than its copy, and stays in memory.
        record = np.fromfile(self._path, np.uint8, end - start, offset=start)
        head = Content(record[:_LONGEST_HEAD].tobytes())
        head.position = 16
        size, checksum, compression = head.number('Q'), head.number('I'), head.text()
        packed_size = head.number('Q')
        packed = record[head.position : head.position + packed_size]
        if not compression:
            content = packed
        elif compression in DECOMPRESSORS:
            self._budget.unpack(size, f'a chunk of {len(packed)} bytes')
            content = np.frombuffer(unpacked(packed.tobytes(), compression, size), np.uint8)
        else:
            kinds = ', '.join(DECOMPRESSORS)
            raise RecordingError(
                f'expected a compression of {kinds} in {self._path.name}, got {compression!r}'
            )
        return content if self._is_usable(content, size, checksum, start, cut_off) else None

    def _is_usable(
        self, content: ByteArray, size: int, checksum: int, start: int, cut_off: bool
    ) -> bool:
        """Tell whether the content of a chunk can be used; note what is wrong with it."""
        fits = not checksum or crc32(content.data) == checksum
        if len(content) < size or (fits and len(content) > size):
            if not cut_off:
                found = f'{len(content)} of {size} bytes are readable'
                self._findings.add('damaged_chunk', f'chunk at byte {start}: {found}')
            # Of a chunk that ends early, the beginning is all that there is.
            return True
        if not fits:
            self._findings.add(
                'damaged_chunk', f'chunk at byte {start} left out: its checksum does not fit'
            )
        return fits

    def _messages(self, data: ByteArray, frame: Frame) -> Iterator[Batch]:
        for kind, add in ((SCHEMA, self._add_schema), (CHANNEL, self._add_channel)):
            for start, end in frame.of_kind(kind):
                try:
                    add(Content(data[start:end].tobytes()))
                except struct.error:
                    self._findings.add(
                        'damaged_record',
                        f'{self._path.name}: a schema or channel of {end - start} bytes left out',
                    )
        batch = messages_of(data, frame)
        if len(batch):
            self._count += len(batch)
            yield batch

    def _add_schema(self, content: Content) -> None:
        number, name = content.number('H'), content.text()
        encoding, text = content.text(), content.text()
        found = (name, encoding, text)
        if self._schemas.get(number) != found:
            self._budget.hold(_OBJECT + len(name) + len(text))
            self._schemas[number] = found

    def _add_channel(self, content: Content) -> None:
        number, schema = content.number('H'), content.number('H')
        topic, serialization = content.text(), content.text()
        name, encoding, text = self._schemas.get(schema, ('', '', ''))
        found = Channel(topic, name, text, encoding, serialization)
        if self.channels.get(number) != found:
            self._budget.hold(_OBJECT + len(topic))
            self.channels[number] = found

    def _check_end(self, frame: Frame, chunked: bool) -> None:
        """Compare what was read with the checksums and the count at the end of the file."""
        end = end_of(self._data, frame)
        if not end.summary_fits:
            self._findings.add(
                'wrong_checksum', f'the checksum of the index of {self._path.name} does not fit'
            )
        elif end.message_count not in (None, self._count) and not self._findings.counts:
            self._findings.add(
                'wrong_count',
                f'{self._path.name} states {end.message_count} messages, got {self._count}',
            )
        # What is in chunks has been checked chunk by chunk.
        if not chunked and not data_fits(self._data, frame):
            self._findings.add('wrong_checksum', f'the checksum of {self._path.name} does not fit')


LIBRARY = 'rpms_ros'
_COMPRESSIONS = {
    '': CompressionType.NONE,
    'lz4': CompressionType.LZ4,
    'zstd': CompressionType.ZSTD,
}
_CHUNK_SIZE = 1 << 20


class McapFileWriter:
    """Writer of one mcap file.

    Parameters
    ----------
    path : Path
        File that does not exist yet.
    compression : str
        Empty, ``lz4`` or ``zstd``: how chunks are packed.
    """

    suffix = '.mcap'

    def __init__(self, path: Path, compression: str = '') -> None:
        self._file = WholeWrites(path)
        self._writer = Writer(
            cast(IO[Any], self._file),
            chunk_size=_CHUNK_SIZE,
            compression=_COMPRESSIONS[compression],
            enable_data_crcs=True,
        )
        self._schemas: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._writer.start('ros2', LIBRARY)

    def add_topic(self, topic: TopicEntry) -> int:
        """Return the number of a new topic."""
        channel = topic.channel
        if channel.type_name not in self._schemas:
            self._schemas[channel.type_name] = self._writer.register_schema(
                channel.type_name, channel.definition_encoding, channel.definition.encode()
            )
        notes = {'offered_qos_profiles': qos_text(topic.qos), 'topic_type_hash': topic.digest}
        number = self._writer.register_channel(
            channel.topic, channel.serialization, self._schemas[channel.type_name], notes
        )
        self._counts[number] = 0
        return number

    def append(self, topic: int, time_ns: int, message: bytes | memoryview) -> None:
        """Take one message; it is written with its chunk, with the next `flush` at the latest."""
        self._writer.add_message(
            topic, time_ns, cast(bytes, message), time_ns, self._counts[topic] % 2**32
        )
        self._counts[topic] += 1

    def flush(self) -> None:
        """Write the chunk that was begun."""
        self._writer.flush()

    def finish(self, metadata: str) -> None:
        """Write the metadata and the index, and close the file."""
        try:
            self._writer.flush()
            self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
            self._writer.finish()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, without its end: readers then see that something is missing."""
        self._file.close()


class WholeWrites:
    """A file that takes each write as a whole or, if the device refuses it, not at all.

    Unbuffered: what was written is with the operating system, and survives a killed process.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)

    def write(self, content: bytes) -> int:
        """Write all of it or, if the device refuses, nothing."""
        begin = self._file.tell()
        view = memoryview(content)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), begin)
                self._file.seek(begin)
            raise
        return len(content)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self._file.tell()

    def flush(self) -> None:
        """Do nothing: nothing is buffered."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()
