"""Channels and raw messages of an mcap file, complete or cut off."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.compression import COMPRESSORS
from rpms_ros.recording.compression import unpacked
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.mcap_records import CHANNEL
from rpms_ros.recording.mcap_records import CHUNK
from rpms_ros.recording.mcap_records import FOOTER
from rpms_ros.recording.mcap_records import MAGIC
from rpms_ros.recording.mcap_records import RECORD_HEAD
from rpms_ros.recording.mcap_records import SCHEMA
from rpms_ros.recording.mcap_records import Content
from rpms_ros.recording.mcap_records import Frame
from rpms_ros.recording.mcap_records import messages_of
from rpms_ros.recording.mcap_records import walk
from rpms_ros.recording.records import ByteArray
from rpms_ros.recording.records import Channel

# Start and end time, size and checksum of the content, before the name of the compression.
_CHUNK_HEAD = 28
_LONGEST_HEAD = 4096
_Schema = tuple[str, str, str]


class McapFile:
    """An mcap file.

    Parameters
    ----------
    path : Path
        The file.
    findings : Findings
        Where faults are noted.

    Raises
    ------
    RecordingError
        If the file is empty or no mcap file.
    """

    def __init__(self, path: Path, findings: Findings) -> None:
        self._path = path
        self._findings = findings
        self._schemas: dict[int, _Schema] = {0: ('', '', '')}
        self.channels: dict[int, Channel] = {}
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
        for chunk in np.flatnonzero(frame.kind == CHUNK).tolist():
            yield from self._messages(self._data, frame.part(after, chunk))
            yield from self._chunk(int(frame.start[chunk]), int(frame.end[chunk]))
            after = chunk + 1
        yield from self._messages(self._data, frame.part(after, len(frame.kind)))
        if not len(frame.kind) or frame.kind[-1] != FOOTER:
            yield from self._cut_off(frame.stop)

    def _cut_off(self, stop: int) -> Iterator[Batch]:
        lost = len(self._data) - stop
        self._findings.add(
            'truncated_file', f'{self._path.name} has no end: {lost} bytes from a cut-off record'
        )
        if lost > RECORD_HEAD + _CHUNK_HEAD and self._data[stop] == CHUNK:
            yield from self._chunk(stop + RECORD_HEAD, len(self._data))

    def _chunk(self, start: int, end: int) -> Iterator[Batch]:
        try:
            content = self._unpacked(start, end)
        except struct.error:
            self._findings.add('damaged_chunk', f'chunk at byte {start} has no head')
            return
        if content is not None:
            yield from self._messages(content, walk(content))

    def _unpacked(self, start: int, end: int) -> ByteArray | None:
        """Return the content of a chunk, or None where it must not be used."""
        # Read, not mapped: a mapped page costs more than its copy, and stays in memory.
        record = np.fromfile(self._path, np.uint8, end - start, offset=start)
        head = Content(record[:_LONGEST_HEAD].tobytes())
        head.position = 16
        size, checksum, compression = head.number('Q'), head.number('I'), head.text()
        packed_size = head.number('Q')
        if compression not in COMPRESSORS:
            kinds = ', '.join(filter(None, COMPRESSORS))
            raise RecordingError(
                f'expected a compression of {kinds} in {self._path.name}, got {compression!r}'
            )
        packed = record[head.position : head.position + packed_size]
        content = (
            np.frombuffer(unpacked(packed.tobytes(), compression), np.uint8)
            if compression
            else packed
        )
        if len(content) < size:
            self._findings.add(
                'damaged_chunk',
                f'chunk at byte {start}: {len(content)} of {size} bytes are readable',
            )
        elif checksum and zlib.crc32(content.data) != checksum:
            self._findings.add(
                'damaged_chunk', f'chunk at byte {start} left out: its checksum does not fit'
            )
            return None
        return content

    def _messages(self, data: ByteArray, frame: Frame) -> Iterator[Batch]:
        for start, end in frame.of_kind(SCHEMA):
            self._add_schema(Content(data[start:end].tobytes()))
        for start, end in frame.of_kind(CHANNEL):
            self._add_channel(Content(data[start:end].tobytes()))
        batch = messages_of(data, frame)
        if len(batch):
            yield batch

    def _add_schema(self, content: Content) -> None:
        number, name = content.number('H'), content.text()
        encoding, text = content.text(), content.text()
        self._schemas[number] = (name, encoding, text)

    def _add_channel(self, content: Content) -> None:
        number, schema = content.number('H'), content.number('H')
        topic, serialization = content.text(), content.text()
        name, encoding, text = self._schemas.get(schema, ('', '', ''))
        self.channels[number] = Channel(topic, name, text, encoding, serialization)
