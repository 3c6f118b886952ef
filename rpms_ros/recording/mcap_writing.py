# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An mcap file, written by the mcap library with every checksum that the format has."""

import os
from contextlib import suppress
from pathlib import Path
from typing import IO
from typing import Any
from typing import cast

from mcap.writer import CompressionType
from mcap.writer import Writer

from rpms_ros.recording.mcap_records import PUBLISHER
from rpms_ros.recording.metadata import TopicEntry
from rpms_ros.recording.metadata import qos_text

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
        if channel.publisher:
            notes[PUBLISHER] = channel.publisher
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
