# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that records topics: messages as raw bytes, with their publisher.

Messages are written to the operating system every `flush_period`: after a recorder was killed,
all older messages are readable.  It subscribes to the topics of this package at the start, and to
others as soon as a publisher shows their type.
"""

import json
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

from rpms_msgs.msg import AcceptedSchedule
from rpms_msgs.msg import DriverStatus
from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import MuscleTruth
from rpms_msgs.msg import Pulse
from rpms_ros import messages
from rpms_ros.errors import NodeError
from rpms_ros.errors import RecordingError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.diagnostics import PERIOD_S
from rpms_ros.nodes.diagnostics import DiagnosticsPublisher
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.overridable import warn_of_unused
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import parameter
from rpms_ros.nodes.recorded_types import definition_of
from rpms_ros.nodes.recorded_types import message_class
from rpms_ros.nodes.recorded_types import offered_qos
from rpms_ros.nodes.recorded_types import subscription_qos
from rpms_ros.nodes.recorded_types import type_name_of
from rpms_ros.nodes.recorder_health import recorder_health
from rpms_ros.nodes.recorder_hearing import RecorderHearing
from rpms_ros.nodes.runner import run
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording import RecordingWriter
from rpms_ros.recording.checksums import read_key
from rpms_ros.recording.verifying import LOST_KEY
from rpms_ros.recording.verifying import PUBLISHERS_KEY

_TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    topics.PULSES: (Pulse, qos.PULSES),
    topics.PULSES_COMMANDED: (Pulse, qos.PULSES),
    topics.FORCE: (WrenchStamped, qos.FORCE),
    topics.ESTIMATE: (MuscleEstimate, qos.ESTIMATE),
    topics.DISTURBANCE: (WrenchStamped, qos.DISTURBANCE),
    topics.TRUTH: (MuscleTruth, qos.TRUTH),
    topics.DRIVER_STATUS: (DriverStatus, qos.STATUS),
    topics.ACCEPTED_SCHEDULE: (AcceptedSchedule, qos.ACCEPTED_SCHEDULE),
}
# Period with which the subscriptions are emptied [s].
_LISTENING_PERIOD = 0.01
# Period with which the types of other topics are looked up [s].
_LOOK_PERIOD = 0.2
_MOST_NAMES = 100


@dataclass(frozen=True)
class RecorderParameters(NodeParameters):
    """Parameters of the recorder."""

    path: str = parameter(
        '',
        'Folder of the recording, which must not exist yet; empty: named by time and namespace.',
    )
    storage: str = parameter('mcap', 'Format of the file.', choices=('mcap', 'sqlite3'))
    compression: str = parameter('', 'Compression of mcap.', choices=('', 'lz4', 'zstd'))
    topics: tuple[str, ...] = parameter(
        tuple(_TOPICS), 'Topics to record, of any type; those without publisher stay empty.'
    )
    best_effort_force: bool = parameter(
        False,
        'Record a force sensor that publishes best effort from the start, not from a second after '
        'it was found. Samples may be lost.',
    )
    key_file: str = parameter(
        '', 'File with the key that signs the recording; empty leaves it unsigned.'
    )
    flush_period: float = parameter(
        0.5, 'Time between two writes to the file.', unit='s', minimum=0.01, maximum=60.0
    )


@dataclass
class TopicCount:
    """Counts of one topic.

    Attributes
    ----------
    messages : int
        Number of messages.
    first_ns, last_ns : int
        Stamps of the first and the newest; times of reception for messages without stamp [ns].
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
        with complete_or_gone(self) as self._parts:
            self._build()

    def _build(self) -> None:
        """Make the parts of the node, each after those that it depends on."""
        self.settings = declare_parameters(self, RecorderParameters)
        self._hearing = RecorderHearing(self)
        self._parts.callback(self._hearing.close)
        try:
            self._writer = self._opened()
        except RecordingError as error:
            raise NodeError(str(error)) from error
        self._closed = False
        self.counts = {name: TopicCount() for name in self._named_once()}
        self._publisher_counts: dict[str, int] = {}
        self._unknown: list[str] = []
        self._refused: list[str] = []
        self._kinds: dict[str, Any] = {}
        self._numbers: dict[tuple[str, str], int] = {}
        self._lost: dict[str, int] = {}
        # an open recording is ended properly, whatever fails from here on
        self._parts.callback(self.close)
        self._diagnostics = DiagnosticsPublisher(
            self, 'recording', f'recording {self.path.resolve()}'
        )
        self._subscribe_to_known()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LISTENING_PERIOD, self._take, clock=steady)
        self.create_timer(self.settings.flush_period, self._flush, clock=steady)
        self.create_timer(PERIOD_S, self._report, clock=steady)
        if self._unknown:
            self.create_timer(_LOOK_PERIOD, self._look, clock=steady)
        warn_of_unused(self)
        heard = ', '.join(self.resolve_topic_name(name) for name in self.counts)
        logger_of(self).info(f'recording to {self.path}: {heard}')

    @property
    def path(self) -> Path:
        """Folder of the recording."""
        return self._writer.path

    def _named_once(self) -> list[str]:
        """Return the names of the topics, the first of those that are one and the same topic.

        Heard twice, each message would be recorded twice.
        """
        names: dict[str, str] = {}
        for name in self.settings.topics:
            names.setdefault(self.resolve_topic_name(name), name)
        return list(names.values())

    def _subscribe_to_known(self) -> None:
        for name in self.counts:
            if name in _TOPICS:
                self._subscribe(name, *_TOPICS[name])
            else:
                self._unknown.append(name)

    def _opened(self) -> RecordingWriter:
        """Return the writer; if the name is taken by another recorder, a number is added."""
        settings = self.settings
        key = read_key(Path(settings.key_file).expanduser()) if settings.key_file else None
        options: dict[str, Any] = {'storage': settings.storage, 'key': key}
        options['compression'] = settings.compression
        if settings.path:
            return RecordingWriter(Path(settings.path).expanduser(), **options)
        now = datetime.now().astimezone().strftime('rpms_%Y%m%d_%H%M%S')
        base = '_'.join(filter(None, [now, *self.get_namespace().split('/')]))
        for number in range(1, _MOST_NAMES):
            name = base if number == 1 else f'{base}_{number}'
            try:
                return RecordingWriter(name, **options)
            except RecordingError:
                # Another recorder may have made the folder meanwhile.
                if not Path(name).exists():
                    raise
        raise RecordingError(f'expected a name for the recording, got {base} taken')

    def _look(self) -> None:
        """Subscribe to topics whose type has become known."""
        types = dict(self.get_topic_names_and_types()) if self._unknown else {}
        for name in list(self._unknown):
            found = types.get(self.resolve_topic_name(name), [])
            infos = self.get_publishers_info_by_topic(name) if found else []
            if not infos:
                continue
            self._unknown.remove(name)
            try:
                kind = message_class(found[0])
                definition_of(found[0])
            except RecordingError as error:
                self._refused.append(name)
                logger_of(self).error(f'{name} is not recorded: {error}')
                continue
            self._subscribe(name, kind, subscription_qos(infos))

    def _subscribe(self, name: str, kind: Any, profile: QoSProfile) -> None:
        if name == topics.FORCE and self.settings.best_effort_force:
            profile = qos.FORCE_BEST_EFFORT
        self._hearing.hear(name, kind, profile)
        self._kinds[name] = kind
        self._publisher_counts[name] = 0

    def _take(self) -> None:
        """Write the new messages in the order of their arrival."""
        if self._closed:
            return
        for message in self._hearing.heard():
            kind = self._kinds[message.topic]
            key = message.topic, message.publisher
            if key not in self._numbers:
                # The publisher is known only now, with its quality of service.
                self._numbers[key] = self._add_topic(kind, *key)
            stamped = 'header' in list(kind.get_fields_and_field_types())[:1]
            count = self.counts[message.topic]
            stamp_ns = messages.stamp_of_bytes(message.data) if stamped else message.received_ns
            count.take(stamp_ns)
            self._writer.append(self._numbers[key], message.received_ns, message.data)

    def _hear_best_effort(self) -> None:
        """Subscribe best effort to topics that a reliable subscription does not receive."""
        for name in self._kinds:
            infos = self.get_publishers_info_by_topic(self.resolve_topic_name(name))
            alone = bool(infos) and all(
                one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in infos
            )
            if self._hearing.set_alone(name, alone, partial(subscription_qos, infos)):
                logger_of(self).warning(
                    f'{self.resolve_topic_name(name)} is published best effort: it is recorded, '
                    'and messages may be lost'
                )

    def _warn_of_lost(self) -> None:
        """Warn of lost messages: a queue was full, or the network lost them."""
        lost = self._hearing.lost
        for name, count in lost.items():
            if count != self._lost.get(name):
                topic = self.resolve_topic_name(name)
                logger_of(self).warning(f'{count} messages of {topic} were lost so far')
        self._lost = lost

    def _report(self) -> None:
        """Check the publishers and publish the health of the recorder."""
        if self._closed:
            return
        self._hear_best_effort()
        self._warn_of_lost()
        counts = {topic: count.messages for topic, count in self.counts.items()}
        self._diagnostics.publish(recorder_health(self.path, counts, self._refused, self._lost))

    def _add_topic(self, kind: Any, name: str, publisher: str) -> int:
        type_name = type_name_of(kind)
        profiles = offered_qos(self.get_publishers_info_by_topic(name))
        return self._writer.add_topic(
            self.resolve_topic_name(name), type_name, profiles, definition_of(type_name), publisher
        )

    def _flush(self) -> None:
        if self._closed:
            return
        for name, most in self._publisher_counts.items():
            self._publisher_counts[name] = max(most, self.count_publishers(name))
        try:
            self._writer.flush()
        except RecordingError as error:
            raise NodeError(str(error)) from error

    def close(self) -> None:
        """Write the remaining messages and the index, and end the recording."""
        if self._closed:
            return
        # Messages that wait belong to the recording.
        with suppress(RecordingError):
            self._take()
        self._closed = True
        counts = {
            self.resolve_topic_name(name): count
            for name, count in self._publisher_counts.items()
            if count
        }
        self._writer.custom[PUBLISHERS_KEY] = json.dumps(counts)
        lost = {self.resolve_topic_name(name): n for name, n in self._hearing.lost.items()}
        self._writer.custom[LOST_KEY] = json.dumps(lost)
        self._hearing.close()
        try:
            self._writer.close()
        except RecordingError as error:
            logger_of(self).error(str(error))
            return
        total = sum(count.messages for count in self.counts.values())
        logger_of(self).info(f'closed {self.path}: {total} messages')

    def destroy_node(self) -> None:
        """Close the recording, then destroy the node."""
        self._parts.close()
        super().destroy_node()  # type: ignore[no-untyped-call]


def main() -> int:
    """Run the recorder as a process."""
    return run(Recorder)
