# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in, recordings out, arrays in between; needs no ROS."""

from rpms_ros.recording.rosbag.reading import (
    Recording as Recording,
    RecordingFacts as RecordingFacts,
    Topics as Topics,
    read_facts as read_facts,
    read_recording as read_recording,
    session_hash as session_hash,
)
from rpms_ros.recording.rosbag.writing import (
    FurtherTopic as FurtherTopic,
    RecordingWriter as RecordingWriter,
    write_recording as write_recording,
)
