# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node of the person who stimulates: stop button, heartbeat, token, enable in one terminal.

``a`` asks for a token.  Holding ``e``, or a button of the joystick, arms and then runs the
schedule for as long as it is held; releasing it disarms.  ``r`` releases the stop.  Any other key
stops.
"""

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.task import Future
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger

from rpms_msgs.msg import DriverStatus
from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import logger_of
from rpms_ros.nodes.common.operator import ButtonPublisher, Keyboard, OperatorClient
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.stimulation import load_schedule
from rpms_ros.stimulation.driver.stop_buttons import HeldKey, JoystickButton

ASK, ENABLE, RELEASE = 'a', 'e', 'r'
KEY_DELAY_S = 0.8
"""Longest time from a key that is held to its first repetition."""
JOY_TIMEOUT_S = 0.2
"""Longest silence of the joystick that is the enable."""
_LOOK_S = 0.01


@dataclass(frozen=True)
class ConsoleParameters(NodeParameters):
    """Parameters of the operator's console."""

    operator: str = parameter('', 'Name of the operator.')
    schedule_file: str = parameter('', 'YAML file of the schedule that is run; empty arms only.')
    driver: str = parameter('stimulator_driver', 'Name of the driver node.')
    key_repeat: float = parameter(
        0.2, 'A key counts so long after a repetition.', unit='s', bounds=(0.05, 2.0)
    )
    joy_enable: int = parameter(
        -1, 'Button of a joystick that is the enable; -1 for none.', bounds=(-1, 63)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.operator:
            raise NodeError('expected the name of the operator, got none')


class OperatorConsole(NodeOfParts):
    """The console; keyword arguments go to `rclpy.node.Node`.

    Parameters
    ----------
    keyboard : Keyboard, optional
        Of the terminal; the one of standard input if not given.

    Raises
    ------
    RpmsError
        If there is no terminal, or the schedule cannot be read.
    """

    settings_type = ConsoleParameters

    def __init__(self, keyboard: Keyboard | None = None, **options: Any) -> None:
        self._given = keyboard
        super().__init__('operator_console', **options)

    def _build(self) -> None:
        self.settings = declare_parameters(self, ConsoleParameters)
        file = self.settings.schedule_file
        self._schedule = load_schedule(Path(file).expanduser()) if file else None
        self._keyboard = self._given or Keyboard()
        self._parts.callback(self._keyboard.close)
        if not self._keyboard.there:
            raise NodeError('expected a terminal to read keys from, got none')
        self._held = HeldKey(KEY_DELAY_S, self.settings.key_repeat)
        self._joystick = JoystickButton(self.settings.joy_enable, JOY_TIMEOUT_S)
        if self._joystick.used:
            self.create_subscription(Joy, topics.JOY, self._on_joy, qos.JOYSTICK)
        self.client = OperatorClient(self, self.settings.operator)
        self._parts.callback(self.client.destroy)
        self.button = ButtonPublisher(self)
        self._configure = self.create_client(ChangeState, f'{self.settings.driver}/change_state')
        self._reset = self.create_client(Trigger, topics.RESET_EMERGENCY_STOP)
        self._state = -1
        self._pending: Future | None = None
        self._started = False
        self._shown = ''
        hear = self.create_subscription
        hear(DriverStatus, topics.DRIVER_STATUS, self._on_status, qos.STATUS_LATEST)
        every(self, _LOOK_S, self._look)
        keys = f'{ASK} asks for a token, hold {ENABLE} to arm and run, {RELEASE} resets'
        logger_of(self).info(f'{keys}, any other key stops')

    def _look(self) -> None:
        now_ns = time.monotonic_ns()
        for key in self._keyboard.read():
            self._on_key(key, now_ns)
        if not self._keyboard.there:
            self.button.set(True)
            self._say('terminal lost: pressed')
        elif self._joystick.used and self._joystick.down(now_ns) is None:
            self._say('joystick lost: not enabled')
        self._enable(self._is_enabled(now_ns))
        self._go_on()

    def _on_key(self, key: str, now_ns: int) -> None:
        if key == ENABLE:
            self._held.came(now_ns)
        elif key == ASK:
            self._ask()
        elif key == RELEASE:
            self.button.set(False)
            self._call(self._reset, Trigger.Request())
        else:
            self.button.set(True)
            self._say('stop pressed')

    def _is_enabled(self, now_ns: int) -> bool:
        return self._held.held(now_ns) or self._joystick.down(now_ns) is True

    def _enable(self, held: bool) -> None:
        changed, self.client.enable = held != self.client.enable, held
        if changed:
            # at once, not with the next heartbeat
            self.client.beat()

    def _ask(self) -> None:
        """First step: configure the driver if that was not done, and ask for a token."""
        if self._state == DriverStatus.UNCONFIGURED:
            configure = Transition(id=Transition.TRANSITION_CONFIGURE)
            self._call(self._configure, ChangeState.Request(transition=configure))
        # the driver of a confirmation that is still waited for may be gone
        self._started, self._pending = False, None
        self.client.request().add_done_callback(self._tell)

    def _go_on(self) -> None:
        """Confirm the arming, then start the schedule, while the enable is held."""
        busy = self._pending is not None and not self._pending.done()
        if busy or not self.client.enable or not self.client.token:
            return
        if self._state == DriverStatus.DISARMED and not self._started:
            self._pending = self.client.confirm()
            self._pending.add_done_callback(self._tell)
        elif self._state == DriverStatus.ARMED and self._schedule and not self._started:
            self._started = True
            self._pending = self.client.start(self._schedule)
            self._pending.add_done_callback(
                lambda goal: goal.result().get_result_async().add_done_callback(self._tell_result)
            )

    def _tell_result(self, future: Future) -> None:
        # of a goal that was refused: the driver is armed, and a silence would be latched
        self._enable(False)
        self.client.token = ''
        self._say(future.result().result.reason)

    def _tell(self, future: Future) -> None:
        self._say(future.result().message)

    def _say(self, line: str) -> None:
        """Print a line unless it was the last one printed."""
        if line and line != self._shown:
            logger_of(self).info(line)
        self._shown = line

    def _call(self, client: Any, request: Any) -> None:
        if client.service_is_ready():
            client.call_async(request)
        else:
            self._say('expected a driver, got none')

    def _on_status(self, message: DriverStatus) -> None:
        self._state = int(message.state)

    def _on_joy(self, message: Joy) -> None:
        now_ns = time.monotonic_ns()
        self._joystick.heard(message.buttons, now_ns)
        # each one is said: a release may be over before the next look
        self._enable(self._is_enabled(now_ns))


# Runs the operator's console as a process.
main = partial(run, OperatorConsole)
