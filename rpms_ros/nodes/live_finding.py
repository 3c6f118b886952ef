# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Namespaces of the graph that have something to show."""

import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.node import Node

from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse
from rpms_ros.nodes import topics
from rpms_ros.nodes.discovery import use_fast_discovery
from rpms_ros.nodes.live_listener import type_name_of

# Discovery takes a tenth of a second with our profile and up to three seconds without.
PATIENCE = 3.0
# Who was found first may not be alone.
_SETTLING = 0.3
_LOOK_S = 0.05

_SHOWN = {
    topics.FORCE: type_name_of(WrenchStamped),
    topics.PULSES: type_name_of(Pulse),
    topics.ESTIMATE: type_name_of(MuscleEstimate),
    topics.DRIVER_STATUS: type_name_of(DriverStatus),
}


def namespaces(patience: float = PATIENCE) -> list[str]:
    """Return the namespaces in which somebody publishes what the page shows, sorted.

    Parameters
    ----------
    patience : float
        How long to look for the first one [s].
    """
    use_fast_discovery()
    context = Context()
    rclpy.init(args=[], context=context)
    node = Node('live_page_finder', context=context, use_global_arguments=False)
    end = time.monotonic() + patience
    try:
        found: set[str] = set()
        while time.monotonic() < end:
            before, found = found, found | _published(node)
            if found and not before:
                end = min(end, time.monotonic() + _SETTLING)
            time.sleep(_LOOK_S)
        return sorted(found)
    finally:
        node.destroy_node()
        context.try_shutdown()


def _published(node: Node) -> set[str]:
    found = set()
    for name, types in node.get_topic_names_and_types():
        namespace, _, base = name.rpartition('/')
        if _SHOWN.get(base) in types and node.count_publishers(name):
            found.add(namespace or '/')
    return found
