# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Other drivers on the graph, and the publishers of a topic."""

from rclpy.node import Node

from rpms_ros.nodes import topics

_GOALS = '/_action/send_goal'


def publishers_of(node: Node, topic: str) -> dict[bytes, str]:
    """Return the node of every publisher of a topic, by the identity of the publisher."""
    return {
        bytes(publisher.endpoint_gid): _joined(publisher.node_namespace, publisher.node_name)
        for publisher in node.get_publishers_info_by_topic(topic)
    }


def others_of_this_name(node: Node) -> str:
    """Return why this driver is not the only one of its name, empty if it is.

    A driver is known by its node, and by the action that it serves: of two, both would run a goal.
    """
    name, namespace = node.get_name(), node.get_namespace()
    nodes = node.get_node_names_and_namespaces().count((name, namespace))
    if nodes > 1:
        return f'expected one driver {_joined(namespace, name)}, got {nodes} nodes of this name'
    action = node.resolve_topic_name(topics.RUN_SCHEDULE)
    servers = node.count_services(action + _GOALS)
    if servers > 1:
        return f'expected one driver that serves {action}, got {servers}'
    return ''


def _joined(namespace: str, name: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'
