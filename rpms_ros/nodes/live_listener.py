# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of the live page, read without the executor.

A second node, that is in no executor, is read ten times a second, and less often while nobody
looks: a message costs a few microseconds so, where rclpy would wake up a thousand times a second.
The subscriptions ask for nothing but best effort, so they hear every publisher, and no publisher
ever waits for them.
"""

import math
import struct
from collections.abc import Callable
from typing import Any
from typing import TypeVar

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message

from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse
from rpms_ros import estimate_messages
from rpms_ros.axis import FORCE
from rpms_ros.axis import Axis
from rpms_ros.errors import MessageError
from rpms_ros.live import session as shown
from rpms_ros.live.heard import Endpoint
from rpms_ros.live.heard import Topic
from rpms_ros.live.serialized_force import alike
from rpms_ros.live.serialized_force import forces_of
from rpms_ros.live.serialized_pulse import pulse_in
from rpms_ros.live.session import LiveSession
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.overridable import second_node
from rpms_ros.nodes.overridable import subscribe
from rpms_ros.nodes.overridable import warn_of_unused
from rpms_ros.nodes.taking import Taker
from rpms_ros.pulses import NANOSECONDS_PER_SECOND

_Data = TypeVar('_Data', bytes, list[bytes])

SUFFIX = '_watch'
"""What the name of the second node adds to the page's."""

TYPES: dict[str, tuple[str, type, float]] = {
    shown.FORCE: (topics.FORCE, WrenchStamped, 0.5),
    # no pulses are no fault
    shown.PULSES: (topics.PULSES, Pulse, float('inf')),
    shown.ESTIMATE: (topics.ESTIMATE, MuscleEstimate, 2.0),
    shown.DRIVER: (topics.DRIVER_STATUS, DriverStatus, 1.0),
}
"""Topic, type and longest silence [s] of what is shown."""

# A second at the highest rate of a sensor; what is behind it is taken with the next look.
_MOST = 20000
# Texts are written twice a second: of the estimates every third look reads the newest.
_ESTIMATE_PERIOD = 0.25


def expected_topics(node: Node) -> dict[str, Topic]:
    """Return the topics of a page, with the names that they have for `node`."""
    return {
        key: Topic(node.resolve_topic_name(name), type_name_of(kind), silence)
        for key, (name, kind, silence) in TYPES.items()
    }


def type_name_of(kind: Any) -> str:
    """Return the name of a message class, such as ``rpms_msgs/msg/Pulse``."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


class LiveListener:
    """Hands what has come to the session.

    Parameters
    ----------
    node : Node
        The page's.
    session : LiveSession
        What is shown.
    axis : tuple of float
        Direction of the wrench along which the muscle pulls.
    quantity : str
        `FORCE` or `TORQUE`: what the sensor measures.
    """

    def __init__(
        self, node: Node, session: LiveSession, axis: Axis, quantity: str = FORCE
    ) -> None:
        self._page = node
        self._session = session
        self._axis = axis
        self._quantity = quantity
        self._node = second_node(node, SUFFIX)
        with complete_or_gone(self._node):
            self._takers = {key: self._taker(key) for key in TYPES}
        warn_of_unused(node)
        self._unread: list[bytes] = []
        self._next_estimate = -math.inf

    def listen(self, now: float) -> None:
        """Take everything that has come by `now` [s], of a steady clock."""
        # pulses first: the force that they cause is modelled with them
        for data in self._heard(shown.PULSES, now):
            self._read(shown.PULSES, self._pulse, data)
        for run in alike(self._heard(shown.FORCE, now)):
            self._read(shown.FORCE, self._force, run)
        self._unread = self._heard(shown.ESTIMATE, now)[-1:] or self._unread
        if self._unread and now >= self._next_estimate:
            self._next_estimate = now + _ESTIMATE_PERIOD
            self._read(shown.ESTIMATE, self._estimate, self._unread.pop())
        # a state replaces the one before it
        for data in self._heard(shown.DRIVER, now)[-1:]:
            self._read(shown.DRIVER, self._driver, data)

    def endpoints(self) -> dict[str, list[Endpoint]]:
        """Return who publishes and hears each topic, without this node."""
        return {key: self._endpoints(topic.name) for key, topic in self._session.topics.items()}

    def close(self) -> None:
        """End the second node; `listen` must not be called any more."""
        for taker in self._takers.values():
            taker.close()
        self._node.destroy_node()

    def _taker(self, key: str) -> Taker:
        _, kind, _ = TYPES[key]
        name = self._session.topics[key].name
        # overrides of the quality of service are parameters of the page
        return Taker(subscribe(self._page, self._node, kind, name, qos.VIEW))

    def _heard(self, key: str, now: float) -> list[bytes]:
        found = self._takers[key].take_data(_MOST)
        self._session.topics[key].heard(len(found), now, _stamp_of(found[-1]) if found else 0)
        return found

    def _read(self, key: str, read: Callable[[_Data], None], data: _Data) -> None:
        try:
            read(data)
            self._session.topics[key].refused = ''
        except MessageError as error:
            self._session.topics[key].refused = str(error)

    def _force(self, run: list[bytes]) -> None:
        self._session.force(*forces_of(run, self._axis, self._quantity))

    def _pulse(self, data: bytes) -> None:
        self._session.pulse(pulse_in(data))

    def _estimate(self, data: bytes) -> None:
        message = _message(data, MuscleEstimate)
        self._session.estimate(estimate_messages.estimate_of(message))
        self._session.call(message.header.frame_id)

    def _driver(self, data: bytes) -> None:
        self._session.driver(_message(data, DriverStatus))

    def _endpoints(self, topic: str) -> list[Endpoint]:
        own = self._node.get_name()
        found = [
            (publishes, one)
            for publishes, ask in (
                (True, self._node.get_publishers_info_by_topic),
                (False, self._node.get_subscriptions_info_by_topic),
            )
            for one in ask(topic)
        ]
        return [
            Endpoint(
                f'{one.node_namespace.rstrip("/")}/{one.node_name}',
                one.topic_type,
                publishes,
                one.qos_profile.reliability is ReliabilityPolicy.RELIABLE,
                one.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL,
            )
            for publishes, one in found
            if publishes or one.node_name != own
        ]


def _stamp_of(data: bytes) -> int:
    """Return the stamp of a serialised message [ns], with which each of them begins; 0 if none."""
    order = '<' if data[1:2] and data[1] & 1 else '>'
    head = data[4:12]
    if len(head) < 8:
        return 0
    seconds, rest = struct.unpack(f'{order}iI', head)
    return int(seconds * NANOSECONDS_PER_SECOND + rest)


def _message(data: bytes, kind: Any) -> Any:
    """Return a message of its bytes, which a node with another definition may have written."""
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # of rmw, of rclpy, or of a text that is none
        raise MessageError(
            f'expected a serialised {kind.__name__}, got {len(data)} bytes that are none'
        ) from error
