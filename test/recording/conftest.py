# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests, made by the package and by rosbags."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat

from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import write_recording
from rpms_ros.recording.rosbag.definitions import known_types

START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def as_sqlite3(beside):
    """Turn a recording into one of sqlite3."""
    convert: Callable[[Path], Path] = beside('sqlite_bags').as_sqlite3
    return convert


@pytest.fixture
def session():
    """Two seconds of pulses at 20 Hz and force at 1 kHz."""
    generator = np.random.default_rng(7)
    stamp_ns = START_NS + np.arange(2000, dtype=np.int64) * 1_000_000
    pulses = PulseTrain.regular(generator.random(40), 20.0, START_NS)
    return pulses, ForceTrace(stamp_ns, generator.standard_normal(2000), 'load_cell')


@pytest.fixture
def bag(session, tmp_path):
    """The folder of a recording of it."""
    write_recording(tmp_path / 'bag', *session)
    return tmp_path / 'bag'


class Make:
    """Messages of rosbags."""

    @staticmethod
    def of(kind, *fields):
        return known_types().types[kind](*fields)

    def header(self, stamp_ns, frame_id):
        time = self.of('builtin_interfaces/msg/Time', *divmod(stamp_ns, 1_000_000_000))
        return self.of('std_msgs/msg/Header', time, frame_id)

    def pulse(self, stamp_ns, sequence=0, intensity=0.5, frame_id='coil'):
        fields = (self.header(stamp_ns, frame_id), sequence, intensity, 1e-4, 0)
        return self.of('rpms_msgs/msg/Pulse', *fields)

    def wrench(self, x, y, z):
        force = self.of('geometry_msgs/msg/Vector3', x, y, z)
        torque = self.of('geometry_msgs/msg/Vector3', 0.0, 0.0, 0.0)
        return self.of('geometry_msgs/msg/Wrench', force, torque)

    def wrench_stamped(self, stamp_ns, z, frame_id='load_cell'):
        fields = (self.header(stamp_ns, frame_id), self.wrench(0.0, 0.0, z))
        return self.of('geometry_msgs/msg/WrenchStamped', *fields)


@pytest.fixture
def make():
    """Messages of rosbags."""
    return Make()


@pytest.fixture
def write_with_rosbags(tmp_path):
    """Write messages with rosbags; return the folder."""

    def write(messages, storage=StoragePlugin.MCAP, compression=CompressionMode.NONE, name='bag'):
        path = tmp_path / name
        writer = Writer(path, version=9, storage_plugin=storage)
        if compression is not CompressionMode.NONE:
            writer.set_compression(compression, CompressionFormat.ZSTD)
        connections: dict[tuple[str, str], Any] = {}
        with writer:
            for topic, kind, time_ns, message in messages:
                if (topic, kind) not in connections:
                    connections[topic, kind] = writer.add_connection(
                        topic, kind, typestore=known_types()
                    )
                data = known_types().serialize_cdr(message, kind)
                writer.write(connections[topic, kind], time_ns, data)
        return path

    return write
