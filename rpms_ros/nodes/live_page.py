# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that serves the live page: one muscle in a browser, while it is stimulated.

The thread of the server hears the topics and draws; the executor serves the rest.
"""

import os
import platform
import time
from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros import messages
from rpms_ros.axis import FORCE
from rpms_ros.axis import UNITS
from rpms_ros.errors import NodeError
from rpms_ros.live.access import Access
from rpms_ros.live.access import token_of
from rpms_ros.live.modelled import warm_up
from rpms_ros.live.server import LiveServer
from rpms_ros.live.session import LiveSession
from rpms_ros.nodes import topics
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.diagnostics import PERIOD_S
from rpms_ros.nodes.diagnostics import DiagnosticsPublisher
from rpms_ros.nodes.diagnostics import Health
from rpms_ros.nodes.driver_graph import publishers_of
from rpms_ros.nodes.live_diagnostics import live_health
from rpms_ros.nodes.live_listener import LiveListener
from rpms_ros.nodes.live_listener import expected_topics
from rpms_ros.nodes.live_stop import LiveStop
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import parameter
from rpms_ros.nodes.runner import run

PORT = 8765


@dataclass(frozen=True)
class LivePageParameters(NodeParameters):
    """Parameters of the live page."""

    address: str = parameter(
        '127.0.0.1', 'Address of this machine to listen on; 0.0.0.0 lets the network look.'
    )
    port: int = parameter(PORT, 'Port to listen on; 0 takes a free one.', minimum=0, maximum=65535)
    names: tuple[str, ...] = parameter(
        ('localhost',), 'Names, beside addresses, under which the page may be asked for.'
    )
    token_file: str = parameter(
        '',
        'File, readable by its owner only, with the token that presses the stop; '
        'empty for a page that only shows.',
    )
    axis: str = parameter(
        'z',
        'Axis of the wrench along which the muscle pulls: x, y, z, -x, -y, -z or 0.6,0,0.8.',
        true_is='y',
    )
    quantity: str = parameter(
        FORCE, 'What the sensor measures: a force, or a torque.', choices=tuple(UNITS)
    )


class LivePage(Node):
    """The live page; keyword arguments go to `rclpy.node.Node`.

    Parameters
    ----------
    token : str, optional
        What presses the stop; the one in `token_file` if not given.

    Attributes
    ----------
    server : LiveServer
        The server.

    Raises
    ------
    LiveError
        If the port is taken, or the token is not one to use.
    """

    settings_type = LivePageParameters

    def __init__(self, token: str = '', **options: Any) -> None:
        super().__init__('live_page', **options)
        with complete_or_gone(self) as self._parts:
            self._build(token)

    def _build(self, token: str) -> None:
        """Make the parts of the node, each after those that it depends on."""
        self.settings = settings = declare_parameters(self, LivePageParameters)
        axis = messages.axis_of(settings.axis)
        if settings.token_file and not token:
            token = token_of(Path(settings.token_file).expanduser())
        access = Access(token, settings.names)
        self.session = LiveSession(
            self.get_namespace(),
            expected_topics(self),
            bool(token),
            UNITS[settings.quantity],
            self.get_fully_qualified_name(),
            _first_curve_s(),
        )
        self.stop = LiveStop(self, self._is_stopped, self._tell) if token else None
        self._health: Health | None = None
        self.listener = LiveListener(self, self.session, axis, settings.quantity)
        self._parts.callback(self.listener.close)
        self.server = LiveServer(
            self.session, self.listener.listen, access, self.stop, settings.address, settings.port
        )
        self._parts.callback(self.server.close)
        warm_up()
        self._diagnostics = DiagnosticsPublisher(self, 'live page', self.server.url)
        self.server.start()
        self._look()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD_S, self._look, clock=steady)
        logger_of(self).info(
            f'{self.server.url} shows {self.get_namespace()}; '
            + ('its stop needs the token' if token else 'it only shows')
        )

    def destroy_node(self) -> None:
        """End the server, then the node."""
        self._parts.close()
        Node.destroy_node(self)

    def _look(self) -> None:
        """Look at the graph, and at the server, once a second; say how the page is."""
        if self.server.failure is not None:
            raise NodeError(f'expected the page to be served, got {self.server.failure!r}')
        found = self.listener.endpoints()
        buttons = publishers_of(self, self.resolve_topic_name(topics.EMERGENCY_STOP))
        nodes = {identity.hex(): name for identity, name in buttons.items()}

        def take_over() -> None:
            for key, endpoints in found.items():
                self.session.topics[key].endpoints(endpoints)
            self.session.button_nodes = nodes
            # the session belongs to the thread of the server
            self._health = live_health(self.session, len(self.server.browsers), time.monotonic())

        self.server.call(take_over)
        if self._health is not None:
            self._diagnostics.publish(self._health)

    def _is_stopped(self) -> bool:
        return self.session.confirms_stop(time.monotonic())

    def _tell(self, pressed: bool, text: str) -> None:
        self.server.call(lambda: self.session.stop(pressed, text))


def _first_curve_s() -> float:
    """Return how long it takes to the first curve [s]: as `bench/first_curve.py` measured it."""
    folder = os.environ.get('NUMBA_CACHE_DIR', '')
    compiled = any(Path(folder).glob(f'compiled-*-{platform.node()}')) if folder else False
    return 10.0 if compiled else 60.0


def serve(
    namespace: str,
    token: str,
    parameters: Mapping[str, Any],
    names: Mapping[str, str],
    tell: Callable[[str, str], None],
) -> int:
    """Run the live page in this process until a signal; return the exit code.

    Parameters
    ----------
    namespace : str
        Of the node.
    token : str
        What presses the stop; empty for a page that only shows.
    parameters : mapping of str
        Those of `LivePageParameters` that are not at their default.
    names : mapping of str to str
        What topics are called, by their usual name.
    tell : callable
        Told the address of the page, and the token, once it is served.
    """
    rules = [f'{usual}:={name}' for usual, name in names.items() if usual != name]
    remappings = [part for rule in rules for part in ('-r', rule)]

    def build() -> Node:
        node = LivePage(
            token,
            namespace=namespace,
            parameter_overrides=[Parameter(name, value=v) for name, v in parameters.items()],
            cli_args=['--ros-args', *remappings] if remappings else None,
        )
        tell(node.server.url, token)
        return node

    return run(build, ['rpms live'])


def main() -> int:
    """Run the live page as a process."""
    return run(LivePage)
