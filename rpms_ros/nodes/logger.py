# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The logger of a node, with its type."""

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node


def logger_of(node: Node) -> RcutilsLogger:
    """Return the logger of the node: Jazzy's `get_logger` does not say what it returns."""
    logger: RcutilsLogger = node.get_logger()
    return logger
