# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What any node tells: lines in its log, and diagnostics of one status with a level."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node

from rpms_ros.nodes.common import topics


def logger_of(node: Node) -> RcutilsLogger:
    """Return the logger of the node: Jazzy's `get_logger` does not say what it returns."""
    logger: RcutilsLogger = node.get_logger()
    return logger


LONGEST = 2000


def plain_text(text: object) -> str:
    """Return at most `LONGEST` characters, all of them printable and encodable as UTF-8."""
    said = str(text)[:LONGEST].encode('utf-8', 'replace').decode()
    return ''.join(sign if sign.isprintable() else ' ' for sign in said)


PERIOD_S = 1.0
"""Time between two messages of a node."""


@dataclass(frozen=True)
class Health:
    """How a node is.

    Attributes
    ----------
    message : str
        In a few words.
    level : bytes
        `DiagnosticStatus.OK`, `WARN`, `ERROR` or `STALE`.
    figures : mapping of str to object
        What is behind it, by name.
    """

    message: str
    level: bytes = DiagnosticStatus.OK
    figures: Mapping[str, object] = field(default_factory=dict)


class DiagnosticsPublisher:
    """Publishes the health of a node, stamped by the node's clock.

    Parameters
    ----------
    node : Node
        Whose health it is.
    task : str
        What the node does.
    hardware : str
        What it does it with: no two of one graph are called alike.
    """

    def __init__(self, node: Node, task: str, hardware: str) -> None:
        self._clock = node.get_clock()
        self._name = f'{node.get_fully_qualified_name()}: {task}'
        self._hardware = plain_text(hardware)
        self._publisher = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)

    def publish(self, health: Health) -> None:
        """Publish it as that of now."""
        status = DiagnosticStatus(
            level=health.level,
            name=self._name,
            message=plain_text(health.message),
            hardware_id=self._hardware,
            values=[
                KeyValue(key=plain_text(key), value=plain_text(value))
                for key, value in health.figures.items()
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._clock.now().to_msg()
        self._publisher.publish(array)
