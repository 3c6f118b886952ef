# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The logger of a node, with its type.

Makes text from outside safe for a message: encodable, printable and short.
"""

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node


def logger_of(node: Node) -> RcutilsLogger:
    """Return the logger of the node: Jazzy's `get_logger` does not say what it returns."""
    logger: RcutilsLogger = node.get_logger()
    return logger


LONGEST = 2000


def plain_text(text: object) -> str:
    """Return at most `LONGEST` characters, all of them printable and encodable as UTF-8."""
    said = str(text)[:LONGEST].encode('utf-8', 'replace').decode()
    return ''.join(sign if sign.isprintable() else ' ' for sign in said)
