# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a test in one executor, in a DDS domain that no other test uses meanwhile.

Nodes are real ones, which the test steps by waiting: nothing sleeps.
"""

import time
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.nodes.common.runner import free_domain, stay_on_this_machine, use_fast_discovery

_LAST_EVENTS = 100


class Graph:
    """Nodes in one persistent executor, stepped by whoever waits."""

    def __init__(self, context):
        self.context = context
        self._executor = EventsExecutor(context=context)
        self._nodes, self._other = [], None

    def add(self, build, **parameters):
        """Build a node in the private context with these ROS parameters and add it.

        `build` passes keyword arguments on to `rclpy.node.Node`.
        """
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = build(
            context=self.context, parameter_overrides=overrides, use_global_arguments=False
        )
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def node(self, name, **options):
        """Add a node that does nothing by itself."""
        return self.add(lambda **private: Node(name, **options, **private))

    def remove(self, node):
        """Destroy a node before the end of the test."""
        self._nodes.remove(node)
        self._executor.remove_node(node)
        # callbacks in the executor's queue would be called on a destroyed node
        for _ in range(_LAST_EVENTS):
            self._executor.spin_once(timeout_sec=0.0)
        node.destroy_node()

    def heard(self, kind, topic, profile=100):
        """Return the messages of a topic, as they come from now on."""
        found = []
        self._other = self._other or self.node('listener')
        self._other.create_subscription(kind, topic, found.append, profile)
        return found

    def publisher(self, kind, topic, profile=100):
        """Return a publisher of a topic that one node hears."""
        self._other = self._other or self.node('listener')
        made = self._other.create_publisher(kind, topic, profile)
        self.wait_for(lambda: made.get_subscription_count() > 0)
        return made

    def wait_for(self, predicate, timeout=60.0):
        """Step the executor until `predicate` holds; fail the test after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not predicate():
            if time.monotonic() > end:
                pytest.fail(f'still waiting after {timeout} s')
            self._executor.spin_once(timeout_sec=0.01)

    def close(self):
        """Destroy the nodes, newest first."""
        for node in reversed(self._nodes):
            self._executor.remove_node(node)
            node.destroy_node()
            for waitable in list(node.waitables):
                # rclpy leaves it alone, and it would keep the node on the graph
                if isinstance(waitable, ActionClient):
                    waitable.destroy()
        self._executor.shutdown()


def private_domain():
    """Return a context with a DDS domain that nobody else uses on this machine meanwhile."""
    use_fast_discovery()
    stay_on_this_machine()
    return free_domain()


@contextmanager
def private_context(domain):
    """Initialise a context of its own in a DDS domain, and shut it down."""
    private = Context()
    rclpy.init(args=[], context=private, domain_id=domain)
    try:
        yield private
    finally:
        private.try_shutdown()
