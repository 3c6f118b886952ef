# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stop of the live page: an additional one, which does not replace a stop button.

A button that says its state all the time would count as the one that a driver asks for, and its
silence would stop.  This one is not on the graph until it is pressed.  Then it calls the driver's
service, again and again until the driver says that it is stopped, and says "pressed" on the topic
of the buttons, which a driver hears even while its executor is blocked.  Let go of, it says
"released" and leaves; the driver stays stopped until somebody resets it.
"""

import math
import threading
import time
from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from rpms_ros.nodes import topics
from rpms_ros.nodes.button_publisher import ButtonPublisher
from rpms_ros.nodes.logger import logger_of

_LOOK_S = 0.02
_REPEAT_S = 0.1
# How long "released" is said before the button leaves: longer than a driver needs to hear it.
_FAREWELL_S = 0.5
# "pressed" is said as long, also if it is let go of sooner: a driver has to find the button first.
_LEAST_S = 0.5
# After this time a driver that says nothing of a stop is taken for one that has not heard it.
_CONFIRMATION_S = 1.0

UNCONFIRMED = 'NOT CONFIRMED by the driver: use the switch of the stimulator'


class LiveStop:
    """Presses and releases the stop; `press` and `let_go` may be called by any thread.

    Parameters
    ----------
    node : Node
        The page's; its executor serves the timer and the service's client.
    stopped : callable
        Tells whether a driver that is heard says that a stop is latched.
    tell : callable
        Told, in the executor's thread, whether it is pressed, and what to show.
    """

    def __init__(
        self, node: Node, stopped: Callable[[], bool], tell: Callable[[bool, str], None]
    ) -> None:
        self._node = node
        self._stopped = stopped
        self._tell = tell
        self._lock = threading.Lock()
        self._wanted = False
        self._confirmed = False
        self._pressed_at = 0.0
        self._held_until = 0.0
        self._next_call = 0.0
        self._leaves_at = 0.0
        self._told = ''
        self._button: ButtonPublisher | None = None
        self._client = node.create_client(Trigger, topics.EMERGENCY_STOP)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_LOOK_S, self._look, clock=steady)

    def press(self) -> None:
        """Stop the driver at once, and keep the stop pressed."""
        with self._lock:
            if not self._wanted:
                self._wanted, self._pressed_at = True, time.monotonic()
                self._held_until, self._confirmed = math.inf, False
            self._call()

    def let_go(self) -> None:
        """Release the stop."""
        with self._lock:
            self._wanted = False

    def _call(self) -> None:
        self._next_call = time.monotonic() + _REPEAT_S
        if self._client.service_is_ready():
            self._client.call_async(Trigger.Request())

    def _look(self) -> None:
        with self._lock:
            now = time.monotonic()
            held = self._wanted or now < self._held_until
            (self._hold if held else self._leave)(now)

    def _hold(self, now: float) -> None:
        if self._button is None:
            self._button = ButtonPublisher(self._node, pressed=True)
            self._button.say()
            logger_of(self._node).warning('stop pressed on the page')
        self._button.set(True)
        self._held_until = min(self._held_until, now + _LEAST_S)
        stopped = self._confirmed = self._stopped()
        if not stopped and now >= self._next_call:
            self._call()
        if stopped:
            self._say(
                True, 'stopped: the driver confirms it; let go here, then reset at the driver'
            )
        elif now > self._pressed_at + _CONFIRMATION_S:
            self._say(True, UNCONFIRMED)
        else:
            self._say(True, 'stop pressed, waiting for the driver')
        self._leaves_at = now + _FAREWELL_S

    def _leave(self, now: float) -> None:
        if self._button is None:
            return
        self._button.set(False)
        self._confirmed = self._confirmed or self._stopped()
        if self._confirmed:
            self._say(False, 'released: the driver stays stopped until it is reset')
        else:
            self._say(False, f'released; the stop was {UNCONFIRMED}')
        if now >= self._leaves_at:
            self._button.destroy()
            self._button = None
            if self._confirmed:
                self._say(False, '')
            logger_of(self._node).info('stop of the page released')

    def _say(self, pressed: bool, text: str) -> None:
        if text != self._told:
            self._told = text
            self._tell(pressed, text)
