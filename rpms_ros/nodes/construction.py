# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are complete or not on the graph at all."""

from collections.abc import Iterator
from contextlib import ExitStack
from contextlib import contextmanager

from rclpy.node import Node


@contextmanager
def complete_or_gone(node: Node) -> Iterator[ExitStack]:
    """Build the parts of a node; if that fails, end those that were made and destroy the node.

    Half of a node would stay on the graph until Python collects it: under its name, with its
    parameter services, and with subscriptions from which nobody reads.

    Parameters
    ----------
    node : Node
        Constructed as a node; its parts are made inside.

    Yields
    ------
    ExitStack
        What has to end before the node is destroyed, the newest first; `destroy_node` of the
        node closes it.

    Examples
    --------
    ::

        super().__init__('identifier', **options)
        with complete_or_gone(self) as self._parts:
            self._build()
    """
    parts = ExitStack()
    try:
        yield parts
    except BaseException:
        # destroy_node does so too, where a node has parts of its own
        parts.close()
        node.destroy_node()
        raise
