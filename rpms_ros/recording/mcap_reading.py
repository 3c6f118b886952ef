# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Channels and raw messages of an mcap file, complete or cut off."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording import mcap_records as mcap
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.budget import Budget
from rpms_ros.recording.compression import DECOMPRESSORS
from rpms_ros.recording.compression import unpacked
from rpms_ros.recording.crc import crc32
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.mcap_records import PUBLISHER
from rpms_ros.recording.mcap_records import RECORD_HEAD
from rpms_ros.recording.mcap_records import Content
from rpms_ros.recording.mcap_records import Frame
from rpms_ros.recording.mcap_records import messages_of
from rpms_ros.recording.mcap_records import walk
from rpms_ros.recording.records import ByteArray
from rpms_ros.recording.records import Channel

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
            magic = file.read(len(mcap.MAGIC))
        if magic != mcap.MAGIC:
            found = repr(magic) if magic else 'an empty file'
            raise RecordingError(f'expected an mcap file at {path}, got {found}')
        self._data: ByteArray = np.asarray(np.memmap(path, np.uint8, 'r', shape=(size,)))

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""
        frame = walk(self._data, len(mcap.MAGIC))
        after = 0
        chunks = np.flatnonzero(frame.kind == mcap.CHUNK).tolist()
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
        if lost > RECORD_HEAD + _CHUNK_HEAD and self._data[stop] == mcap.CHUNK:
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
        for kind, add in ((mcap.SCHEMA, self._add_schema), (mcap.CHANNEL, self._add_channel)):
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
        publisher = _publisher(content)
        found = Channel(topic, name, text, encoding, serialization, publisher)
        if self.channels.get(number) != found:
            self._budget.hold(_OBJECT + len(topic) + len(publisher))
            self.channels[number] = found

    def _check_end(self, frame: Frame, chunked: bool) -> None:
        """Compare what was read with the checksums and the count at the end of the file."""
        end = mcap.end_of(self._data, frame)
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
        if not chunked and not mcap.data_fits(self._data, frame):
            self._findings.add('wrong_checksum', f'the checksum of {self._path.name} does not fit')


def _publisher(content: Content) -> str:
    """Return the identity in the notes of a channel, empty if there is none."""
    try:
        end = content.number('I') + content.position
        while content.position < end:
            name, value = content.text(), content.text()
            if name == PUBLISHER:
                return value
    except struct.error:
        # Notes that are cut short: the channel can be used without them.
        pass
    return ''
