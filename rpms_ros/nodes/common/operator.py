# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes of an operator share: keys, heartbeat, token, goals, stop button."""

import contextlib
import os
import select
import sys
import termios
import time
import tty
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Bool

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import OperatorHeartbeat
from rpms_msgs.srv import ConfirmArming, RequestArming
from rpms_ros import messages
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import every
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.schedule_messages import schedule_message
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation.driver.authority import host_identity, operator_name


class Keyboard:
    """Reads keys from a terminal; `close` restores its settings.

    Parameters
    ----------
    descriptor : int, optional
        Of the terminal; standard input if not given.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._before: Any = None
        self.there = os.isatty(self._descriptor)
        if self.there:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)

    def read(self) -> str:
        """Return the keys since the last call; a terminal that is gone is not `there` any more."""
        found = b''
        while self.there and select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                read = os.read(self._descriptor, 64)
            except OSError:
                read = b''
            self.there = bool(read)
            found += read
        return found.decode('utf-8', 'replace')

    def close(self) -> None:
        """Restore the settings of the terminal."""
        if self._before:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None


RATE = 50.0
"""Heartbeats and button states a second [Hz]."""


class OperatorClient:
    """Acts for one operator in the executor of a node: if that hangs, the heartbeat ends.

    Parameters
    ----------
    node : Node
        Whose executor serves it.
    operator : str
        Who; raises Refused if it is no name.

    Attributes
    ----------
    enable : bool
        Whether the operator holds the enable.
    token : str
        What the driver has given; empty before.
    """

    def __init__(self, node: Node, operator: str) -> None:
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
        self.timer = every(node, 1.0 / RATE, self.beat)

    @property
    def ready(self) -> bool:
        """Whether a driver serves everything that is asked for."""
        served = self._request.service_is_ready() and self._confirm.service_is_ready()
        heard = self._beats.get_subscription_count() > 0
        return bool(served and self.goals.server_is_ready() and heard)

    def request(self) -> Future:
        """Ask for a token: first step of arming; it is there a moment after the answer."""
        self.token = ''
        future: Future = self._request.call_async(RequestArming.Request(operator_id=self.operator))
        future.add_done_callback(self._take_token)
        return future

    def confirm(self) -> Future:
        """Arm: second step; the enable has to be held, and a heartbeat to have been heard."""
        request = ConfirmArming.Request(operator_id=self.operator, token=self.token)
        return self._confirm.call_async(request)

    def start(self, schedule: Schedule) -> Future:
        """Send a schedule as this operator."""
        typed = schedule_message(schedule, MESSAGE_TYPES)
        goal = RunSchedule.Goal(typed_schedule=typed, operator_id=self.operator, token=self.token)
        future: Future = self.goals.send_goal_async(goal)
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


class ButtonPublisher:
    """Publishes the state of one button in the executor of a node.

    Parameters
    ----------
    node : Node
        Whose executor serves it: where that hangs, the button falls silent.
    pressed : bool
        State at the beginning.

    Attributes
    ----------
    pressed : bool
        State of the button; `set` changes it.
    """

    def __init__(self, node: Node, pressed: bool = False) -> None:
        self._node, self.pressed, self._left = node, pressed, False
        self._publisher = node.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP_STATE)
        self.timer = every(node, 1.0 / RATE, self.say)

    @property
    def listeners(self) -> int:
        """How many hear it."""
        return int(self._publisher.get_subscription_count())

    def set(self, pressed: bool) -> None:
        """Change the state and say so."""
        changed, self.pressed = pressed != self.pressed, pressed
        if changed:
            self.say()

    def say(self) -> None:
        """Publish the state."""
        # an executor may have taken the timer out of its queue before the button left
        if not self._left:
            self._publisher.publish(Bool(data=self.pressed))

    def destroy(self) -> None:
        """Leave the graph; a driver that is armed takes this for a button that fell silent."""
        self._left = True
        self._node.destroy_timer(self.timer)
        self._node.destroy_publisher(self._publisher)
