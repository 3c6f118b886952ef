# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The logger of a node, with its type; a line where something takes long."""

from contextlib import AbstractContextManager

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node

from rpms_ros.slowness import calling_if_slow

COMPILING = 'compiling, once on a machine: half a minute, on a busy one some minutes'


def logger_of(node: Node) -> RcutilsLogger:
    """Return the logger of the node: Jazzy's `get_logger` does not say what it returns."""
    logger: RcutilsLogger = node.get_logger()
    return logger


def told_if_slow(node: Node, text: str) -> AbstractContextManager[None]:
    """Log `text` if what is done here takes longer than a second."""
    return calling_if_slow(lambda: logger_of(node).info(text))
