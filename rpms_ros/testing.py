# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for pytest: a simulated muscle whose truth is known, on the real graph.

Take them as a plugin, in the module of a test or in the ``conftest.py`` at the root of your
tests::

    pytest_plugins = ['rpms_ros.testing']


    def test_my_node_sees_the_pull(simulated_muscle):
        muscle = simulated_muscle(maximum_force=20.0)
        node = muscle.graph.add(MyNode)
        muscle.stimulate([1.0] * 10)
        muscle.graph.wait_for(lambda: node.alarms > 0)

Each test has a DDS domain of its own, which no other test uses meanwhile, on this machine alone.
Nodes are real ones in one executor, which the test steps by waiting: nothing sleeps.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.node import Node

    from rpms_ros.identification import Estimate
    from rpms_ros.muscle.simulation import Truth

# Pulses may be known to everybody so long before they come; an identifier drops those beyond 10 s.
LONGEST_TRAIN_S = 8.0
_LEAD_NS = 50_000_000


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


class SimulatedMuscle:
    """A plant simulator, an identifier if asked for, and what they publish.

    Parameters
    ----------
    graph : Graph
        Where the nodes are added.
    identifier : bool or dict
        Whether there is an identifier; a dictionary has its parameters.
    namespace : str
        Of all nodes: of several muscles, each has its own.
    **plant
        Parameters of the plant simulator.

    Attributes
    ----------
    graph : Graph
        Where your nodes are added.
    plant : PlantSimulator
        The simulated muscle; its force goes to ``force``.
    identifier : Identifier or None
        What identifies it.
    stamp_ns, forces : list of int, list of float
        Every force sample that came [ns], [N].
    estimates : list of Estimate
        Every estimate that came.
    """

    def __init__(
        self,
        graph: Graph,
        identifier: bool | dict[str, object] = False,
        namespace: str = '',
        **plant: Any,
    ) -> None:
        from geometry_msgs.msg import WrenchStamped
        from rclpy.node import Node

        from rpms_msgs.msg import MuscleEstimate, Pulse
        from rpms_ros.nodes.common import qos, topics
        from rpms_ros.nodes.identifier import Identifier
        from rpms_ros.nodes.plant_simulator import PlantSimulator

        self.graph = graph
        self.stamp_ns: list[int] = []
        self.forces: list[float] = []
        self.estimates: list[Estimate] = []
        self._sequence = 0

        def within(kind: Callable[..., Node], *name: str) -> Callable[..., Node]:
            return lambda **options: kind(*name, namespace=namespace, **options)

        self._node = graph.add(within(Node, 'test_of_a_muscle'))
        listen = self._node.create_subscription
        listen(WrenchStamped, topics.FORCE, self._on_force, qos.FORCE)
        listen(MuscleEstimate, topics.ESTIMATE, self._on_estimate, qos.ESTIMATE)
        self._pulses = self._node.create_publisher(Pulse, topics.PULSES, qos.PULSES)
        chosen = identifier if isinstance(identifier, dict) else {}
        self.identifier = (
            graph.add(within(Identifier), **chosen) if identifier is not False else None
        )
        listeners = 1 if self.identifier is None else 2
        self.plant = graph.add(within(PlantSimulator), minimum_subscribers=listeners, **plant)
        graph.wait_for(lambda: self._pulses.get_subscription_count() >= listeners)
        graph.wait_for(lambda: bool(self.forces))

    @property
    def truth(self) -> 'Truth':
        """What is true of the muscle now: curve, thresholds, time constant, latency."""
        truth: Truth = self.plant.plant.truth()
        return truth

    def stimulate(self, intensity: Sequence[float], rate_hz: float = 20.0) -> int:
        """Give pulses from a moment after the newest sample on; return the onset of the last [ns].

        Parameters
        ----------
        intensity : sequence of float
            Share of the maximum, 0..1, of each pulse.
        rate_hz : float
            Pulses a second [Hz].

        Raises
        ------
        ValueError
            If there is no pulse, or they take longer than `LONGEST_TRAIN_S`.
        """
        from rpms_ros import messages
        from rpms_ros.nodes.common.topics import MESSAGE_TYPES
        from rpms_ros.pulses import Pulse

        duration = len(intensity) / rate_hz
        if not 0.0 < duration <= LONGEST_TRAIN_S:
            raise ValueError(
                f'expected pulses for at most {LONGEST_TRAIN_S} s, got {len(intensity)} in '
                f'{duration} s'
            )
        onset_ns = start_ns = self.stamp_ns[-1] + _LEAD_NS
        for index, share in enumerate(intensity):
            onset_ns = start_ns + round(index / rate_hz * 1e9)
            pulse = Pulse(onset_ns, float(share), self._sequence)
            self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
            self._sequence += 1
        return onset_ns

    def wait_until(self, stamp_ns: int, timeout: float = 60.0) -> None:
        """Wait until the sample of this stamp has come, and its estimate where one identifies."""
        self.graph.wait_for(lambda: self.stamp_ns[-1] >= stamp_ns, timeout)
        if self.identifier is not None:
            self.graph.wait_for(
                lambda: bool(self.estimates) and self.estimates[-1].stamp_ns >= stamp_ns, timeout
            )

    def _on_force(self, message: Any) -> None:
        from rpms_ros import messages

        settings = self.plant.settings
        axis = messages.axis_of(settings.axis)
        stamp_ns, force = messages.force_of(message, axis, settings.quantity)
        self.stamp_ns.append(stamp_ns)
        self.forces.append(force)

    def _on_estimate(self, message: Any) -> None:
        from rpms_ros import estimate_messages

        self.estimates.append(estimate_messages.estimate_of(message))


def private_domain() -> int:
    """Return a DDS domain that nobody uses on this machine."""
    from rpms_ros.nodes.common.runner import (
        free_domain,
        stay_on_this_machine,
        use_fast_discovery,
    )

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


@pytest.fixture
def ros_domain() -> int:
    """Number of a DDS domain that is this test's alone."""
    return private_domain()


@pytest.fixture
def ros_graph(ros_domain: int) -> Iterator[Graph]:
    """Executor for nodes of this test, in a domain of its own."""
    with private_context(ros_domain) as context, running_graph(context) as graph:
        yield graph


@pytest.fixture
def simulated_muscle(ros_graph: Graph) -> Callable[..., SimulatedMuscle]:
    """Make a simulated muscle on the graph of this test.

    Keywords are those of `SimulatedMuscle`.
    """

    def build(**options: Any) -> SimulatedMuscle:
        return SimulatedMuscle(ros_graph, **options)

    return build
