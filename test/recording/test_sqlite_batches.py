# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Batches of messages concatenated by SQLite: the same as row by row, whatever the rows are."""

import sqlite3
from typing import Any

import pytest
from hypothesis import given, strategies as st

from rpms_ros.recording.rosbag.sqlite_files import batches

ids = st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(0, 20_000))
rows_by_id = st.dictionaries(
    ids, st.tuples(st.integers(1, 3), st.integers(0, 2**63 - 1), st.binary(max_size=20))
)


def database(rows: dict[int, tuple[int, int, Any]]) -> sqlite3.Connection:
    connection = sqlite3.connect(':memory:')
    connection.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data)'
    )
    connection.executemany(
        'INSERT INTO messages VALUES (?, ?, ?, ?)', [(key, *row) for key, row in rows.items()]
    )
    return connection


def read(connection: sqlite3.Connection) -> list[tuple[int, int, bytes]]:
    return [
        (int(topic[index]), int(records.time_ns[index]), records.message(index))
        for topic, records in batches(connection)
        for index in range(len(records))
    ]


@given(rows_by_id)
def test_rows_come_in_the_order_of_their_ids(rows: dict[int, tuple[int, int, bytes]]) -> None:
    assert read(database(rows)) == [rows[key] for key in sorted(rows)]


@pytest.mark.parametrize('value', ["'Käthe'", 'NULL'])
def test_what_is_no_data_becomes_an_empty_message(value: str) -> None:
    connection = database({1: (1, 5, b'abc'), 2: (1, 6, b'')})
    connection.execute(f'UPDATE messages SET data = {value} WHERE id = 2')
    assert read(connection) == [(1, 5, b'abc'), (1, 6, b'')]
