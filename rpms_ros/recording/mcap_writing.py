"""An mcap file, written chunk by chunk; whatever reached the disk can be read again."""

import struct
from pathlib import Path

import numpy as np

from rpms_ros.pulses import IntArray
from rpms_ros.recording import mcap_records as mcap
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.batches import copied
from rpms_ros.recording.compression import COMPRESSORS
from rpms_ros.recording.records import Channel
from rpms_ros.recording.records import windows

LIBRARY = 'rpms_ros'
MESSAGES_PER_CHUNK = 8192
_MESSAGE = np.dtype(
    [
        ('kind', 'u1'),
        ('size', '<u8'),
        ('topic', '<u2'),
        ('sequence', '<u4'),
        ('logged', '<u8'),
        ('published', '<u8'),
    ]
)
_HEAD = _MESSAGE.itemsize


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
        self._file = path.open('xb')
        self._compression = compression
        self._schemas: dict[str, bytes] = {}
        self._channels: list[bytes] = []
        self._pending = b''
        self._counts: list[int] = []
        self._chunk_indexes: list[bytes] = []
        self._times: list[tuple[int, int]] = []
        self._file.write(mcap.MAGIC + _record(mcap.HEADER, _text('ros2') + _text(LIBRARY)))

    def add_channel(self, channel: Channel, _digest: str) -> int:
        """Return the number of a new topic."""
        if channel.type_name not in self._schemas:
            content = struct.pack('<H', len(self._schemas) + 1) + b''.join(
                map(_text, (channel.type_name, channel.definition_encoding, channel.definition))
            )
            self._schemas[channel.type_name] = _record(mcap.SCHEMA, content)
            self._pending += self._schemas[channel.type_name]
        number = len(self._channels) + 1
        schema = list(self._schemas).index(channel.type_name) + 1
        content = struct.pack('<HH', number, schema)
        content += _text(channel.topic) + _text(channel.serialization)
        content += _block(_text('offered_qos_profiles') + _text(''))
        self._channels.append(_record(mcap.CHANNEL, content))
        self._counts.append(0)
        self._pending += self._channels[-1]
        return number

    def write(self, batch: Batch) -> None:
        """Write messages and hand them to the operating system."""
        for begin in range(0, len(batch), MESSAGES_PER_CHUNK):
            self._write_chunk(batch.part(begin, begin + MESSAGES_PER_CHUNK))
        self._file.flush()

    def _write_chunk(self, batch: Batch) -> None:
        content, offset = _message_records(batch, self._pending)
        self._pending = b''
        times = int(batch.records.time_ns.min()), int(batch.records.time_ns.max())
        packed = COMPRESSORS[self._compression](content)
        head = struct.pack('<QQQI', *times, len(content), 0) + _text(self._compression)
        chunk_at = self._file.tell()
        size = len(head) + 8 + len(packed)
        self._file.write(struct.pack('<BQ', mcap.CHUNK, size) + head)
        self._file.write(struct.pack('<Q', len(packed)))
        self._file.write(packed)
        index_at = self._file.tell()
        places = self._write_message_indexes(batch, offset)
        self._times.append(times)
        self._chunk_indexes.append(
            _record(
                mcap.CHUNK_INDEX,
                struct.pack('<QQQQ', *times, chunk_at, index_at - chunk_at)
                + _block(places)
                + struct.pack('<Q', self._file.tell() - index_at)
                + _text(self._compression)
                + struct.pack('<QQ', len(packed), len(content)),
            )
        )

    def _write_message_indexes(self, batch: Batch, offset: IntArray) -> bytes:
        """Write one index a topic; return where they are."""
        places = b''
        for number in np.unique(batch.topic).tolist():
            chosen = batch.topic == number
            entries = np.column_stack((batch.records.time_ns[chosen], offset[chosen]))
            places += struct.pack('<HQ', number, self._file.tell())
            content = struct.pack('<H', number) + _block(entries.astype('<u8').tobytes())
            self._file.write(_record(mcap.MESSAGE_INDEX, content))
            self._counts[number - 1] += int(chosen.sum())
        return places

    def close(self, metadata: str) -> None:
        """Write what lets a reader find its way, and close the file."""
        try:
            if self._pending:
                self._file.write(self._pending)
            self._write_summary(metadata)
        finally:
            self._file.close()

    def _write_summary(self, metadata: str) -> None:
        begin = self._file.tell()
        inner = _text('serialized_metadata') + _text(metadata)
        content = _record(mcap.METADATA, _text('rosbag2') + _block(inner))
        index = struct.pack('<QQ', begin, len(content)) + _text('rosbag2')
        self._file.write(content + _record(mcap.DATA_END, struct.pack('<I', 0)))
        start = self._file.tell()
        groups = {
            mcap.SCHEMA: b''.join(self._schemas.values()),
            mcap.CHANNEL: b''.join(self._channels),
            mcap.CHUNK_INDEX: b''.join(self._chunk_indexes),
            mcap.METADATA_INDEX: _record(mcap.METADATA_INDEX, index),
            mcap.STATISTICS: _record(mcap.STATISTICS, self._statistics()),
        }
        offsets = b''
        for kind, group in groups.items():
            place = struct.pack('<BQQ', kind, self._file.tell(), len(group))
            offsets += _record(mcap.SUMMARY_OFFSET, place) if group else b''
            self._file.write(group)
        footer = struct.pack('<QQI', start, self._file.tell(), 0)
        self._file.write(offsets + _record(mcap.FOOTER, footer) + mcap.MAGIC)

    def _statistics(self) -> bytes:
        first = min((first for first, _ in self._times), default=0)
        last = max((last for _, last in self._times), default=0)
        counts = b''.join(
            struct.pack('<HQ', number + 1, count) for number, count in enumerate(self._counts)
        )
        head = (sum(self._counts), len(self._schemas), len(self._channels), 0, 1)
        return struct.pack('<QHIIIIQQ', *head, len(self._times), first, last) + _block(counts)


def _message_records(batch: Batch, before: bytes) -> tuple[bytes, IntArray]:
    """Return the content of a chunk, and where its messages begin (messages,)."""
    records = batch.records
    length = records.end - records.start
    end = len(before) + np.cumsum(length + _HEAD)
    offset = end - length - _HEAD
    content = np.empty(int(end[-1]), np.uint8)
    content[: len(before)] = np.frombuffer(before, np.uint8)
    head = np.empty(len(batch), _MESSAGE)
    head['kind'] = mcap.MESSAGE
    head['size'] = length + mcap.MESSAGE_HEAD
    head['topic'] = batch.topic
    head['sequence'] = 0
    head['logged'] = head['published'] = records.time_ns
    windows(content, f'V{_HEAD}')[offset] = head.view(f'V{_HEAD}')
    copied(records, content, offset + _HEAD)
    return content.tobytes(), offset


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(content)) + content


def _block(content: bytes) -> bytes:
    return struct.pack('<I', len(content)) + content


def _text(text: str) -> bytes:
    return _block(text.encode())
