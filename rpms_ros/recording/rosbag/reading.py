# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording as arrays of pulses and forces.

Schedules that a driver accepted, as a recording has them.

One hash of everything in a session that an estimator is fed with.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.serde import SerdeError

from rpms_ros.axis import FORCE, UNITS, along, unit_vector
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted, printable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, IntArray, PulseTrain
from rpms_ros.recording.rosbag.definitions import types_of
from rpms_ros.recording.rosbag.metadata import SUMS_NAME
from rpms_ros.recording.rosbag.records import Channel, Records
from rpms_ros.recording.rosbag.scan import Progress, Scan, TopicFacts
from rpms_ros.recording.rosbag.topic_reading import PULSE_TYPES, SENSOR_TYPES, TopicReading
from rpms_ros.schema import documented

ACCEPTED_SCHEDULE = 'rpms_msgs/msg/AcceptedSchedule'
_MOST = 1000
_LONGEST_NAME = 200


@dataclass(frozen=True, kw_only=True)
class RecordedSchedule:
    """A schedule that a driver accepted."""

    name: str = documented('what people call it')
    sha256: str = documented('hash of its text, computed from the text in the recording')
    pulses: int = documented('that it stands for')
    duration_s: float = documented('[s]')
    operator: str = documented('who asked for it; empty where nobody is asked for')
    accepted_ns: int = documented('stamp of its acceptance [ns]')

    def __str__(self) -> str:
        who = f', started by {self.operator}' if self.operator else ''
        pulses = counted(self.pulses, 'pulse')
        return f'{self.name}, {pulses}, {self.duration_s:g} s{who}, sha256 {self.sha256}'


def decoded(channel: Channel, records: Records) -> Iterator[Any]:
    """Yield the messages of a channel one by one, None in place of one that cannot be decoded."""
    try:
        types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
    except RecordingError:
        yield from [None] * len(records)
        return
    for index in range(len(records)):
        try:
            yield types.deserialize_cdr(records.message(index), channel.type_name)
        except (SerdeError, ValueError, IndexError):
            yield None


def _add_schedules(
    schedules: list[RecordedSchedule], channel: Channel, records: Records, scan: Scan
) -> None:
    """Add the schedules among these messages, and note what is wrong with them."""
    if channel.type_name != ACCEPTED_SCHEDULE:
        return
    topic = channel.topic
    for message in decoded(channel, records):
        try:
            found, stated = _schedule_of(message), str(message.sha256)
        except (AttributeError, TypeError, ValueError):
            reason = f'{topic}: expected a schedule that can be decoded, got another'
            scan.findings.add('undecodable_message', reason)
            continue
        if found.sha256 != stated:
            reason = f'{topic}: the text of {found.name} is not the one whose hash was recorded'
            scan.findings.add('altered_schedule', reason)
        if len(schedules) < _MOST:
            scan.budget.keep(1)
            schedules.append(found)
        else:
            scan.findings.add('too_many_schedules', f'{topic}: more than {_MOST} schedules')


def _schedule_of(message: Any) -> RecordedSchedule:
    text = str(message.schedule).encode('utf-8', 'surrogateescape')
    stamp = message.header.stamp
    return RecordedSchedule(
        name=printable(str(message.name))[:_LONGEST_NAME],
        sha256=hashlib.sha256(text).hexdigest(),
        pulses=int(message.pulses),
        duration_s=float(message.duration),
        operator=printable(str(message.operator_id))[:_LONGEST_NAME],
        accepted_ns=int(stamp.sec) * NANOSECONDS_PER_SECOND + int(stamp.nanosec),
    )


DAMAGE = {
    'damaged_chunk',
    'damaged_record',
    'missing_file',
    'unlisted_file',
    'truncated_file',
    'undecodable_message',
    'unreadable_file',
}
"""Faults of a recording of which a part is lost."""


@dataclass(frozen=True)
class Topics:
    """Names of the topics of a recording.

    A name without a leading slash also fits below any one namespace: ``force`` is ``/force``, or
    ``/left_leg/force`` if that is the only one.  Both are of one namespace, unless one begins
    with a slash.
    """

    pulses: str = 'pulses'
    force: str = 'force'


