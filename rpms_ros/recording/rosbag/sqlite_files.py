# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics and messages of a sqlite3 file of rosbag2, complete, hot or cut off."""

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import IntArray
from rpms_ros.recording.rosbag.records import Batch, Budget, Channel, Records, StorageFile


def batches(connection: sqlite3.Connection) -> Iterator[Batch]:
    """Yield messages in the order of their ids.

    What is not of its type cannot be decoded, or belongs nowhere.

    Raises
    ------
    sqlite3.Error
        Where the file is damaged, after what comes before it.
    """
    cursor = connection.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
    failure: sqlite3.Error | None = None
    while failure is None:
        rows: list[tuple[Any, ...]] = []
        try:
            rows.extend(islice(cursor, 8192))
        except sqlite3.Error as error:
            failure = error
        if rows:
            topics, times, messages = zip(*rows, strict=True)
            data = [message if isinstance(message, bytes) else b'' for message in messages]
            yield _whole(topics), Records.of(data, _whole(times))
        elif failure is None:
            return
    raise failure


def _whole(values: tuple[Any, ...]) -> IntArray:
    return np.array([value if isinstance(value, int) else -1 for value in values], np.int64)


_JOURNALS = ('-journal', '-wal')
_TABLES_READ = 'topics', 'messages', 'message_definitions', 'metadata', 'schema'
# A topic as objects, without its texts [bytes].
_ROW = 1000


class SqliteFile(StorageFile):
    """A sqlite3 file of rosbag2; its channels are known once the first batch was asked for.

    A writer that was killed leaves a journal: the last whole state needs it.  Recovery writes,
    so it is done on a copy, and the recording stays as it was.
    """

    kind, magic = 'a sqlite3', b'SQLite format 3\0'

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file; it may turn out to be none of rosbag2."""
        with self._path.open('rb') as file:
            head = file.read(32)
        page_size = int.from_bytes(head[16:18], 'big')
        # 1 stands for 65536.
        page_size = 65536 if page_size < 2 else page_size
        promised_size = int.from_bytes(head[28:], 'big') * page_size
        journals = [self._path.with_name(self._path.name + name) for name in _JOURNALS]
        hot = [path for path in journals if path.exists() and path.stat().st_size]
        size = self._path.stat().st_size
        if not hot and size >= promised_size:
            yield from self._read(f'{self._path.resolve().as_uri()}?mode=ro&immutable=1')
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, self._path.name)
            for path in (self._path, *hot):
                shutil.copyfile(path, copy.with_name(path.name))
            if hot:
                suffix = hot[0].name.rpartition('-')[2]
                found = f'{self._path.name} was not closed: recovered from its {suffix}'
                self._findings.add('hot_journal', found)
            else:
                found = f'{self._path.name} has {size} of {promised_size} bytes'
                self._findings.add('truncated_file', found)
                # Half a page would read as messages full of zeros.
                os.truncate(copy, size - size % page_size)
            yield from self._read(copy.as_uri(), cut_off=not hot)

    def _read(self, uri: str, cut_off: bool = False) -> Iterator[Batch]:
        name = self._path.name
        try:
            with closing(sqlite3.connect(uri, uri=True)) as connection:
                if cut_off:
                    # Lets SQLite open a file that is shorter than its header says.
                    connection.execute('PRAGMA writable_schema = ON')
                tables = _tables(connection)
                self.channels = _channels(connection, tables, self._budget)
                if 'metadata' in tables and not cut_off:
                    # The writer puts them behind the last message.
                    ((count,),) = connection.execute('SELECT count(*) FROM metadata')
                    if not count:
                        found = f'{name} has no end: its writer stopped'
                        self._findings.add('truncated_file', found)
                try:
                    yield from batches(connection)
                except (sqlite3.Error, ValueError) as error:
                    found = f'{name} cannot be read to its end: {error}'
                    self._findings.add('truncated_file', found)
        except (sqlite3.Error, TypeError, ValueError) as error:
            fault = f'expected tables of rosbag2 in {self._path}, got {error}'
            raise RecordingError(fault) from error


def _tables(connection: sqlite3.Connection) -> set[str]:
    """Return the names of all tables; refuse views and virtual ones, which may never end."""
    virtual = "coalesce(sql, '') LIKE 'create virtual%'"
    found = list(connection.execute(f'SELECT name, type, {virtual} FROM sqlite_master'))
    for name, kind, is_virtual in found:
        if name in _TABLES_READ and (kind != 'table' or is_virtual):
            raise sqlite3.DatabaseError(f'{name} is no plain table')
    return {name for name, _, _ in found}


def _channels(
    connection: sqlite3.Connection, tables: set[str], budget: Budget
) -> dict[int, Channel]:
    definitions: dict[str, tuple[str, str]] = {}
    if 'message_definitions' in tables:
        query = 'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions'
        definitions = {name: (text, how) for name, text, how in _rows(connection, query, budget)}
    query = 'SELECT id, name, type, serialization_format FROM topics'
    return {
        number: Channel(topic, kind, *definitions.get(kind, ('', 'ros2msg')), serialization)
        for number, topic, kind, serialization in _rows(connection, query, budget)
    }


def _rows(connection: sqlite3.Connection, query: str, budget: Budget) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a query, each of which is kept; a row costs more than its texts."""
    for row in connection.execute(query):
        budget.hold(_ROW + sum(len(value) for value in row if isinstance(value, str | bytes)))
        yield row
