# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The client's side of arming: token, heartbeat, held enable and goals of one operator."""

import os
import time
from typing import Any

from rclpy.action import ActionClient
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.task import Future

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import OperatorHeartbeat
from rpms_msgs.srv import ConfirmArming
from rpms_msgs.srv import RequestArming
from rpms_ros import messages
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.stimulation.authority import operator_name
from rpms_ros.stimulation.process_life import host_identity

RATE = 50.0


class OperatorClient:
    """Acts for one operator in the executor of a node: if that hangs, the heartbeat ends.

    Parameters
    ----------
    node : Node
        Whose executor serves it.
    operator : str
        Who; raises Refused if it is no name.
    rate : float
        Heartbeats a second [Hz].

    Attributes
    ----------
    enable : bool
        Whether the operator holds the enable.
    token : str
        What the driver has given; empty before.
    """

    def __init__(self, node: Node, operator: str, rate: float = RATE) -> None:
        # a message ends at a zero: what is sent would be another name
        self.operator = operator_name(operator)
        self.enable = False
        self.token = ''
        self._sequence = 0
        self._host = host_identity()
        self._beats = node.create_publisher(OperatorHeartbeat, topics.HEARTBEAT, qos.STOP)
        self._request = node.create_client(RequestArming, topics.REQUEST_ARMING)
        self._confirm = node.create_client(ConfirmArming, topics.CONFIRM_ARMING)
        self.goals = ActionClient(node, RunSchedule, topics.RUN_SCHEDULE)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.timer = node.create_timer(1.0 / rate, self.beat, clock=steady)

    @property
    def ready(self) -> bool:
        """Whether a driver serves everything that is asked for."""
        return bool(
            self._request.service_is_ready()
            and self._confirm.service_is_ready()
            and self.goals.server_is_ready()
            and self._beats.get_subscription_count() > 0
        )

    def request(self) -> Future:
        """Ask for a token: first step of arming; it is there a moment after the answer."""
        self.token = ''
        future: Future = self._request.call_async(RequestArming.Request(operator_id=self.operator))
        future.add_done_callback(self._take_token)
        return future

    def confirm(self) -> Future:
        """Arm: second step; the enable has to be held, and a heartbeat to have been heard."""
        request = ConfirmArming.Request(operator_id=self.operator, token=self.token)
        future: Future = self._confirm.call_async(request)
        return future

    def start(self, schedule: str, **callbacks: Any) -> Future:
        """Send a schedule as this operator."""
        goal = RunSchedule.Goal(schedule=schedule, operator_id=self.operator, token=self.token)
        future: Future = self.goals.send_goal_async(goal, **callbacks)
        return future

    def beat(self) -> None:
        """Say that the operator is there, once a token was given."""
        if not self.token:
            return
        self._sequence += 1
        message = OperatorHeartbeat(
            operator_id=self.operator,
            token=self.token,
            sequence=self._sequence,
            enable=bool(self.enable),
            host=self._host,
            process=os.getpid(),
        )
        message.header.stamp = messages.time_message(time.time_ns(), MESSAGE_TYPES)
        self._beats.publish(message)

    def destroy(self) -> None:
        """Destroy the client of the action, which a node does not do by itself."""
        self.goals.destroy()

    def _take_token(self, future: Future) -> None:
        answer = future.result()
        if answer is not None and answer.success:
            self.token = answer.token
            self._sequence = 0
