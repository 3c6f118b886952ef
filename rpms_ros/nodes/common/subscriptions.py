# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics from which a node takes what has come, in the order of arrival, when it looks.

An executor of rclpy hands out messages topic by topic.  Subscriptions of a second node, which is
in no executor, keep them with the time of their reception.
"""

from itertools import islice
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from rpms_ros.nodes.common.qos import VIEW


def second_node(node: Node, suffix: str = '_subscriptions') -> Node:
    """Return a node of the same context and namespace that no executor and no service knows.

    What its subscriptions get is taken from them with `drained`.

    Parameters
    ----------
    node : Node
        Whose name it bears, with `suffix` behind it.
    suffix : str
        By which people and policies know it.
    """
    return Node(
        node.get_name() + suffix,
        namespace=node.get_namespace(),
        context=node.context,
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )


def queued_subscription(node: Node, kind: Any, name: str, profile: QoSProfile) -> Subscription:
    """Create a subscription whose messages are taken with `drained`."""
    # rclpy requires a callback
    return node.create_subscription(kind, name, lambda _: None, profile)


# Most messages taken at once: more than a queue holds.
_MOST = 20_000


class Taken(NamedTuple):
    """One message, serialised; its number, counted by its publisher, if known; reception [ns]."""

    data: bytes
    sequence: int | None
    received_ns: int


def drained(subscription: Subscription | None) -> list[Taken]:
    """Return the waiting messages of a subscription that no executor serves; none for None."""
    if subscription is None:
        return []
    handle = subscription.handle
    with handle:
        waiting = iter(lambda: handle.take_message(subscription.msg_type, True), None)
        return [
            Taken(data, about['publication_sequence_number'], about['received_timestamp'])
            for data, about in islice(waiting, _MOST)
        ]


class QueuedTopic:
    """Hears a topic reliably, and best effort where nobody publishes it otherwise.

    Parameters
    ----------
    named : Node
        Node with the remappings of topics.
    listener : Node
        Node that owns the subscriptions; it is in no executor.
    kind : type
        Message class.
    topic : str
        Name of the topic, relative to the first node.
    profile : QoSProfile
        Reliable quality of service.

    Attributes
    ----------
    name : str
        Whole name of the topic.
    """

    def __init__(
        self, named: Node, listener: Node, kind: Any, topic: str, profile: QoSProfile
    ) -> None:
        self.name = named.resolve_topic_name(topic)
        self._listener, self._kind = listener, kind
        self._reliable = queued_subscription(listener, kind, self.name, profile)
        self._best_effort: Subscription | None = None
        self._alone = False

    def look(self) -> bool:
        """Look at the publishers; return whether it is heard best effort from now on."""
        infos = self._listener.get_publishers_info_by_topic(self.name)
        self._alone = bool(infos) and all(
            one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in infos
        )
        begins = self._alone and self._best_effort is None
        if begins:
            self._best_effort = queued_subscription(self._listener, self._kind, self.name, VIEW)
        return begins

    def taken(self) -> list[Taken]:
        """Return what has come; both subscriptions receive from reliable publishers."""
        reliable, best_effort = drained(self._reliable), drained(self._best_effort)
        return reliable + best_effort if self._alone else reliable
