# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics from which a node takes what has come, in the order of arrival, when it looks.

An executor of rclpy hands out messages topic by topic.  Subscriptions of a second node, which is
in no executor, keep them with the time of their reception.
"""

from heapq import merge
from itertools import islice
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from rpms_ros.nodes.common.qos import VIEW
from rpms_ros.nodes.common.topics import type_name_of


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
    """One message, serialised, by its publisher's count and clock; reception [ns]."""

    data: bytes
    sequence: int | None
    received_ns: int
    sent_ns: int


# Of what rclpy tells about a message, in the order of `Taken`.
_numbers_of = itemgetter('publication_sequence_number', 'received_timestamp', 'source_timestamp')


def drained(subscription: Subscription | None) -> list[Taken]:
    """Return the waiting messages of a subscription that no executor serves; none for None."""
    if subscription is None:
        return []
    handle = subscription.handle
    with handle:
        waiting = iter(lambda: handle.take_message(subscription.msg_type, True), None)
        return [Taken(data, *_numbers_of(about)) for data, about in islice(waiting, _MOST)]


class QueuedTopic:
    """Hears a topic reliably, and best effort too once nobody publishes it otherwise.

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
    publishers : int
        Most that there were at a time.
    lost : int
        Messages that are missing in the numbers of the publisher; of several it is not known.
    foreign : str
        What is published there that cannot be heard, since it is of another type; else empty.
    """

    def __init__(
        self, named: Node, listener: Node, kind: Any, topic: str, profile: QoSProfile
    ) -> None:
        self.name = named.resolve_topic_name(topic)
        self._listener, self._kind = listener, kind
        self._lasting = profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
        self._reliable = queued_subscription(listener, kind, self.name, profile)
        self._best_effort: Subscription | None = None
        # messages that came, of which the other subscription may have a copy
        self._seen: dict[tuple[int | None, int], None] = {}
        self._newest: int | None = None
        self._gids: set[tuple[int, ...]] = set()
        self.publishers, self.lost, self.foreign = 0, 0, ''

    def look(self) -> str:
        """Look at the publishers; say that it is heard best effort from now on, else nothing."""
        if not self._listener.context.ok():
            # the process is about to end, and the graph cannot be asked any more
            return ''
        found = self._listener.get_publishers_info_by_topic(self.name)
        own = type_name_of(self._kind)
        infos = [one for one in found if one.topic_type == own]
        gids = {tuple(one.endpoint_gid) for one in infos}
        others = ', '.join(sorted({one.topic_type for one in found} - {own}))
        self.foreign = f'expected {own} on {self.name}, got {others}' if others else ''
        if self._gids and gids - self._gids:
            # one that is new begins its numbers anew
            self._newest = None
        # while nobody publishes, the last ones
        self._gids = gids or self._gids
        self.publishers = max(self.publishers, len(infos))
        # publishers of less than the profile asks for
        best = [
            one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
            or (self._lasting and one.qos_profile.durability is DurabilityPolicy.VOLATILE)
            for one in infos
        ]
        if best and all(best) and self._best_effort is None:
            self._best_effort = queued_subscription(self._listener, self._kind, self.name, VIEW)
            less = 'without keeping the last message' if self._lasting else 'best effort'
            return f'{self.name} is published {less}: it is heard, and messages may be lost'
        if best and not any(best) and self._best_effort is not None:
            # what is lost and sent again would come late, behind its neighbours
            self._listener.destroy_subscription(self._best_effort)
            self._best_effort = None
        return ''

    def taken(self) -> list[Taken]:
        """Return what has come, and count what has not.

        From reliable publishers both subscriptions receive, at different times.
        """
        found = drained(self._reliable)
        if self._best_effort is not None:
            both = merge(found, drained(self._best_effort), key=attrgetter('received_ns'))
            found = [one for one in both if self._is_new(one)]
        for one in found:
            newest, sequence = self._newest, one.sequence
            if newest is not None and sequence is not None and sequence > newest + 1:
                self.look()
                if self._newest is not None and len(self._gids) < 2:
                    self.lost += sequence - newest - 1
            self._newest = sequence
        return found

    def _is_new(self, taken: Taken) -> bool:
        key = taken.sequence, taken.sent_ns
        new = key not in self._seen
        self._seen[key] = None
        if len(self._seen) > 2 * _MOST:
            del self._seen[next(iter(self._seen))]
        return new
