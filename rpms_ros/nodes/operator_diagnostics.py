# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Health of the nodes of the person who stimulates: stop button and console."""

from collections.abc import Callable
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node

from rpms_ros.nodes.diagnostics import PERIOD_S
from rpms_ros.nodes.diagnostics import DiagnosticsPublisher
from rpms_ros.nodes.diagnostics import Health


def button_health(pressed: bool, lost: Sequence[str], listeners: int) -> Health:
    """Return the health of a stop button.

    An error while an input is lost, which counts as pressed; a warning while it is pressed or no
    driver hears it; ok otherwise.

    Parameters
    ----------
    pressed : bool
        What it publishes.
    lost : sequence of str
        Inputs that are gone or silent.
    listeners : int
        Subscriptions of its topic.
    """
    figures = {'pressed': pressed, 'listeners': listeners}
    if lost:
        return Health(f'{" and ".join(lost)} lost: pressed', DiagnosticStatus.ERROR, figures)
    if pressed:
        return Health('pressed', DiagnosticStatus.WARN, figures)
    if not listeners:
        return Health('released; no driver listens', DiagnosticStatus.WARN, figures)
    return Health('released', DiagnosticStatus.OK, figures)


class DiagnosticsTimer:
    """Publishes the health of a node once a second, in its executor.

    Parameters
    ----------
    node, task, hardware
        As of `DiagnosticsPublisher`; the hardware is told from that of others by the node's name.
    health : callable
        Returns the health.
    """

    def __init__(self, node: Node, task: str, hardware: str, health: Callable[[], Health]) -> None:
        self._health = health
        name = node.get_fully_qualified_name()
        self._publisher = DiagnosticsPublisher(node, task, f'{hardware} of {name}')
        node.create_timer(PERIOD_S, self._say, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _say(self) -> None:
        self._publisher.publish(self._health())
