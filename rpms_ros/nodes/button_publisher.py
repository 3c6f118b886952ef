# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Client of a stop button: publishes its state at a rate, and at once when it changes."""

from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from std_msgs.msg import Bool

from rpms_ros.nodes import qos
from rpms_ros.nodes import topics

RATE = 50.0


class ButtonPublisher:
    """Publishes the state of one button in the executor of a node.

    Parameters
    ----------
    node : Node
        Whose executor serves it: where that hangs, the button falls silent.
    pressed : bool
        State at the beginning.
    rate : float
        How often the state is said [Hz].
    """

    def __init__(self, node: Node, pressed: bool = False, rate: float = RATE) -> None:
        self._pressed = pressed
        self._left = False
        self._node = node
        self._publisher = node.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP_STATE)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.timer = node.create_timer(1.0 / rate, self.say, clock=steady)

    @property
    def pressed(self) -> bool:
        """State of the button."""
        return self._pressed

    @property
    def listeners(self) -> int:
        """How many hear it."""
        return int(self._publisher.get_subscription_count())

    def set(self, pressed: bool) -> None:
        """Change the state and say so."""
        changed, self._pressed = pressed != self._pressed, pressed
        if changed:
            self.say()

    def say(self) -> None:
        """Publish the state."""
        # an executor may have taken the timer out of its queue before the button left
        if not self._left:
            self._publisher.publish(Bool(data=self._pressed))

    def destroy(self) -> None:
        """Leave the graph; a driver that is armed takes this for a button that fell silent."""
        self._left = True
        self._node.destroy_timer(self.timer)
        self._node.destroy_publisher(self._publisher)
