# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics and raw messages of a sqlite3 file of rosbag2, complete, hot or cut off."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import apsw

from rpms_ros.errors import RecordingError
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.budget import Budget
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.records import Channel
from rpms_ros.recording.sqlite_batches import batches

MAGIC = b'SQLite format 3\0'
JOURNALS = ('-journal', '-wal')
# A topic as objects, without its texts [bytes].
_ROW = 1000


class SqliteFile:
    """A sqlite3 file of rosbag2.

    A writer that was killed leaves a journal: the last whole state needs it.  Recovery writes,
    so it is done on a copy, and the recording stays as it was.

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
        Channels by number; empty before the first batch was asked for.

    Raises
    ------
    RecordingError
        If the file is empty, no sqlite3 file, or not one of rosbag2.
    """

    def __init__(self, path: Path, findings: Findings, budget: Budget) -> None:
        self._path = path
        self._findings = findings
        self._budget = budget
        self.channels: dict[int, Channel] = {}
        with path.open('rb') as file:
            magic = file.read(len(MAGIC))
        if magic != MAGIC:
            found = repr(magic) if magic else 'an empty file'
            raise RecordingError(f'expected a sqlite3 file at {path}, got {found}')

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""
        hot = [name for name in JOURNALS if _size(_beside(self._path, name))]
        size, promised = _size(self._path), _promised_size(self._path)
        if not hot and size >= promised:
            yield from self._read(f'{self._path.resolve().as_uri()}?mode=ro&immutable=1')
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, self._path.name)
            shutil.copyfile(self._path, copy)
            if hot:
                self._findings.add(
                    'hot_journal',
                    f'{self._path.name} was not closed: recovered from its {hot[0][1:]}',
                )
                for name in hot:
                    shutil.copyfile(_beside(self._path, name), _beside(copy, name))
            else:
                self._findings.add(
                    'truncated_file', f'{self._path.name} has {size} of {promised} bytes'
                )
                # Half a page would read as messages full of zeros.
                os.truncate(copy, size - size % _page_size(self._path))
            yield from self._read(copy.as_uri(), cut_off=not hot)

    def _read(self, uri: str, cut_off: bool = False) -> Iterator[Batch]:
        flags = apsw.SQLITE_OPEN_READWRITE | apsw.SQLITE_OPEN_URI
        try:
            with closing(apsw.Connection(uri, flags)) as connection:
                if cut_off:
                    # Lets SQLite open a file that is shorter than its header says.
                    connection.execute('PRAGMA writable_schema = ON')
                _expect_tables(connection)
                self.channels = _channels(connection, self._budget)
                if not cut_off and not _is_finished(connection):
                    self._findings.add(
                        'truncated_file', f'{self._path.name} has no end: its writer stopped'
                    )
                yield from self._messages(connection)
        except (apsw.Error, TypeError, ValueError) as error:
            raise RecordingError(
                f'expected tables of rosbag2 in {self._path}, got {error}'
            ) from error

    def _messages(self, connection: apsw.Connection) -> Iterator[Batch]:
        try:
            yield from batches(connection)
        except (apsw.Error, ValueError) as error:
            self._findings.add(
                'truncated_file', f'{self._path.name} cannot be read to its end: {error}'
            )


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _page_size(path: Path) -> int:
    """Return the page size that the header states [bytes]; 1 stands for 65536."""
    with path.open('rb') as file:
        size = int.from_bytes(file.read(18)[16:], 'big')
    return 65536 if size < 2 else size


def _promised_size(path: Path) -> int:
    """Return the size of the file that the header states [bytes]."""
    with path.open('rb') as file:
        return int.from_bytes(file.read(32)[28:], 'big') * _page_size(path)


def _expect_tables(connection: apsw.Connection) -> None:
    """Refuse views and virtual tables, which may have rows without end."""
    kinds = dict(connection.execute('SELECT name, type FROM sqlite_master ORDER BY type'))
    virtual = [
        name
        for (name,) in connection.execute(
            "SELECT name FROM sqlite_master WHERE sql LIKE 'create virtual%'"
        )
    ]
    for name in ('topics', 'messages', 'message_definitions', 'publishers', 'metadata', 'schema'):
        if kinds.get(name, 'table') != 'table' or name in virtual:
            raise apsw.SQLError(f'{name} is no plain table')


def _is_finished(connection: apsw.Connection) -> bool:
    """Tell whether the writer came to its end, where it says so behind the last message."""
    tables = {name for (name,) in connection.execute('SELECT name FROM sqlite_master')}
    return 'metadata' not in tables or bool(
        connection.execute('SELECT count(*) FROM metadata').fetchall()[0][0]
    )


def _channels(connection: apsw.Connection, budget: Budget) -> dict[int, Channel]:
    definitions: dict[str, tuple[str, str]] = {}
    tables = {name for (name,) in connection.execute('SELECT name FROM sqlite_master')}
    if 'message_definitions' in tables:
        query = 'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions'
        definitions = {
            name: (text, encoding) for name, text, encoding in _rows(connection, query, budget)
        }
    publishers: dict[int, str] = {}
    if 'publishers' in tables:
        query = (
            "SELECT topic_id, identity FROM publishers WHERE typeof(identity) = 'text' "
            'AND topic_id IN (SELECT id FROM topics)'
        )
        publishers = dict(_rows(connection, query, budget))
    query = 'SELECT id, name, type, serialization_format FROM topics'
    return {
        number: Channel(
            topic,
            kind,
            *definitions.get(kind, ('', 'ros2msg')),
            serialization,
            publishers.get(number, ''),
        )
        for number, topic, kind, serialization in _rows(connection, query, budget)
    }


def _rows(connection: apsw.Connection, query: str, budget: Budget) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a query, each of which is kept; a row costs more than its texts."""
    for row in connection.execute(query):
        budget.hold(_ROW + sum(len(value) for value in row if isinstance(value, str | bytes)))
        yield row
