# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a test in one executor, in a DDS domain that no other test uses meanwhile.

Nodes are real ones, which the test steps by waiting: nothing sleeps.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.node import Node


class Graph:
    """Nodes of one test in one persistent executor, stepped by the test itself.

    Parameters
    ----------
    context : Context
        Of all nodes.
    executor : Executor
        Of all nodes.
    """

    def __init__(self, context: 'Context', executor: 'Executor') -> None:
        self.context = context
        self._executor = executor
        self._nodes: list[Node] = []
        self._listener: Node | None = None

    def add(self, build: Callable[..., Any], **parameters: object) -> Any:
        """Build a node in the private context with these parameters and add it.

        Parameters
        ----------
        build : callable
            A class of nodes, or a function, that passes keyword arguments on to `rclpy.node.Node`.
        **parameters
            ROS parameters by name.
        """
        from rclpy.parameter import Parameter

        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = build(
            context=self.context, parameter_overrides=overrides, use_global_arguments=False
        )
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def node(self, name: str, **options: Any) -> Any:
        """Add a node that does nothing by itself."""
        from rclpy.node import Node

        return self.add(lambda **private: Node(name, **options, **private))

    def heard(self, kind: type, topic: str, profile: Any = 100) -> list[Any]:
        """Return the messages of a topic, as they come from now on."""
        found: list[Any] = []
        self._listener = self._listener or self.node('listener')
        self._listener.create_subscription(kind, topic, found.append, profile)
        return found

    def wait_for(self, predicate: Callable[[], bool], timeout: float = 60.0) -> None:
        """Step the executor until `predicate` holds; fail the test after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not predicate():
            if time.monotonic() > end:
                pytest.fail(f'still waiting after {timeout} s')
            self._executor.spin_once(timeout_sec=0.01)

    def close(self) -> None:
        """Destroy the nodes, newest first."""
        from rclpy.action import ActionClient

        for node in reversed(self._nodes):
            self._executor.remove_node(node)
            node.destroy_node()
            for waitable in list(node.waitables):
                # rclpy leaves it alone, and it would keep the node on the graph
                if isinstance(waitable, ActionClient):
                    waitable.destroy()
        self._executor.shutdown()


def private_domain() -> AbstractContextManager[int]:
    """Return a context with a DDS domain that nobody else uses on this machine meanwhile."""
    from rpms_ros.nodes.common.runner import free_domain, stay_on_this_machine, use_fast_discovery

    use_fast_discovery()
    stay_on_this_machine()
    return free_domain()


@contextmanager
def private_context(domain: int) -> Iterator['Context']:
    """Initialise a context of its own in a DDS domain, and shut it down."""
    import rclpy
    from rclpy.context import Context

    private = Context()
    rclpy.init(args=[], context=private, domain_id=domain)
    try:
        yield private
    finally:
        private.try_shutdown()


@contextmanager
def running_graph(context: 'Context') -> Iterator[Graph]:
    """Make an executor for the nodes of a test, and let go of all of them."""
    from rclpy.experimental.events_executor import EventsExecutor

    graph = Graph(context, EventsExecutor(context=context))
    try:
        yield graph
    finally:
        graph.close()
