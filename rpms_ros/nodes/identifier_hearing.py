# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force and pulses for the identifier in the order of arrival, with their publishers.

An executor of rclpy hands out messages without their publisher, and topic by topic.  Here the
subscriptions belong to a second node that is in no executor; what has come is taken from them
when the identifier looks.
"""

from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.axis import Axis
from rpms_ros.identification.arrival_order import Foreign
from rpms_ros.identification.first_publisher import FirstPublisher
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.overridable import second_node
from rpms_ros.nodes.overridable import subscribe
from rpms_ros.nodes.overridable import taken_from
from rpms_ros.nodes.taking import Taken
from rpms_ros.nodes.taking import Taker
from rpms_ros.nodes.taking import drained
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import Pulse
from rpms_ros.pulses import PulseTrain

SUFFIX = '_hearing'
"""What the name of the second node adds to the identifier's."""


class Heard(NamedTuple):
    """What has come since the last look, in the order of its arrival.

    Attributes
    ----------
    pulses, forces : PulseTrain, ForceTrace
        Of the publishers that are listened to.
    before : ndarray of int64 (pulses,)
        How many of the samples came before each pulse.
    foreign : Foreign
        What came of other publishers.
    """

    pulses: PulseTrain
    forces: ForceTrace
    before: IntArray
    foreign: Foreign


class Hearing:
    """Subscriptions to force and pulses.

    Parameters
    ----------
    node : Node
        The identifier.
    axis : Axis
        Along which the muscle pulls.
    quantity : str
        What the sensor measures, force or torque.
    profile : QoSProfile
        Of the subscription to the force.
    silence_ns : int
        After which another publisher is listened to [ns].
    """

    def __init__(
        self, node: Node, axis: Axis, quantity: str, profile: QoSProfile, silence_ns: int
    ) -> None:
        self._named = node
        self._axis = axis
        self._quantity = quantity
        self.sensor_frame = ''
        self._silence_ns = silence_ns
        self._node = second_node(node, SUFFIX)
        with complete_or_gone(self._node):
            # Overrides of the quality of service are parameters of the identifier.
            pulses = subscribe(node, self._node, PulseMessage, topics.PULSES, qos.PULSES)
            self._pulses = Taker(pulses)
            force = subscribe(node, self._node, WrenchStamped, topics.FORCE, profile)
            self._force = Taker(force)
        self._told_best_effort = force.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
        self._best_effort: Taker | None = None
        # What has come meanwhile is heard: a publisher may have waited for this subscription.
        self._listen_to_the_first()

    @property
    def hears_best_effort(self) -> bool:
        """Whether a force that is published best effort is heard."""
        return self._told_best_effort or self._best_effort is not None

    def hear_best_effort(self) -> None:
        """Subscribe to the force best effort too."""
        name = self._named.resolve_topic_name(topics.FORCE)
        second = taken_from(self._node, WrenchStamped, name, qos.FORCE_BEST_EFFORT)
        self._best_effort = Taker(second)

    def _listen_to_the_first(self) -> None:
        self._force_from = FirstPublisher(self._silence_ns)
        self._pulses_from = FirstPublisher(self._silence_ns)

    def begin_anew(self) -> None:
        """Accept the next publisher of each topic, and forget what has come."""
        self._listen_to_the_first()
        for taker in (self._force, self._pulses, self._best_effort):
            if taker is not None:
                drained(taker)

    def heard(self, best_effort_alone: bool) -> Heard:
        """Return what has come since the last look.

        A reliable force comes twice where best effort is subscribed to as well; it is taken from
        there only if all of its publishers are best effort.
        """
        # Pulses last: none is handed over later than a sample that came after it.
        forces = drained(self._force)
        if self._best_effort is not None:
            besides = drained(self._best_effort)
            forces += besides if best_effort_alone else []
        own, samples, foreign = self._own_forces(forces)
        pulses: list[Pulse] = []
        came_ns: list[int] = []
        onsets: list[int] = []
        others_came_ns: list[int] = []
        for taken in drained(self._pulses):
            pulse = messages.pulse_of(deserialize_message(taken.data, PulseMessage))
            if self._pulses_from.counts(taken.identity, pulse.onset_ns):
                pulses.append(pulse)
                came_ns.append(taken.received_ns)
            else:
                onsets.append(pulse.onset_ns)
                others_came_ns.append(taken.received_ns)
        return Heard(
            PulseTrain.of(pulses),
            samples,
            _places(own, came_ns),
            Foreign(foreign, np.array(onsets, dtype=np.int64), _places(own, others_came_ns)),
        )

    def close(self) -> None:
        """Destroy the second node."""
        for taker in (self._force, self._pulses, self._best_effort):
            if taker is not None:
                taker.close()
        self._node.destroy_node()

    def _own_forces(self, forces: list[Taken]) -> tuple[list[int], ForceTrace, IntArray]:
        """Return when samples came, the samples, and after how many of them those of others."""
        came_ns: list[int] = []
        others: list[int] = []
        stamps: list[int] = []
        values: list[float] = []
        for taken in forces:
            message = deserialize_message(taken.data, WrenchStamped)
            stamp_ns, force = messages.force_of(message, self._axis, self._quantity)
            if self._force_from.counts(taken.identity, stamp_ns):
                self.sensor_frame = message.header.frame_id
                came_ns.append(taken.received_ns)
                stamps.append(stamp_ns)
                values.append(force)
            else:
                others.append(len(stamps))
        trace = ForceTrace(np.array(stamps, dtype=np.int64), np.array(values, dtype=np.float64))
        return came_ns, trace, np.array(others, dtype=np.int64)


def _places(forces_came_ns: list[int], came_ns: list[int]) -> IntArray:
    """Return how many samples came before each of other messages (messages,), ascending."""
    # A clock that is set back within a look must not change the order within a topic.
    arrival = np.maximum.accumulate(np.array(forces_came_ns, dtype=np.int64))
    before = np.searchsorted(arrival, np.array(came_ns, dtype=np.int64))
    return np.maximum.accumulate(before)
