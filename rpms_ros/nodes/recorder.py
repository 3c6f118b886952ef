# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that records topics: messages as raw bytes.

Messages are written to the operating system every half second: after a recorder was killed,
all older messages are readable.  It subscribes to the topics of this package alone.

As in the identifier, the subscriptions belong to a second node that is in no executor, and the
recorder empties them.
"""

import json
import shutil
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from rpms_msgs.msg import AcceptedSchedule, DriverStatus, MuscleEstimate, MuscleTruth, Pulse
from rpms_ros.errors import NodeError, RecordingError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import PERIOD_S, DiagnosticsPublisher, Health, logger_of
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.nodes.common.subscriptions import QueuedTopic
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording import RecordingWriter
from rpms_ros.recording.rosbag.verifying import LOST_KEY, PUBLISHERS_KEY

# Free bytes below which a session of an hour may not fit on the disk.
_LEAST_ROOM = 1_000_000_000


def recorder_health(path: Path, counts: Mapping[str, int], faults: Sequence[str]) -> Health:
    """Return the health of a recorder.

    Parameters
    ----------
    path : Path
        Folder of the recording.
    counts : mapping of str to int
        Messages so far, by topic.
    faults : sequence of str
        What is not recorded.

    Raises
    ------
    NodeError
        If the folder has gone.
    """
    try:
        free = shutil.disk_usage(path).free
    except OSError as error:
        raise NodeError(f'expected the folder of the recording, got {error}') from error
    free_mb, total = f'{free / 1e6:.0f}', sum(counts.values())
    level, said = DiagnosticStatus.OK, 'recording' if total else 'recording; no message yet'
    if free < _LEAST_ROOM:
        faults = [*faults, f'{free_mb} MB are left on the disk']
    if faults:
        level, said = DiagnosticStatus.WARN, '; '.join(faults)
    figures = {
        'path': path.resolve(),
        'messages': total,
        'free on the disk [MB]': free_mb,
        **{f'messages of {name}': count for name, count in counts.items()},
    }
    return Health(said, level, figures)


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
# Time between two writes to the file.
_FLUSH_PERIOD_S = 0.5


@dataclass(frozen=True)
class RecorderParameters(NodeParameters):
    """Parameters of the recorder."""

    path: str = parameter(
        '',
        'Folder of the recording, which must not exist yet; empty: named by time and namespace.',
    )


class Recorder(NodeOfParts):
    """Recorder of a session; keyword arguments go to `rclpy.node.Node`."""

    settings_type = RecorderParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder', **options)

    def _build(self) -> None:
        self.settings = declare_parameters(self, RecorderParameters)
        second = self.second_node()
        # to the microsecond: of two recorders each has a name of its own
        now = datetime.now().astimezone().strftime('rpms_%Y%m%d_%H%M%S_%f')
        name = '_'.join(filter(None, [now, *self.get_namespace().split('/')]))
        try:
            self._writer = RecordingWriter(Path(self.settings.path or name).expanduser())
        except RecordingError as error:
            raise NodeError(str(error)) from error
        self._closed = False
        self.counts = dict.fromkeys(_TOPICS, 0)
        self._ears: dict[str, QueuedTopic] = {}
        # in the recording, once a message has come
        self._numbers: dict[str, int] = {}
        self._told: list[str] = []
        # what is to be written: arrival for the order, and of the message [ns], topic, message
        self._found: deque[tuple[int, int, str, bytes]] = deque()
        # an open recording is ended properly, whatever fails from here on
        self._parts.callback(self.close)
        self._diagnostics = DiagnosticsPublisher(
            self, 'recording', f'recording {self.path.resolve()}'
        )
        for name, (kind, profile) in _TOPICS.items():
            self._ears[name] = QueuedTopic(self, second, kind, name, profile)
        every(self, _LISTENING_PERIOD, self._take)
        every(self, _FLUSH_PERIOD_S, self._flush)
        every(self, PERIOD_S, self._report)
        names = ', '.join(self.resolve_topic_name(name) for name in self.counts)
        logger_of(self).info(f'recording to {self.path}: {names}')

    @property
    def path(self) -> Path:
        """Folder of the recording."""
        return self._writer.path

    @property
    def lost(self) -> dict[str, int]:
        """Messages that are missing in the numbers of their publisher, by topic."""
        return {name: ear.lost for name, ear in self._ears.items() if ear.lost}

    def _take(self) -> None:
        """Write the new messages in the order of their arrival."""
        if self._closed:
            return
        found: list[tuple[int, int, str, bytes]] = []
        for name, ear in self._ears.items():
            arrived_ns = 0
            for taken in ear.taken():
                received_ns = taken.received_ns or time.time_ns()
                # A clock that is set back must not change the order within a topic.
                arrived_ns = max(arrived_ns, received_ns)
                found.append((arrived_ns, received_ns, name, taken.data))
        # kept until it is written: a second signal may come in between
        self._found.extend(sorted(found, key=itemgetter(0)))
        while self._found:
            _, received_ns, name, data = self._found.popleft()
            if name not in self._numbers:
                # Its publisher is known only now, with its quality of service.
                infos = self.get_publishers_info_by_topic(name) if self.context.ok() else []
                kind = topics.type_name_of(_TOPICS[name][0])
                profiles = [_recorded(one.qos_profile) for one in infos]
                self._numbers[name] = self._writer.add_topic(self._ears[name].name, kind, profiles)
            self.counts[name] += 1
            self._writer.append(self._numbers[name], received_ns, data)

    def _report(self) -> None:
        """Publish the health of the recorder."""
        if self._closed:
            return
        faults = [f'{n} messages of {self._ears[name].name} lost' for name, n in self.lost.items()]
        faults += [ear.foreign for ear in self._ears.values() if ear.foreign]
        for fault in faults:
            if fault not in self._told:
                logger_of(self).warning(fault)
        self._told = faults
        self._diagnostics.publish(recorder_health(self.path, self.counts, faults))

    def _flush(self) -> None:
        if self._closed:
            return
        for ear in self._ears.values():
            if said := ear.look():
                logger_of(self).warning(said)
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
        for key, what in ((PUBLISHERS_KEY, 'publishers'), (LOST_KEY, 'lost')):
            counts = {ear.name: getattr(ear, what) for ear in self._ears.values()}
            self._writer.custom[key] = json.dumps({name: n for name, n in counts.items() if n})
        if self._writer.ended:
            logger_of(self).error(f'{self.path} has no end: it could not be written any more')
            return
        try:
            self._writer.close()
        except RecordingError as error:
            logger_of(self).error(str(error))
            return
        logger_of(self).info(f'closed {self.path}: {sum(self.counts.values())} messages')
        if not any(self.counts.values()):
            logger_of(self).warning('expected a message on one of the topics, got none')


# Runs the recorder as a process.
main = partial(run, Recorder)
