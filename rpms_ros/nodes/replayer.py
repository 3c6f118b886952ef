# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that plays a recording: publishes `pulses` and `force`, at a factor or as fast as possible.

As fast as possible means: ahead of the newest estimate by no more messages than the queues of the
identifier hold, so that nothing is lost.  Messages are sent in the order in which they were
received, in the same bytes as a driver and a sensor send.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse
from rpms_ros import estimate_messages
from rpms_ros import messages
from rpms_ros.errors import NodeError
from rpms_ros.identification import Estimate
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import IntArray
from rpms_ros.recording import Recording
from rpms_ros.recording.encoding import encode_forces
from rpms_ros.recording.encoding import encode_pulses

# Messages that may be ahead of the newest estimate: fewer than the queues of the identifier hold.
WINDOW = 2000
# After so long without an estimate, no estimate is due from the messages sent so far [s].
PATIENCE = 0.5
_AXIS = np.array(messages.AXES['z'])
_COIL = 'coil'


@dataclass(frozen=True)
class ReplaySettings:
    """How a recording is played.

    Attributes
    ----------
    factor : float
        Seconds of the recording in one second; 0 for as fast as possible.
    window : int
        Messages that may be ahead of the newest estimate.

    Raises
    ------
    NodeError
        If a value is not possible.
    """

    factor: float = 0.0
    window: int = WINDOW

    def __post_init__(self) -> None:
        if not (np.isfinite(self.factor) and self.factor >= 0.0):
            raise NodeError(f'expected a factor of 0 or above, got {self.factor}')
        if not 1 <= self.window <= WINDOW:
            raise NodeError(f'expected a window of 1 to {WINDOW} messages, got {self.window}')


class Replayer(Node):
    """Plays a recording and keeps the estimates that come back.

    Parameters
    ----------
    recording : Recording
        The recording; its force or torque is published along the z axis.
    settings : ReplaySettings, optional
        Speed.
    **options
        Passed to `rclpy.node.Node`.
    """

    def __init__(
        self, recording: Recording, settings: ReplaySettings | None = None, **options: Any
    ) -> None:
        super().__init__('replayer', **options)
        self.settings = settings or ReplaySettings()
        self.estimates: list[Estimate] = []
        self.sent = 0
        pulses, forces = recording.pulses, recording.forces
        self._is_pulse, self._index, self._due_ns = _order(recording)
        self._pulse_bytes = encode_pulses(pulses, _COIL)
        self._force_bytes = encode_forces(forces, _AXIS, recording.quantity)
        self._force_stamp_ns = np.maximum.accumulate(forces.stamp_ns)
        # how many messages were sent up to each force sample
        self._sent_with_force = np.flatnonzero(~self._is_pulse) + 1
        self._used = 0
        self._started: float | None = None
        self._heard = time.monotonic()
        self._pulses = self.create_publisher(Pulse, topics.PULSES, qos.PULSES)
        self._force = self.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
        self.create_subscription(MuscleEstimate, topics.ESTIMATE, self._on_estimate, qos.ESTIMATE)

    def __len__(self) -> int:
        """Return how many messages there are to send."""
        return len(self._index)

    @property
    def ready(self) -> bool:
        """Whether pulses and force have subscribers and estimates a publisher."""
        return (
            self._pulses.get_subscription_count() > 0
            and self._force.get_subscription_count() > 0
            and self.count_publishers(self.resolve_topic_name(topics.ESTIMATE)) > 0
        )

    @property
    def silence(self) -> float:
        """Time since the last estimate was received or the last message sent [s]."""
        return time.monotonic() - self._heard

    def step(self, most: int = 200) -> int:
        """Send the messages allowed now, at most `most`; return how many were sent."""
        until = min(self._allowed(), self.sent + most)
        for place in range(self.sent, until):
            self._send(place)
        went = until - self.sent
        if went:
            self._heard = time.monotonic()
        self.sent = until
        return went

    def _allowed(self) -> int:
        if self.settings.factor > 0.0:
            return self._due()
        if self.silence > PATIENCE:
            self._used = self.sent
        return min(len(self), self._used + self.settings.window)

    def _due(self) -> int:
        """Return how many messages are due by the clock."""
        now = time.monotonic()
        if self._started is None:
            self._started = now
        elapsed = (now - self._started) * self.settings.factor * NANOSECONDS_PER_SECOND
        return int(np.searchsorted(self._due_ns, elapsed, side='right'))

    def _send(self, place: int) -> None:
        index = int(self._index[place])
        if self._is_pulse[place]:
            self._pulses.publish(self._pulse_bytes.message(index))
        else:
            self._force.publish(self._force_bytes.message(index))

    def _on_estimate(self, message: MuscleEstimate) -> None:
        estimate = estimate_messages.estimate_of(message)
        self.estimates.append(estimate)
        self._heard = time.monotonic()
        used = int(np.searchsorted(self._force_stamp_ns, estimate.stamp_ns, side='right'))
        if used:
            self._used = max(self._used, int(self._sent_with_force[used - 1]))


def _order(recording: Recording) -> tuple[BoolArray, IntArray, IntArray]:
    """Return kind, index and time after the first [ns] of all messages (messages,), as received.

    After the clock was set back, messages are due at the time of those before them.
    """
    counts = len(recording.pulses), len(recording.forces)
    is_pulse = np.repeat([True, False], counts)
    index = np.concatenate([np.arange(count, dtype=np.int64) for count in counts])
    samples_before = np.concatenate([recording.samples_before_pulse, index[counts[0] :]])
    order = np.lexsort((~is_pulse, samples_before))
    received = np.concatenate([recording.pulse_received_ns, recording.force_received_ns])[order]
    return is_pulse[order], index[order], np.maximum.accumulate(received) - received[0]
