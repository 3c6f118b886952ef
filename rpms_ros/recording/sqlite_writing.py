# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sqlite3 file of rosbag2; what was committed survives a killed writer."""

import sqlite3
from contextlib import suppress
from pathlib import Path

from rpms_ros.recording.metadata import VERSION
from rpms_ros.recording.metadata import TopicEntry
from rpms_ros.recording.metadata import qos_text

# The tables of rosbag2's version 4, besides who published, and behind them who wrote them.
_TABLES = """
PRAGMA journal_mode = WAL;
PRAGMA synchronous = NORMAL;
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
  id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
  id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE publishers(topic_id INTEGER PRIMARY KEY, identity TEXT NOT NULL);
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
INSERT INTO schema VALUES (4, 'jazzy');
"""
# About a megabyte of force samples in one transaction.
_MOST_WAITING = 8192


class SqliteFileWriter:
    """Writer of one sqlite3 file.

    rosbags' writer commits only at its end: a killed process would leave nothing.

    Parameters
    ----------
    path : Path
        File that does not exist yet.
    """

    suffix = '.db3'

    def __init__(self, path: Path, _compression: str = '') -> None:
        self._connection = sqlite3.connect(path, check_same_thread=False)
        self._connection.executescript(_TABLES)
        self._types: set[str] = set()
        self._waiting: list[tuple[int, int, bytes | memoryview]] = []

    def add_topic(self, topic: TopicEntry) -> int:
        """Return the number of a new topic."""
        channel = topic.channel
        if channel.type_name not in self._types:
            self._types.add(channel.type_name)
            self._connection.execute(
                'INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, ?)',
                (channel.type_name, channel.definition_encoding, channel.definition, topic.digest),
            )
        cursor = self._connection.execute(
            'INSERT INTO topics VALUES (NULL, ?, ?, ?, ?, ?)',
            (
                channel.topic,
                channel.type_name,
                channel.serialization,
                qos_text(topic.qos),
                topic.digest,
            ),
        )
        number = int(cursor.lastrowid or 0)
        if channel.publisher:
            row = (number, channel.publisher)
            self._connection.execute('INSERT INTO publishers VALUES (?, ?)', row)
        self._connection.commit()
        return number

    def append(self, topic: int, time_ns: int, message: bytes | memoryview) -> None:
        """Take one message; it is written with the next `flush`, or earlier if many wait."""
        self._waiting.append((topic, time_ns, message))
        if len(self._waiting) >= _MOST_WAITING:
            self.flush()

    def flush(self) -> None:
        """Write what waits, and commit it."""
        waiting, self._waiting = self._waiting, []
        self._connection.executemany('INSERT INTO messages VALUES (NULL, ?, ?, ?)', waiting)
        self._connection.commit()

    def finish(self, metadata: str) -> None:
        """Write what waits, the metadata and the index, and close the file."""
        try:
            self.flush()
            self._connection.execute(
                'INSERT INTO metadata VALUES (NULL, ?, ?)', (VERSION, metadata)
            )
            self._connection.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
            self._connection.commit()
            # One file at rest, as ros2 bag leaves it.
            self._connection.execute('PRAGMA journal_mode = DELETE')
        finally:
            self._connection.close()

    def abandon(self) -> None:
        """Close the file without metadata: readers then see that something is missing."""
        with suppress(sqlite3.Error):
            self._connection.close()