@dataclass(frozen=True)
class RecordingFacts:
    """What a recording tells about itself.

    Attributes
    ----------
    path : Path
        Folder or file.
    storage : str
        ``mcap`` or ``sqlite3``.
    topics : tuple of TopicFacts
        All topics, by name.
    frame_ids : mapping of str to tuple of str
        Frame ids of ``pulses`` and ``force``.
    custom : mapping of str to str
        What the writer noted for people.
    faults : mapping of str to int
        Faults of the recording by kind.
    remarks : tuple of str
        One line on each.
    files : tuple of str
        Names of the storage files.
    schedules : tuple of RecordedSchedule
        Schedules that a driver accepted.
    checksums : bool
        Whether there are any that would tell a change of the files.
    """

    path: Path
    storage: str
    topics: tuple[TopicFacts, ...]
    frame_ids: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    custom: Mapping[str, str] = field(default_factory=dict)
    faults: Mapping[str, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    schedules: tuple[RecordedSchedule, ...] = ()
    checksums: bool = True


@dataclass(frozen=True)
class Recording:
    """Pulses and forces in the order in which they were received.

    Attributes
    ----------
    pulses : PulseTrain
        Delivered pulses.
    forces : ForceTrace
        Force samples.
    pulse_received_ns : ndarray of int64, shape (pulses,)
        When each pulse was received [ns].
    force_received_ns : ndarray of int64, shape (samples,)
        When each sample was received [ns].
    samples_before_pulse : ndarray of int64, shape (pulses,)
        How many samples had been received when each pulse was.
    facts : RecordingFacts
        Everything else.
    quantity : str
        What the sensor measured: ``force`` [N], or ``torque``, then the forces are in N m.
    namespace : str
        That of the pulses, empty or with a leading slash.
    """

    pulses: PulseTrain
    forces: ForceTrace
    pulse_received_ns: IntArray
    force_received_ns: IntArray
    samples_before_pulse: IntArray
    facts: RecordingFacts
    quantity: str = FORCE
    namespace: str = ''

    @property
    def unit(self) -> str:
        """Unit of the forces: ``N`` or ``N m``."""
        return UNITS[self.quantity]

    @property
    def loss(self) -> str | None:
        """What damage has cost, in words; None for an undamaged recording."""
        if not DAMAGE & self.facts.faults.keys():
            return None
        steps = np.diff(np.sort(self.forces.stamp_ns))
        # copies of samples are no steps
        steps = steps[steps > 0]
        gaps = steps[steps > 2 * np.median(steps)] if len(steps) else steps
        if not len(gaps):
            return 'the recording is damaged: force may be missing at its beginning or end'
        share = 100.0 * float(gaps.sum()) / max(float(steps.sum()), 1.0)
        lost = f'{share:.2g} % of the time between first and last sample has no force'
        return f'the recording is damaged: {lost}, up to {gaps.max() * 1e-9:.3g} s at once'


def read_facts(
    path: Path | str, progress: Progress | None = None, memory: int | None = None
) -> RecordingFacts:
    """Return what a recording holds, without decoding it; parameters as of `read_recording`.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    scan = Scan(Path(path), memory)
    schedules: list[RecordedSchedule] = []
    for channel, records in scan.blocks(progress):
        _add_schedules(schedules, channel, records, scan)
    return _facts(scan, schedules, {})


def read_recording(
    path: Path | str,
    topics: Topics | None = None,
    axis: str | Sequence[float] = 'z',
    sign: int = 1,
    progress: Progress | None = None,
    memory: int | None = None,
    quantity: str = FORCE,
) -> Recording:
    """Return pulses and forces of a recording.

    Parameters
    ----------
    path : Path or str
        Folder or storage file of rosbag2: mcap or sqlite3.
    topics : Topics, optional
        Their names.
    axis : str or sequence of float
        Axis of a wrench: ``x``, ``y``, ``z`` or a direction.
    sign : int
        1, or -1 where the sensor shows the muscle's pull as negative.
    progress : callable, optional
        Is told how many messages were read.
    memory : int, optional
        What reading may take [bytes]; 1 GB and four times the size of the recording if it is not
        given.
    quantity : str
        What of a wrench is read: ``force``, or ``torque``, as an isometric dynamometer measures.

    Raises
    ------
    RecordingError
        If it cannot be read or lacks pulses or forces.
    """
    topics = topics or Topics()
    direction = unit_vector(axis)
    if sign not in (1, -1):
        raise RecordingError(f'expected sign 1 or -1, got {sign!r}')
    if quantity not in SENSOR_TYPES:
        raise RecordingError(f'expected a quantity of {", ".join(SENSOR_TYPES)}, got {quantity}')
    types = SENSOR_TYPES[quantity]
    across = tuple(f'{quantity}.{"xyz"[i]}' for i, share in enumerate(direction) if not share)
    needed = {
        kind: tuple(path for path in paths if not path.endswith(across))
        for kind, paths in types.items()
    }
    scan = Scan(Path(path), memory)
    readings = TopicReading(topics.pulses, PULSE_TYPES), TopicReading(topics.force, needed)
    schedules: list[RecordedSchedule] = []
    for channel, records in scan.blocks(progress):
        _add_schedules(schedules, channel, records, scan)
        scan.budget.keep(sum(reading.take(channel, records) for reading in readings))
    if not any(facts.count for facts in scan.topics.values()):
        raise RecordingError(f'expected messages in {path}, got none')
    pulses, force = (reading.values(scan) for reading in readings)
    namespace, other = (one.topic.rpartition('/')[0] for one in (pulses, force))
    if namespace != other and '/' not in (topics.pulses[:1], topics.force[:1]):
        raise RecordingError(
            f'expected pulses and force of one namespace in {path}, got {pulses.topic} and '
            f'{force.topic}: a whole name with its slash decides (--pulses-topic, --force-topic)'
        )
    # Where the clock of reception was set back, only the order of the recording tells.  Otherwise
    # the times do, since a recording may also have been written one topic after the other; a
    # pulse comes before a sample of the same time.
    before = np.searchsorted(force.received_ns, pulses.received_ns, side='left')
    if any((one[1:] < one[:-1]).any() for one in (pulses.received_ns, force.received_ns)):
        before = np.searchsorted(force.place, pulses.place)
    number = pulses.number
    sequence = number['sequence'].astype(np.int64)
    # Components across the axis were not read.
    components = [
        np.asarray(force.number.get(path, ()), np.float64) for path in types[force.type_name]
    ]
    if len(components) == 1 and direction != unit_vector('z'):
        raise RecordingError(f'expected no axis for {force.type_name}, got {axis} (--sign?)')
    newton = along(direction, components) if len(components) == 3 else components[0]
    return Recording(
        PulseTrain(pulses.stamp_ns(), number['intensity'], sequence, number['width']),
        ForceTrace(force.stamp_ns(), sign * newton, *force.frame_ids[:1]),
        pulses.received_ns,
        force.received_ns,
        before,
        _facts(scan, schedules, {'pulses': pulses.frame_ids, 'force': force.frame_ids}),
        quantity,
        namespace,
    )


def _facts(
    scan: Scan, schedules: Sequence[RecordedSchedule], frame_ids: Mapping[str, tuple[str, ...]]
) -> RecordingFacts:
    return RecordingFacts(
        scan.path,
        scan.storage,
        tuple(scan.topics[key] for key in sorted(scan.topics)),
        frame_ids,
        scan.custom,
        dict(scan.findings.counts),
        tuple(scan.findings.remarks),
        tuple(path.name for path in scan.paths),
        tuple(schedules),
        ((scan.path if scan.path.is_dir() else scan.path.parent) / SUMS_NAME).exists(),
    )


def session_hash(recording: Recording) -> str:
    """Return the SHA-256 of a session as hexadecimal digits.

    It covers stamps, intensities, numbers and widths of all pulses, stamps and forces of all
    samples, and the order in which they were received among each other.  It depends neither on
    the storage nor on names, frames and times of reception: a copy in another format has the
    same.  A result with this hash was made from these numbers.

    Parameters
    ----------
    recording : Recording
        The session, as it was read: along one axis, with one sign.
    """
    pulses, forces = recording.pulses, recording.forces
    columns: tuple[npt.NDArray[np.generic], ...] = (
        *(pulses.onset_ns, pulses.intensity, pulses.sequence, pulses.width),
        *(forces.stamp_ns, forces.force, recording.samples_before_pulse),
    )
    digest = hashlib.sha256(b'rpms_ros session 1')
    for column in columns:
        digest.update(len(column).to_bytes(8, 'little'))
        digest.update(np.asarray(column, column.dtype.newbyteorder('<')).tobytes())
    return digest.hexdigest()
