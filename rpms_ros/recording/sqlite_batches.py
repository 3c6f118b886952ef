# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages out of a sqlite3 file, thousands at a time.

A row that becomes Python objects costs a microsecond.  Concatenated by SQLite, a batch is a few
objects: the data of all its rows in one, and their lengths, times, topics and ids as text.  Every
aggregate of a query sees the rows in the same order, whichever it is, and the ids tell it.  A
batch that does not add up, or is damaged, is read row by row.
"""

from collections.abc import Iterator
from itertools import islice
from typing import Any

import apsw
import numpy as np

from rpms_ros.pulses import IntArray
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.records import Records

_ROWS = 8192
_SINGLE_ROWS = 1000
# Larger batches, as of images beside the force, are read row by row.
_LARGEST = 1 << 25
_RANGE = 'FROM messages WHERE id BETWEEN ? AND ?'
_NEXT = 'SELECT min(id) FROM messages WHERE id > ?'
_PACKED = (
    "SELECT CAST(group_concat(data, '') AS BLOB), group_concat(length(data)), "
    f'group_concat(timestamp), group_concat(topic_id), group_concat(id) {_RANGE}'
)
_SINGLE = f'SELECT topic_id, timestamp, data {_RANGE} ORDER BY id'
_LAST_ID = 2**63 - 1


def batches(connection: apsw.Connection) -> Iterator[Batch]:
    """Yield messages in the order of their ids.

    Raises
    ------
    apsw.Error
        Where the file is damaged, after what comes before it.
    """
    begin = _one(connection, 'SELECT min(id) FROM messages')[0]
    while begin is not None:
        end = min(begin + _ROWS - 1, _LAST_ID)
        packed = _packed(connection, begin, end)
        if packed is None:
            yield from _singly(connection, begin, end)
        else:
            yield packed
        begin = _one(connection, _NEXT, end)[0]


def _one(connection: apsw.Connection, query: str, *values: int) -> tuple[Any, ...]:
    return tuple(connection.execute(query, values).fetchall()[0])


def _packed(connection: apsw.Connection, begin: int, end: int) -> Batch | None:
    """Return a batch, or None if it has to be read row by row."""
    usual = connection.limit(apsw.SQLITE_LIMIT_LENGTH, _LARGEST)
    try:
        data, *texts = _one(connection, _PACKED, begin, end)
    except apsw.Error:
        return None
    finally:
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, usual)
    if data is None or None in texts:
        return None
    length, time_ns, topic, number = (np.fromstring(text, np.int64, sep=',') for text in texts)
    same = len(length) == len(time_ns) == len(topic) == len(number)
    if not same or length.sum() != len(data):
        return None
    stop = np.cumsum(length)
    records = Records(np.frombuffer(data, np.uint8), stop - length, stop, time_ns)
    order = np.argsort(number, kind='stable')
    return Batch(topic[order], records.select(order))


def _singly(connection: apsw.Connection, begin: int, end: int) -> Iterator[Batch]:
    cursor = connection.execute(_SINGLE, (begin, end))
    while True:
        rows: list[tuple[Any, ...]] = []
        try:
            rows.extend(islice(cursor, _SINGLE_ROWS))
        except apsw.Error:
            if rows:
                yield _of_rows(rows)
            raise
        if not rows:
            return
        yield _of_rows(rows)


def _of_rows(rows: list[tuple[Any, ...]]) -> Batch:
    """Return rows as a batch; what is not of its type cannot be decoded, or belongs nowhere."""
    topics, times, messages = zip(*rows, strict=True)
    data = [message if isinstance(message, bytes) else b'' for message in messages]
    return Batch(_whole(topics), Records.of(data, _whole(times)))


def _whole(values: tuple[Any, ...]) -> IntArray:
    return np.array([value if isinstance(value, int) else -1 for value in values], np.int64)
