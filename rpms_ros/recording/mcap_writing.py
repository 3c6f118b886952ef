"""An mcap file, written chunk by chunk; whatever reached the disk can be read again."""

import struct
from contextlib import suppress
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
        # Unbuffered: what was written is with the operating system, and nothing is half written.
        self._file = path.open('xb', buffering=0)
        self._position = 0
        self._compression = compression
        self._schemas: dict[str, bytes] = {}
        self._channels: list[bytes] = []
        self._counts: list[int] = []
        self._chunk_indexes: list[bytes] = []
        self._times: list[tuple[int, int]] = []
        self._put(mcap.MAGIC + _record(mcap.HEADER, _text('ros2') + _text(LIBRARY)))

    def _put(self, content: bytes) -> None:
        """Write all of it or, if the device refuses, nothing."""
        view = memoryview(content)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            with suppress(OSError):
                self._file.truncate(self._position)
                self._file.seek(self._position)
            raise
        self._position += len(content)

    def add_channel(self, channel: Channel, _digest: str) -> int:
        """Return the number of a new topic."""
        if channel.type_name not in self._schemas:
            content = struct.pack('<H', len(self._schemas) + 1) + b''.join(
                map(_text, (channel.type_name, channel.definition_encoding, channel.definition))
            )
            self._schemas[channel.type_name] = _record(mcap.SCHEMA, content)
            self._put(self._schemas[channel.type_name])
        number = len(self._channels) + 1
        schema = list(self._schemas).index(channel.type_name) + 1
        content = struct.pack('<HH', number, schema)
        content += _text(channel.topic) + _text(channel.serialization)
        content += _block(_text('offered_qos_profiles') + _text(''))
        self._channels.append(_record(mcap.CHANNEL, content))
        self._counts.append(0)
        self._put(self._channels[-1])
        return number

    def write(self, batch: Batch) -> None:
        """Write messages as one chunk."""
        content, offset = _message_records(batch)
        times = int(batch.records.time_ns.min()), int(batch.records.time_ns.max())
        packed = COMPRESSORS[self._compression](content)
        head = struct.pack('<QQQI', *times, len(content), 0) + _text(self._compression)
        chunk = _record(mcap.CHUNK, head + struct.pack('<Q', len(packed)) + packed)
        chunk_at = self._position
        index_at = chunk_at + len(chunk)
        indexes, places = _message_indexes(batch, offset, index_at)
        self._put(chunk + indexes)
        for number, count in zip(*np.unique(batch.topic, return_counts=True), strict=True):
            self._counts[number - 1] += int(count)
        self._times.append(times)
        self._chunk_indexes.append(
            _record(
                mcap.CHUNK_INDEX,
                struct.pack('<QQQQ', *times, chunk_at, len(chunk))
                + _block(places)
                + struct.pack('<Q', len(indexes))
                + _text(self._compression)
                + struct.pack('<QQ', len(packed), len(content)),
            )
        )

    def close(self, metadata: str) -> None:
        """Write what lets a reader find its way, and close the file."""
        try:
            self._put(self._summary(metadata))
        finally:
            self._file.close()

    def _summary(self, metadata: str) -> bytes:
        begin = self._position
        inner = _text('serialized_metadata') + _text(metadata)
        content = _record(mcap.METADATA, _text('rosbag2') + _block(inner))
        index = struct.pack('<QQ', begin, len(content)) + _text('rosbag2')
        content += _record(mcap.DATA_END, struct.pack('<I', 0))
        start = begin + len(content)
        groups = {
            mcap.SCHEMA: b''.join(self._schemas.values()),
            mcap.CHANNEL: b''.join(self._channels),
            mcap.CHUNK_INDEX: b''.join(self._chunk_indexes),
            mcap.METADATA_INDEX: _record(mcap.METADATA_INDEX, index),
            mcap.STATISTICS: _record(mcap.STATISTICS, self._statistics()),
        }
        offsets = b''
        for kind, group in groups.items():
            place = struct.pack('<BQQ', kind, begin + len(content), len(group))
            offsets += _record(mcap.SUMMARY_OFFSET, place) if group else b''
            content += group
        footer = struct.pack('<QQI', start, begin + len(content), 0)
        return content + offsets + _record(mcap.FOOTER, footer) + mcap.MAGIC

    def _statistics(self) -> bytes:
        first = min((first for first, _ in self._times), default=0)
        last = max((last for _, last in self._times), default=0)
        counts = b''.join(
            struct.pack('<HQ', number + 1, count) for number, count in enumerate(self._counts)
        )
        head = (sum(self._counts), len(self._schemas), len(self._channels), 0, 1)
        return struct.pack('<QHIIIIQQ', *head, len(self._times), first, last) + _block(counts)


def _message_records(batch: Batch) -> tuple[bytes, IntArray]:
    """Return the content of a chunk, and where its messages begin (messages,)."""
    records = batch.records
    length = records.end - records.start
    end = np.cumsum(length + _HEAD)
    offset = end - length - _HEAD
    content = np.empty(int(end[-1]), np.uint8)
    head = np.empty(len(batch), _MESSAGE)
    head['kind'] = mcap.MESSAGE
    head['size'] = length + mcap.MESSAGE_HEAD
    head['topic'] = batch.topic
    head['sequence'] = 0
    head['logged'] = head['published'] = records.time_ns
    windows(content, f'V{_HEAD}')[offset] = head.view(f'V{_HEAD}')
    copied(records, content, offset + _HEAD)
    return content.tobytes(), offset


def _message_indexes(batch: Batch, offset: IntArray, position: int) -> tuple[bytes, bytes]:
    """Return one index record a topic, and where each is if they begin at `position`."""
    indexes = places = b''
    for number in np.unique(batch.topic).tolist():
        chosen = batch.topic == number
        entries = np.column_stack((batch.records.time_ns[chosen], offset[chosen]))
        places += struct.pack('<HQ', number, position + len(indexes))
        content = struct.pack('<H', number) + _block(entries.astype('<u8').tobytes())
        indexes += _record(mcap.MESSAGE_INDEX, content)
    return indexes, places


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(content)) + content


def _block(content: bytes) -> bytes:
    return struct.pack('<I', len(content)) + content


def _text(text: str) -> bytes:
    return _block(text.encode())
