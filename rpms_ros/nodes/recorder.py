# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that records topics: messages as raw bytes.

Messages are written to the operating system every `flush_period`: after a recorder was killed,
all older messages are readable.  It subscribes to the topics of this package at the start, and to
others as soon as a publisher shows their type.

As in the identifier, the subscriptions belong to a second node that is in no executor, and the
recorder empties them.
"""

import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from rpms_msgs.msg import AcceptedSchedule, DriverStatus, MuscleEstimate, MuscleTruth, Pulse
from rpms_ros import messages
from rpms_ros.errors import NodeError, RecordingError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import PERIOD_S, DiagnosticsPublisher, Health
from rpms_ros.nodes.common.logger import logger_of
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter
from rpms_ros.nodes.common.qos import second_node, subscribe, taken_from, warn_of_unused
from rpms_ros.nodes.common.runner import complete_or_gone, run
from rpms_ros.nodes.common.subscriptions import drained
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording import RecordingWriter
from rpms_ros.recording.rosbag.definitions import described_type, known_types, written_definition
from rpms_ros.recording.rosbag.metadata import read_key
from rpms_ros.recording.rosbag.verifying import LOST_KEY, PUBLISHERS_KEY

SUFFIX = '_hearing'
"""Suffix of the name of the second node."""


class HeardMessage(NamedTuple):
    """A received message.

    Attributes
    ----------
    topic : str
        Name of the topic in the parameters.
    received_ns : int
        Time of reception [ns].
    data : bytes
        The message, serialised.
    """

    topic: str
    received_ns: int
    data: bytes


class _Topic:
    """Subscriptions to one topic.

    Attributes
    ----------
    alone : bool
        Whether the topic is published best effort only, received by the second subscription.
    publishers : int
        Most publishers so far.
    lost : int
        Messages that were lost, by the numbers that their publisher gave them; once there were
        several publishers nothing more is counted.
    """

    def __init__(
        self, name: str, subscription: Subscription, count_publishers: Callable[[str], int]
    ) -> None:
        self.name = name
        self.alone = subscription.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
        self.subscriptions = [None, subscription] if self.alone else [subscription, None]
        self.publishers = 0
        self.lost = 0
        self._count_publishers = count_publishers
        self._newest: int | None = None

    def look(self) -> None:
        """Look how many publishers there are."""
        self.publishers = max(self.publishers, self._count_publishers(self.name))

    def taken(self) -> Iterator[HeardMessage]:
        reliable, best_effort = (drained(subscription) for subscription in self.subscriptions)
        # Both subscriptions receive from reliable publishers.
        for taken in [*reliable, *best_effort] if self.alone else reliable:
            self._count_lost(taken.sequence)
            yield HeardMessage(self.name, taken.received_ns or time.time_ns(), taken.data)

    def _count_lost(self, sequence: int | None) -> None:
        newest, self._newest = self._newest, sequence
        # a publisher that was started anew counts from the beginning
        if newest is not None and sequence is not None and sequence > newest + 1:
            self.look()
            self.lost += sequence - newest - 1 if self.publishers < 2 else 0


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

    @property
    def publishers(self) -> dict[str, int]:
        """Most publishers of each topic so far, for those that had one."""
        return {name: one.publishers for name, one in self._topics.items() if one.publishers}

    def count_publishers(self) -> None:
        """Look how many publishers each topic has."""
        for topic in self._topics.values():
            topic.look()

    def hear(self, name: str, kind: Any, profile: QoSProfile) -> None:
        """Subscribe to a topic; parameters of the recorder may override the quality of service.

        Raises
        ------
        NodeError
            If such a parameter is no quality of service.
        """
        subscription = subscribe(self._named, self._node, kind, name, profile)
        self._topics[name] = _Topic(name, subscription, self._named.count_publishers)
        self._kinds[name] = kind

    def set_alone(self, name: str, alone: bool, profile: Callable[[], QoSProfile]) -> bool:
        """Set whether a topic is published best effort only; return whether that is new."""
        topic = self._topics[name]
        if topic.subscriptions[0] is None:
            return False
        topic.alone = alone
        if not alone or topic.subscriptions[1] is not None:
            return False
        resolved = self._named.resolve_topic_name(name)
        second = taken_from(self._node, self._kinds[name], resolved, profile())
        topic.subscriptions[1] = second
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
        self._topics.clear()
        self._node.destroy_node()


LEAST_ROOM = 1_000_000_000
"""Free bytes below which a session of an hour may not fit on the disk."""


def recorder_health(
    path: Path, counts: Mapping[str, int], missing: Sequence[str], lost: Mapping[str, int]
) -> Health:
    """Return the health of a recorder.

    Parameters
    ----------
    path : Path
        Folder of the recording.
    counts : mapping of str to int
        Messages so far, by topic.
    missing : sequence of str
        Topics that are published and not recorded.
    lost : mapping of str to int
        Messages that were lost, by topic.
    """
    free = shutil.disk_usage(path).free
    total = sum(counts.values())
    level, said = DiagnosticStatus.OK, 'recording' if total else 'recording; no message yet'
    faults = [f'not recorded: {", ".join(missing)}'] if missing else []
    faults += [f'{count} messages of {name} lost' for name, count in lost.items()]
    if free < LEAST_ROOM:
        faults.append(f'{free / 1e6:.0f} MB are left on the disk')
    if faults:
        level, said = DiagnosticStatus.WARN, '; '.join(faults)
    figures = {
        'path': path.resolve(),
        'messages': total,
        'free on the disk [MB]': f'{free / 1e6:.0f}',
        **{f'messages of {name}': count for name, count in counts.items()},
    }
    return Health(said, level, figures)


# A hundred seconds at 50 Hz.
_DEPTH = 5000


def message_class(type_name: str) -> Any:
    """Return the class of ``package/msg/Name``.

    Raises
    ------
    RecordingError
        If its package is not installed.
    """
    package, folder, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.{folder}'), name)
    except (ImportError, AttributeError) as error:
        raise RecordingError(f'expected an installed {type_name}, got {error}') from error


def type_name_of(kind: Any) -> str:
    """Return ``package/msg/Name`` of a message class."""
    package, folder = kind.__module__.split('.')[:2]
    return f'{package}/{folder}/{kind.__name__}'


@cache
def definition_of(type_name: str) -> tuple[str, str]:
    """Return text and hash of any installed type.

    Raises
    ------
    RecordingError
        If its package has no definition of it.
    """
    if type_name in known_types().fielddefs:
        return written_definition(type_name)
    return described_type(type_name, _installed_text)


def _installed_text(type_name: str) -> str:
    package, folder, name = type_name.split('/')
    try:
        share = get_package_share_directory(package)
        return Path(share, folder, f'{name}.msg').read_text('utf-8')
    except (PackageNotFoundError, OSError) as error:
        raise RecordingError(f'expected an installed {type_name}.msg, got {error}') from error


def subscription_qos(publishers: Sequence[TopicEndpointInfo]) -> QoSProfile:
    """Return a profile compatible with all publishers: as reliable and durable as the least."""
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in profiles)
    durable = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in profiles)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


def offered_qos(publishers: Sequence[TopicEndpointInfo]) -> list[Qos]:
    """Return the quality of service that each publisher offers, as recordings store it."""
    return [_recorded(publisher.qos_profile) for publisher in publishers]


def _recorded(profile: QoSProfile) -> Qos:
    return Qos(
        QosHistory[profile.history.name],
        profile.depth,
        QosReliability[profile.reliability.name],
        QosDurability[profile.durability.name],
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness[profile.liveliness.name],
        _time(profile.liveliness_lease_duration),
        bool(profile.avoid_ros_namespace_conventions),
    )


def _time(duration: Any) -> QosTime:
    return QosTime(*divmod(int(duration.nanoseconds), NANOSECONDS_PER_SECOND))


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
        self._unknown: list[str] = []
        self._refused: list[str] = []
        self._kinds: dict[str, Any] = {}
        self._numbers: dict[str, int] = {}
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

    def _take(self) -> None:
        """Write the new messages in the order of their arrival."""
        if self._closed:
            return
        for message in self._hearing.heard():
            kind = self._kinds[message.topic]
            if message.topic not in self._numbers:
                # Its publisher is known only now, with its quality of service.
                self._numbers[message.topic] = self._add_topic(kind, message.topic)
            stamped = 'header' in list(kind.get_fields_and_field_types())[:1]
            count = self.counts[message.topic]
            stamp_ns = messages.stamp_of_bytes(message.data) if stamped else message.received_ns
            count.take(stamp_ns)
            self._writer.append(self._numbers[message.topic], message.received_ns, message.data)

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

    def _add_topic(self, kind: Any, name: str) -> int:
        type_name = type_name_of(kind)
        profiles = offered_qos(self.get_publishers_info_by_topic(name))
        return self._writer.add_topic(
            self.resolve_topic_name(name), type_name, profiles, definition_of(type_name)
        )

    def _flush(self) -> None:
        if self._closed:
            return
        self._hearing.count_publishers()
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
        self._hearing.count_publishers()
        for key, counts in (
            (PUBLISHERS_KEY, self._hearing.publishers),
            (LOST_KEY, self._hearing.lost),
        ):
            named = {self.resolve_topic_name(name): count for name, count in counts.items()}
            self._writer.custom[key] = json.dumps(named)
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
