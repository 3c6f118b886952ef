# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that serves the live page: one muscle in a browser, while it is stimulated.

The thread of the server hears the topics and draws; the executor serves the rest.  A second node,
that is in no executor, is read ten times a second: a message costs a few microseconds so, where
rclpy would wake up a thousand times a second.  The subscriptions ask for nothing but best effort,
so they hear every publisher, and no publisher ever waits for them.

The stop of the page is an additional one, which does not replace a stop button.  A button that
says its state all the time would count as the one that a driver asks for, and its silence would
stop.  This one is not on the graph until it is pressed.  Then it calls the driver's service, again
and again until the driver says that it is stopped, and says "pressed" on the topic of the
buttons, which a driver hears even while its executor is blocked.  Let go of, it says "released"
and leaves; the driver stays stopped until somebody resets it.
"""

import math
import os
import platform
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from rpms_msgs.msg import DriverStatus, MuscleEstimate, Pulse
from rpms_ros import estimate_messages, messages
from rpms_ros.axis import FORCE, UNITS, Axis, unit_vector
from rpms_ros.errors import MessageError, NodeError
from rpms_ros.live import live_session as shown
from rpms_ros.live.force_course import forces_of, warm_up
from rpms_ros.live.live_session import LiveSession
from rpms_ros.live.server import Access, LiveServer, token_of
from rpms_ros.live.topic_health import Publisher, Topic
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import PERIOD_S, logger_of
from rpms_ros.nodes.common.operator import ButtonPublisher
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter, sensed
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.nodes.common.subscriptions import drained, queued_subscription

_Data = TypeVar('_Data', bytes, list[bytes])

# Topic, type and longest silence [s] of what is shown.
_TYPES: dict[str, tuple[str, type, float]] = {
    shown.FORCE: (topics.FORCE, WrenchStamped, 0.5),
    # no pulses are no fault
    shown.PULSES: (topics.PULSES, Pulse, float('inf')),
    shown.ESTIMATE: (topics.ESTIMATE, MuscleEstimate, 2.0),
    shown.DRIVER: (topics.DRIVER_STATUS, DriverStatus, 1.0),
}

# Bytes of a message up to the end of its stamp, with which each of them begins.
_SHORTEST = 12
# Texts are written twice a second: of the estimates every third look reads the newest.
_ESTIMATE_PERIOD = 0.25


class LiveListener:
    """Hands what has come to the session.

    Parameters
    ----------
    node : NodeOfParts
        The page's.
    session : LiveSession
        What is shown.
    axis : tuple of float
        Direction of the wrench along which the muscle pulls.
    quantity : str
        `FORCE` or `TORQUE`: what the sensor measures.
    """

    def __init__(
        self, node: NodeOfParts, session: LiveSession, axis: Axis, quantity: str = FORCE
    ) -> None:
        self._session, self._axis, self._quantity = session, axis, quantity
        self._node = node.second_node()
        self._subscriptions = {
            key: queued_subscription(self._node, kind, session.topics[key].name, qos.VIEW)
            for key, (_, kind, _) in _TYPES.items()
        }
        self._unread: list[bytes] = []
        self._next_estimate = -math.inf

    def listen(self, now: float) -> None:
        """Take everything that has come by `now` [s], of a steady clock."""
        # pulses first: the force that they cause is modelled with them
        for data in self._heard(shown.PULSES, now):
            self._read(shown.PULSES, self._pulse, data)
        if samples := self._heard(shown.FORCE, now):
            self._read(shown.FORCE, self._force, samples)
        self._unread = self._heard(shown.ESTIMATE, now)[-1:] or self._unread
        if self._unread and now >= self._next_estimate:
            self._next_estimate = now + _ESTIMATE_PERIOD
            self._read(shown.ESTIMATE, self._estimate, self._unread.pop())
        # a state replaces the one before it
        for data in self._heard(shown.DRIVER, now)[-1:]:
            self._read(shown.DRIVER, self._driver, data)

    def publishers(self) -> dict[str, list[Publisher]]:
        """Return who publishes each topic."""
        return {
            key: [
                Publisher(f'{one.node_namespace.rstrip("/")}/{one.node_name}', one.topic_type)
                for one in self._node.get_publishers_info_by_topic(topic.name)
            ]
            for key, topic in self._session.topics.items()
        }

    def _heard(self, key: str, now: float) -> list[bytes]:
        found = [taken.data for taken in drained(self._subscriptions[key])]
        stamped = bool(found) and len(found[-1]) >= _SHORTEST
        stamp_ns = messages.stamp_of_bytes(found[-1]) if stamped else 0
        self._session.topics[key].heard(len(found), now, stamp_ns)
        return found

    def _read(self, key: str, read: Callable[[_Data], None], data: _Data) -> None:
        try:
            read(data)
            self._session.topics[key].refused = ''
        except MessageError as error:
            self._session.topics[key].refused = str(error)

    def _force(self, samples: list[bytes]) -> None:
        stamp_ns, force = forces_of(samples, self._axis, self._quantity)
        self._session.force(stamp_ns, force)
        if bad := len(samples) - len(stamp_ns):
            raise MessageError(f'expected serialised WrenchStamped, got {bad} that are none')

    def _pulse(self, data: bytes) -> None:
        self._session.pulse(messages.pulse_of(_message(data, Pulse)))

    def _estimate(self, data: bytes) -> None:
        message = _message(data, MuscleEstimate)
        self._session.estimate(estimate_messages.estimate_of(message))
        self._session.call(message.header.frame_id)

    def _driver(self, data: bytes) -> None:
        self._session.driver(_message(data, DriverStatus))


def _message(data: bytes, kind: Any) -> Any:
    """Return a message of its bytes, which a node with another definition may have written."""
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # of rmw, of rclpy, or of a text that is none
        fault = f'expected a serialised {kind.__name__}, got {len(data)} bytes that are none'
        raise MessageError(fault) from error


_LOOK_S = 0.02
_REPEAT_S = 0.1
# How long "released" is said before the button leaves: longer than a driver needs to hear it.
_FAREWELL_S = 0.5
# "pressed" is said as long, also if it is let go of sooner: a driver has to find the button first.
_LEAST_S = 0.5
# After this time a driver that says nothing of a stop is taken for one that has not heard it.
_CONFIRMATION_S = 1.0

UNCONFIRMED = 'NOT CONFIRMED by the driver: use the switch of the stimulator'


class LiveStop:
    """Presses and releases the stop; `press` and `let_go` may be called by any thread.

    Parameters
    ----------
    node : Node
        The page's; its executor serves the timer and the service's client.
    stopped : callable
        Tells whether a driver that is heard says that a stop is latched.
    tell : callable
        Told, in the executor's thread, whether it is pressed, and what to show.
    """

    def __init__(
        self, node: Node, stopped: Callable[[], bool], tell: Callable[[bool, str], None]
    ) -> None:
        self._node, self._stopped, self._tell = node, stopped, tell
        self._lock = threading.Lock()
        self._wanted = self._confirmed = False
        self._pressed_at = self._held_until = self._next_call = self._leaves_at = 0.0
        self._button: ButtonPublisher | None = None
        self._client = node.create_client(Trigger, topics.EMERGENCY_STOP)
        every(node, _LOOK_S, self._look)

    def press(self) -> None:
        """Stop the driver at once, and keep the stop pressed."""
        with self._lock:
            if not self._wanted:
                self._wanted, self._pressed_at = True, time.monotonic()
                self._held_until, self._confirmed = math.inf, False
            self._call()

    def let_go(self) -> None:
        """Release the stop."""
        with self._lock:
            self._wanted = False

    def _call(self) -> None:
        self._next_call = time.monotonic() + _REPEAT_S
        if self._client.service_is_ready():
            self._client.call_async(Trigger.Request())

    def _look(self) -> None:
        with self._lock:
            now = time.monotonic()
            held = self._wanted or now < self._held_until
            (self._hold if held else self._leave)(now)

    def _hold(self, now: float) -> None:
        if self._button is None:
            self._button = ButtonPublisher(self._node, pressed=True)
            self._button.say()
            logger_of(self._node).warning('stop pressed on the page')
        self._button.set(True)
        self._held_until = min(self._held_until, now + _LEAST_S)
        self._confirmed = self._stopped()
        if not self._confirmed and now >= self._next_call:
            self._call()
        said = 'stop pressed, waiting for the driver'
        if self._confirmed:
            said = 'stopped: the driver confirms it; let go here, then reset at the driver'
        elif now > self._pressed_at + _CONFIRMATION_S:
            said = UNCONFIRMED
        self._tell(True, said)
        self._leaves_at = now + _FAREWELL_S

    def _leave(self, now: float) -> None:
        if self._button is None:
            return
        self._button.set(False)
        self._confirmed = self._confirmed or self._stopped()
        said = 'released: the driver stays stopped until it is reset'
        if not self._confirmed:
            said = f'released; the stop was {UNCONFIRMED}'
        if now >= self._leaves_at:
            self._button.destroy()
            self._button = None
            said = '' if self._confirmed else said
            logger_of(self._node).info('stop of the page released')
        self._tell(False, said)


PORT = 8765


@dataclass(frozen=True)
class LivePageParameters(NodeParameters):
    """Parameters of the live page."""

    address: str = parameter(
        '127.0.0.1', 'Address of this machine to listen on; 0.0.0.0 lets the network look.'
    )
    port: int = parameter(PORT, 'Port to listen on; 0 takes a free one.', bounds=(0, 65535))
    names: tuple[str, ...] = parameter(('localhost',), 'Names that the page may be asked for by.')
    token_file: str = parameter(
        '', "File, its owner's alone, with the token of the stop; empty for a page without one."
    )
    axis: str = parameter(
        'z', 'Axis along which the muscle pulls: x, y, z, -x, -y, -z or 0.6,0,0.8.', true_is='y'
    )
    quantity: str = sensed('What the sensor measures: a force, or a torque.')


class LivePage(NodeOfParts):
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
        self._token = token
        super().__init__('live_page', **options)

    def _build(self) -> None:
        self.settings = settings = declare_parameters(self, LivePageParameters)
        axis, token = unit_vector(settings.axis), self._token
        if settings.token_file and not token:
            token = token_of(Path(settings.token_file).expanduser())
        heard = {
            key: Topic(
                self.resolve_topic_name(name),
                topics.type_name_of(kind),
                silence,
                seldom=key == shown.ESTIMATE,
            )
            for key, (name, kind, silence) in _TYPES.items()
        }
        namespace, own = self.get_namespace(), self.get_fully_qualified_name()
        unit, first = UNITS[settings.quantity], _first_curve_s()
        self.session = LiveSession(namespace, heard, bool(token), unit, own, first)
        self.stop = LiveStop(self, self._stopped, self._tell) if token else None
        self.listener = LiveListener(self, self.session, axis, settings.quantity)
        access, place = Access(token, settings.names), (settings.address, settings.port)
        self.server = LiveServer(self.session, self.listener.listen, access, self.stop, *place)
        self._parts.callback(self.server.close)
        warm_up()
        self.server.start()
        self._look()
        every(self, PERIOD_S, self._look)
        does = 'its stop needs the token' if token else 'it only shows'
        logger_of(self).info(f'{self.server.url} shows {namespace}; {does}')

    def _look(self) -> None:
        """Look at the graph, and at the server, once a second."""
        if self.server.failure is not None:
            raise NodeError(f'expected the page to be served, got {self.server.failure!r}')
        found = self.listener.publishers()

        def take_over() -> None:
            for key, publishers in found.items():
                self.session.topics[key].publishers = publishers

        # the session belongs to the thread of the server
        self.server.call(take_over)

    def _stopped(self) -> bool:
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


# Runs the live page as a process.
main = partial(run, LivePage)
