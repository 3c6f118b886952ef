"""Node that records topics as they come: raw bytes, nothing deserialised.

What has come is handed to the operating system every `flush_period`: a recorder that is killed
leaves all but the last of it readable.
"""

import time
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node

from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse
from rpms_ros import messages
from rpms_ros.errors import NodeError
from rpms_ros.errors import RecordingError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import parameter
from rpms_ros.nodes.runner import run
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording import RecordingWriter

_TOPICS = {
    topics.PULSES: (Pulse, messages.PULSE, qos.PULSES),
    topics.PULSES_COMMANDED: (Pulse, messages.PULSE, qos.PULSES),
    topics.FORCE: (WrenchStamped, messages.WRENCH_STAMPED, qos.FORCE),
    topics.ESTIMATE: (MuscleEstimate, messages.MUSCLE_ESTIMATE, qos.ESTIMATE),
    topics.DRIVER_STATUS: (DriverStatus, 'rpms_msgs/msg/DriverStatus', qos.STATUS),
}


@dataclass(frozen=True)
class RecorderParameters(NodeParameters):
    """Parameters of the recorder."""

    path: str = parameter(
        '', 'Folder of the recording, which must not exist yet; empty makes a name of the time.'
    )
    storage: str = parameter('mcap', 'Format of the file.', choices=('mcap', 'sqlite3'))
    compression: str = parameter('', 'Of mcap.', choices=('', 'lz4', 'zstd'))
    topics: tuple[str, ...] = parameter(
        (topics.PULSES, topics.FORCE, topics.ESTIMATE), 'Topics.', choices=tuple(_TOPICS)
    )
    best_effort_force: bool = parameter(
        False, 'Hear a force sensor that publishes best effort; samples may then be lost.'
    )
    flush_period: float = parameter(
        0.5, 'Time between two writes to the file.', unit='s', minimum=0.01, maximum=60.0
    )


@dataclass
class TopicCount:
    """What a recorder heard on one topic.

    Attributes
    ----------
    messages : int
        Number of them.
    first_ns, last_ns : int
        Stamps of the first and the newest [ns].
    """

    messages: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def take(self, stamp_ns: int) -> None:
        """Count one message."""
        if not self.messages:
            self.first_ns = stamp_ns
        self.messages += 1
        self.last_ns = stamp_ns

    def missing(self, rate: float) -> int:
        """Return how many messages a regular topic of this rate [Hz] lacks so far."""
        if not self.messages:
            return 0
        span = (self.last_ns - self.first_ns) / NANOSECONDS_PER_SECOND
        return round(span * rate) + 1 - self.messages


class Recorder(Node):
    """Recorder of a session; keyword arguments go to `rclpy.node.Node`."""

    settings_type = RecorderParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder', **options)
        self.settings = declare_parameters(self, RecorderParameters)
        path = self.settings.path or datetime.now().astimezone().strftime('rpms_%Y%m%d_%H%M%S')
        try:
            self._writer = RecordingWriter(path, self.settings.storage, self.settings.compression)
        except RecordingError as error:
            raise NodeError(str(error)) from error
        self._closed = False
        self.counts = {name: TopicCount() for name in self.settings.topics}
        for name in self.settings.topics:
            self._subscribe(name)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.settings.flush_period, self._flush, clock=steady)

    def _subscribe(self, name: str) -> None:
        kind, type_name, profile = _TOPICS[name]
        if name == topics.FORCE and self.settings.best_effort_force:
            profile = qos.FORCE_BEST_EFFORT
        topic = self._writer.add_topic(self.resolve_topic_name(name), type_name)
        count = self.counts[name]

        def take(data: bytes) -> None:
            if self._closed:
                return
            count.take(messages.stamp_of_bytes(data))
            self._writer.append(topic, time.time_ns(), data)

        self.create_subscription(kind, name, take, profile, raw=True)

    def _flush(self) -> None:
        if self._closed:
            return
        try:
            self._writer.flush()
        except RecordingError as error:
            raise NodeError(str(error)) from error

    def close(self) -> None:
        """Write what is left and the index; nothing is recorded from then on."""
        if self._closed:
            return
        self._closed = True
        try:
            self._writer.close()
        except RecordingError as error:
            logger_of(self).error(str(error))

    def destroy_node(self) -> None:
        """Close the recording, then go."""
        self.close()
        super().destroy_node()  # type: ignore[no-untyped-call]


def main() -> int:
    """Run the recorder as a process."""
    return run(Recorder)
