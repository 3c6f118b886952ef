"""A sqlite3 file of rosbag2; what was committed survives a killed writer."""

import sqlite3
from pathlib import Path

from rpms_ros.recording.batches import Batch
from rpms_ros.recording.records import Channel

# The tables of rosbag2's version 4 and, behind them, who wrote them.
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
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
INSERT INTO schema VALUES (4, 'jazzy');
"""


class SqliteFileWriter:
    """Writer of one sqlite3 file.

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

    def add_channel(self, channel: Channel, digest: str) -> int:
        """Return the number of a new topic."""
        if channel.type_name not in self._types:
            self._types.add(channel.type_name)
            self._connection.execute(
                'INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, ?)',
                (channel.type_name, channel.definition_encoding, channel.definition, digest),
            )
        cursor = self._connection.execute(
            'INSERT INTO topics VALUES (NULL, ?, ?, ?, ?, ?)',
            (channel.topic, channel.type_name, channel.serialization, '', digest),
        )
        self._connection.commit()
        return int(cursor.lastrowid or 0)

    def write(self, batch: Batch) -> None:
        """Write messages and commit them."""
        records = batch.records
        view = records.buffer.data
        places = zip(records.start.tolist(), records.end.tolist(), strict=True)
        rows = zip(
            batch.topic.tolist(),
            records.time_ns.tolist(),
            (view[start:end] for start, end in places),
            strict=True,
        )
        self._connection.executemany('INSERT INTO messages VALUES (NULL, ?, ?, ?)', rows)
        self._connection.commit()

    def close(self, metadata: str, version: int = 9) -> None:
        """Write index and metadata, and close the file."""
        try:
            self._connection.execute(
                'INSERT INTO metadata VALUES (NULL, ?, ?)', (version, metadata)
            )
            self._connection.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
            self._connection.commit()
            # One file at rest, as ros2 bag leaves it.
            self._connection.execute('PRAGMA journal_mode = DELETE')
        finally:
            self._connection.close()
