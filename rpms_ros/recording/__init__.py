# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in, recordings out, arrays in between; needs no ROS."""

from rpms_ros.recording.reading import Recording
from rpms_ros.recording.reading import RecordingFacts
from rpms_ros.recording.reading import Topics
from rpms_ros.recording.reading import read_facts
from rpms_ros.recording.reading import read_recording
from rpms_ros.recording.session_hash import session_hash
from rpms_ros.recording.writing import FurtherTopic
from rpms_ros.recording.writing import RecordingWriter
from rpms_ros.recording.writing import write_recording

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
