# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver publishes of a schedule that it has accepted: name, text, hash, who asked."""

import time

from rclpy.node import Node

from rpms_msgs.msg import AcceptedSchedule
from rpms_ros import messages
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation.description import text_hash


class SchedulePublisher:
    """Publishes the schedules of one driver, the last one also for those who join later.

    Parameters
    ----------
    node : Node
        The driver's.
    frame_id : str
        Frame of the pulses.
    """

    def __init__(self, node: Node, frame_id: str) -> None:
        self._frame_id = frame_id
        self._accepted = node.create_publisher(
            AcceptedSchedule, topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE
        )

    def publish(self, schedule: Schedule, text: str, operator_id: str) -> None:
        """Publish a schedule before its first pulse; `text` is the document that it came as."""
        message = AcceptedSchedule(
            header=messages.header_message(time.time_ns(), self._frame_id, MESSAGE_TYPES),
            name=plain_text(schedule.name),
            schedule=text,
            sha256=text_hash(text),
            operator_id=plain_text(operator_id),
            pulses=int(schedule.pulse_count),
            duration=float(schedule.length_s),
        )
        self._accepted.publish(message)
