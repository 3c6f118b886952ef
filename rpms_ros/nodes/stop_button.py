# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stop button: a node that reads keys of the terminal, or a button of a joystick.

Any key presses it, ``r`` releases it.  A lost terminal or joystick counts as pressed.
"""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

from sensor_msgs.msg import Joy

from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import logger_of
from rpms_ros.nodes.common.operator import ButtonPublisher, Keyboard
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.stimulation.driver.stop_buttons import JoystickButton

RELEASE = 'r'
_LOOK_S = 0.01


@dataclass(frozen=True)
class StopButtonParameters(NodeParameters):
    """Parameters of a stop button."""

    keyboard: bool = parameter(True, 'Whether keys of the terminal press it.')
    joy_button: int = parameter(
        -1, 'Button of the joystick that presses it, from 0; -1 for none.', bounds=(-1, 63)
    )
    joy_timeout: float = parameter(
        0.5, 'Longest silence of the joystick.', unit='s', bounds=(0.05, 10.0)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.keyboard and self.joy_button < 0:
            raise NodeError('expected a keyboard or a joy_button, got neither')


class StopButton(NodeOfParts):
    """A stop button; keyword arguments go to `rclpy.node.Node`.

    Parameters
    ----------
    keyboard : Keyboard, optional
        Keyboard of the terminal; that of standard input if not given.
    """

    settings_type = StopButtonParameters

    def __init__(self, keyboard: Keyboard | None = None, **options: Any) -> None:
        self._keyboard = keyboard
        super().__init__('stop_button', **options)

    def _build(self) -> None:
        self.settings = declare_parameters(self, StopButtonParameters)
        if self.settings.keyboard and self._keyboard is None:
            self._keyboard = Keyboard()
        if self._keyboard is not None:
            self._parts.callback(self._keyboard.close)
        self._joystick = JoystickButton(self.settings.joy_button, self.settings.joy_timeout)
        if self._joystick.used:
            self.create_subscription(Joy, topics.JOY, self._on_joy, qos.JOYSTICK)
        self._key_pressed = self._keyboard is not None and not self._keyboard.there
        self.button = ButtonPublisher(self, self._wanted())
        every(self, _LOOK_S, self._look)
        self._said = self._word()
        logger_of(self).info(f'any key presses, {RELEASE} releases: {self._said}')

    def _look(self) -> None:
        for key in self._keyboard.read() if self._keyboard is not None else '':
            self._key_pressed = key != RELEASE
            # each one is said: a key and its release may be read at once
            self._say()
        if self._keyboard is not None and not self._keyboard.there:
            self._key_pressed = True
        self._say()

    def _say(self) -> None:
        self.button.set(self._wanted())
        before, self._said = self._said, self._word()
        if self._said != before:
            logger_of(self).info(self._said)

    def _wanted(self) -> bool:
        down = self._joystick.down(time.monotonic_ns()) if self._joystick.used else False
        return self._key_pressed or down is not False

    def _word(self) -> str:
        lost = [] if self._keyboard is None or self._keyboard.there else ['terminal']
        if self._joystick.used and self._joystick.down(time.monotonic_ns()) is None:
            lost.append('joystick')
        if lost:
            return f'{" and ".join(lost)} lost: pressed'
        if self.button.pressed:
            return 'pressed'
        return 'released' if self.button.listeners else 'released; no driver listens'

    def _on_joy(self, message: Joy) -> None:
        self._joystick.heard(message.buttons, time.monotonic_ns())
        self._say()


# Runs the stop button as a process.
main = partial(run, StopButton)
