# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Generated message classes by name, for `rpms_ros.messages` to build from."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from std_msgs.msg import Header

from rpms_msgs.msg import MuscleEstimate, MuscleTruth, Pulse, Schedule, ScheduleSegment
from rpms_ros import messages, schedule_messages

MESSAGE_TYPES: messages.MessageTypes = {
    messages.TIME: Time,
    messages.HEADER: Header,
    messages.VECTOR: Vector3,
    messages.WRENCH: Wrench,
    messages.WRENCH_STAMPED: WrenchStamped,
    messages.PULSE: Pulse,
    messages.MUSCLE_ESTIMATE: MuscleEstimate,
    messages.MUSCLE_TRUTH: MuscleTruth,
    schedule_messages.SCHEDULE: Schedule,
    schedule_messages.SCHEDULE_SEGMENT: ScheduleSegment,
}
