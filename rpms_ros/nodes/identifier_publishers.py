# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Who publishes what the identifier hears: more than one, or best effort only."""

from collections import deque
from dataclasses import replace

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from rpms_ros.identification import Estimate
from rpms_ros.identification import faults
from rpms_ros.nodes import topics

# Seconds for which a second publisher is a reason to doubt, as other faults are.
_SECONDS = 30


class Publishers:
    """Looks at the publishers on the graph, once a second.

    Parameters
    ----------
    node : Node
        The identifier.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.best_effort_alone = False
        self._recent: deque[tuple[str, ...]] = deque(maxlen=_SECONDS)

    def look(self) -> bool:
        """Note topics with more publishers than one.

        Returns whether all publishers of the force are best effort, which a reliable subscription
        does not hear.
        """
        crowded = []
        for name, topic in (
            (faults.FORCE_PUBLISHERS, topics.FORCE),
            (faults.PULSE_PUBLISHERS, topics.PULSES),
        ):
            found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
            if len({tuple(one.endpoint_gid) for one in found}) > 1:
                crowded.append(name)
            if topic == topics.FORCE:
                self.best_effort_alone = bool(found) and all(
                    one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in found
                )
        self._recent.append(tuple(crowded))
        return self.best_effort_alone

    def noted(self, estimate: Estimate) -> Estimate:
        """Return the estimate with what was found here among its doubts."""
        recent = {name for names in self._recent for name in names} - set(estimate.doubts)
        return (
            replace(estimate, doubts=(*estimate.doubts, *sorted(recent))) if recent else estimate
        )
