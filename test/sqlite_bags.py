# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of sqlite3, which the package reads and does not write."""

import shutil

from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from rpms_ros.recording.rosbag.definitions import known_types


def as_sqlite3(path):
    """Turn a recording into one of sqlite3, as ``ros2 bag convert`` does; return its file."""
    moved = path.rename(path.with_name(f'{path.name}_before'))
    plugin = StoragePlugin.SQLITE3
    with AnyReader([moved]) as reader, Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=known_types())
            for one in reader.connections
        }
        for connection, time_ns, data in reader.messages():
            writer.write(connections[connection.id], time_ns, data)
    shutil.rmtree(moved)
    return path / f'{path.name}.db3'
