# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The logger of a node, with its type; a line where something takes long."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node

COMPILING = 'compiling, once on a machine: half a minute, on a busy one some minutes'
_PATIENCE_S = 1.0


def logger_of(node: Node) -> RcutilsLogger:
    """Return the logger of the node: Jazzy's `get_logger` does not say what it returns."""
    logger: RcutilsLogger = node.get_logger()
    return logger


@contextmanager
def told_if_slow(node: Node, text: str, patience: float = _PATIENCE_S) -> Iterator[None]:
    """Log `text` if what is done here takes longer than `patience` [s]."""
    timer = Timer(patience, logger_of(node).info, (text,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
