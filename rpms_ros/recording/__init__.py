# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in, recordings out, arrays in between; needs no ROS."""

from rpms_ros.recording.rosbag.reading import (
    Recording,
    RecordingFacts,
    Topics,
    read_facts,
    read_recording,
    session_hash,
)
from rpms_ros.recording.rosbag.writing import FurtherTopic, RecordingWriter, write_recording

__all__ = [
    'FurtherTopic',
    'Recording',
    'RecordingFacts',
    'RecordingWriter',
    'Topics',
    'read_facts',
    'read_recording',
    'session_hash',
    'write_recording',
]
