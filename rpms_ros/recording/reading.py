# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording as arrays of pulses and forces."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path

import numpy as np

from rpms_ros.axis import FORCE
from rpms_ros.axis import UNITS
from rpms_ros.errors import RecordingError
from rpms_ros.identification.arrival_order import NO_FOREIGN
from rpms_ros.identification.arrival_order import Foreign
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording.axis import direction_of
from rpms_ros.recording.axis import force_along
from rpms_ros.recording.publishers import foreign_messages
from rpms_ros.recording.publishers import listened
from rpms_ros.recording.publishers import samples_before
from rpms_ros.recording.scan import Progress
from rpms_ros.recording.scan import Scan
from rpms_ros.recording.scan import TopicFacts
from rpms_ros.recording.schedules import RecordedSchedule
from rpms_ros.recording.schedules import ScheduleReading
from rpms_ros.recording.topic_reading import PULSE_TYPES
from rpms_ros.recording.topic_reading import SENSOR_TYPES
from rpms_ros.recording.topic_reading import TopicReading
from rpms_ros.recording.topic_reading import TopicValues

DEFAULT_FRAME = 'force_sensor'
DAMAGE = {
    'damaged_chunk',
    'damaged_record',
    'missing_file',
    'truncated_file',
    'undecodable_message',
    'unreadable_file',
}
"""Faults of a recording of which a part is lost."""


@dataclass(frozen=True)
class Topics:
    """Names of the topics of a recording.

    A name without a leading slash also fits below any one namespace: ``force`` is ``/force``, or
    ``/left_leg/force`` if that is the only one.
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


@dataclass(frozen=True)
class Recording:
    """Pulses and forces in the order in which they were received.

    Of several publishers of a topic, those of the one that the identifier listens to: the first,
    until it has been silent for a second.

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
    foreign : Foreign
        What came of other publishers.
    """

    pulses: PulseTrain
    forces: ForceTrace
    pulse_received_ns: IntArray
    force_received_ns: IntArray
    samples_before_pulse: IntArray
    facts: RecordingFacts
    quantity: str = FORCE
    foreign: Foreign = NO_FOREIGN

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
        gaps = steps[steps > 2 * np.median(steps)] if len(steps) else steps
        share = 100.0 * float(gaps.sum()) / max(float(steps.sum()), 1.0)
        return (
            f'the recording is damaged: {share:.2g} % of the time between first and last sample '
            f'has no force, up to {gaps.max(initial=0) * 1e-9:.3g} s at once'
        )


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
    schedules = ScheduleReading(scan.findings, scan.budget)
    for channel, records in scan.blocks(progress):
        schedules.take(channel, records)
    return _facts(scan, schedules)


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
    direction = direction_of(axis)
    if sign not in (1, -1):
        raise RecordingError(f'expected sign 1 or -1, got {sign!r}')
    if quantity not in SENSOR_TYPES:
        raise RecordingError(f'expected a quantity of {", ".join(SENSOR_TYPES)}, got {quantity}')
    types = SENSOR_TYPES[quantity]
    scan = Scan(Path(path), memory)
    pulses = TopicReading(topics.pulses, PULSE_TYPES)
    force = TopicReading(
        topics.force, {kind: fields.along(direction) for kind, fields in types.items()}
    )
    schedules = ScheduleReading(scan.findings, scan.budget)
    for channel, records in scan.blocks(progress):
        schedules.take(channel, records)
        scan.budget.keep(pulses.take(channel, records) + force.take(channel, records))
    if not any(facts.count for facts in scan.topics.values()):
        raise RecordingError(f'expected messages in {path}, got none')
    all_pulses, all_forces = pulses.values(scan), force.values(scan)
    pulse_values, other_pulses = listened(all_pulses, scan.findings, 'pulses')
    force_values, other_forces = listened(all_forces, scan.findings, 'force')
    return Recording(
        _pulse_train(pulse_values),
        _force_trace(force_values, direction, sign, types[force_values.type_name].values),
        pulse_values.received_ns,
        force_values.received_ns,
        samples_before(pulse_values, force_values),
        _facts(
            scan,
            schedules,
            {'pulses': all_pulses.frame_ids, 'force': all_forces.frame_ids},
        ),
        quantity,
        foreign_messages(force_values, other_forces, other_pulses),
    )


def held_bytes(recording: Recording) -> int:
    """Return what the arrays of a recording take [bytes]."""
    pulses, forces = recording.pulses, recording.forces
    foreign = recording.foreign
    arrays = (
        *(foreign.samples_before_sample, foreign.onset_ns, foreign.samples_before_pulse),
        *(pulses.onset_ns, pulses.intensity, pulses.sequence, pulses.width),
        *(forces.stamp_ns, forces.force),
        *(recording.pulse_received_ns, recording.force_received_ns),
        recording.samples_before_pulse,
    )
    return sum(array.nbytes for array in arrays)


def _facts(
    scan: Scan,
    schedules: ScheduleReading,
    frame_ids: Mapping[str, tuple[str, ...]] | None = None,
) -> RecordingFacts:
    return RecordingFacts(
        scan.path,
        scan.files.storage,
        tuple(scan.topics[key] for key in sorted(scan.topics)),
        frame_ids or {},
        scan.files.custom,
        dict(scan.findings.counts),
        tuple(scan.findings.remarks),
        tuple(path.name for path in scan.files.paths),
        schedules.schedules,
    )


def _pulse_train(values: TopicValues) -> PulseTrain:
    return PulseTrain(
        values.stamp_ns(),
        values.number['intensity'],
        values.number['sequence'].astype(np.int64),
        values.number['width'],
    )


def _force_trace(
    values: TopicValues, direction: FloatArray, sign: int, fields: tuple[str, ...]
) -> ForceTrace:
    # Components across the axis were not read.
    nothing = np.empty(0)
    components = [np.asarray(values.number.get(path, nothing), np.float64) for path in fields]
    force = (
        force_along(direction, components, float(sign))
        if len(components) == 3
        else sign * components[0]
    )
    frame_id = values.frame_ids[0] if values.frame_ids else DEFAULT_FRAME
    return ForceTrace(values.stamp_ns(), force, frame_id)
