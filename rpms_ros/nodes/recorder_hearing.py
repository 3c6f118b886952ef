# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of a recorder: messages with their publisher, and counts of lost ones.

An executor of rclpy does not tell publisher and number of a message.  So, as in the identifier,
the subscriptions belong to a second node that is in no executor, and the recorder empties them.
"""

import time
from collections.abc import Callable
from collections.abc import Iterator
from typing import Any
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

from rpms_ros.nodes.overridable import second_node
from rpms_ros.nodes.overridable import subscribe
from rpms_ros.nodes.overridable import taken_from
from rpms_ros.nodes.taking import Taker
from rpms_ros.nodes.taking import drained

SUFFIX = '_hearing'
"""Suffix of the name of the second node."""

# Most publishers of a topic that are distinguished; further ones count as one.
_MOST_PUBLISHERS = 64


class HeardMessage(NamedTuple):
    """A received message.

    Attributes
    ----------
    topic : str
        Name of the topic in the parameters.
    publisher : str
        Identity of its publisher.
    received_ns : int
        Time of reception [ns].
    data : bytes
        The message, serialised.
    """

    topic: str
    publisher: str
    received_ns: int
    data: bytes


class _Topic:
    """Subscriptions to one topic, and its publishers so far.

    Attributes
    ----------
    alone : bool
        Whether the topic is published best effort only, received by `best_effort`.
    lost : int
        Messages that were lost, by the sequence numbers of their publishers.
    """

    def __init__(self, name: str, reliable: Taker | None, best_effort: Taker | None) -> None:
        self.name = name
        self.takers = [reliable, best_effort]
        self.alone = reliable is None
        self.lost = 0
        self._identities: dict[bytes, str] = {}
        self._newest: dict[str, int] = {}

    def taken(self) -> Iterator[HeardMessage]:
        reliable, best_effort = (drained(taker) for taker in self.takers)
        # Both subscriptions receive from reliable publishers.
        for taken in [*reliable, *best_effort] if self.alone else reliable:
            publisher = self._named(taken.identity)
            self._count_lost(publisher, taken.sequence)
            yield HeardMessage(
                self.name, publisher, taken.received_ns or time.time_ns(), taken.data
            )

    def _named(self, identity: bytes) -> str:
        if identity not in self._identities and len(self._identities) >= _MOST_PUBLISHERS:
            return 'others'
        return self._identities.setdefault(identity, identity.hex())

    def _count_lost(self, publisher: str, sequence: int) -> None:
        newest = self._newest.get(publisher)
        if newest is not None and publisher != 'others' and sequence > newest + 1:
            self.lost += sequence - newest - 1
        self._newest[publisher] = max(sequence, newest or 0)


class RecorderHearing:
    """Subscriptions of a recorder.

    Parameters
    ----------
    node : Node
        The recorder.
    """

    def __init__(self, node: Node) -> None:
        self._named = node
        self._node = second_node(node, SUFFIX)
        self._topics: dict[str, _Topic] = {}
        self._kinds: dict[str, Any] = {}
        self._closed = False

    @property
    def lost(self) -> dict[str, int]:
        """Lost messages by topic; topics without loss are not included."""
        return {name: topic.lost for name, topic in self._topics.items() if topic.lost}

    def hear(self, name: str, kind: Any, profile: QoSProfile) -> None:
        """Subscribe to a topic; parameters of the recorder may override the quality of service.

        Raises
        ------
        NodeError
            If such a parameter is no quality of service.
        """
        subscription = subscribe(self._named, self._node, kind, name, profile)
        taker = Taker(subscription)
        is_best_effort = subscription.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
        takers = (None, taker) if is_best_effort else (taker, None)
        self._topics[name] = _Topic(name, *takers)
        self._kinds[name] = kind

    def set_alone(self, name: str, alone: bool, profile: Callable[[], QoSProfile]) -> bool:
        """Set whether a topic is published best effort only; return whether that is new."""
        topic = self._topics[name]
        if topic.takers[0] is None:
            return False
        topic.alone = alone
        if not alone or topic.takers[1] is not None:
            return False
        resolved = self._named.resolve_topic_name(name)
        second = taken_from(self._node, self._kinds[name], resolved, profile())
        topic.takers[1] = Taker(second)
        return True

    def heard(self) -> list[HeardMessage]:
        """Return the messages since the last call, in the order of arrival."""
        found: list[tuple[int, HeardMessage]] = []
        for topic in self._topics.values():
            arrived = 0
            for message in topic.taken():
                # A clock that is set back must not change the order within a topic.
                arrived = max(arrived, message.received_ns)
                found.append((arrived, message))
        return [message for _, message in sorted(found, key=lambda one: one[0])]

    def close(self) -> None:
        """Destroy the second node; once is enough."""
        if self._closed:
            return
        self._closed = True
        for topic in self._topics.values():
            for taker in topic.takers:
                if taker is not None:
                    taker.close()
        self._topics.clear()
        self._node.destroy_node()
