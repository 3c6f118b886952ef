# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written: raw messages as they come, or arrays at once.

Arrays become records equal in every byte to what rosbags serialises one by one.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9

from rpms_ros.axis import FORCE, UNITS, Axis, unit_vector
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, IntArray, PulseTrain
from rpms_ros.recording.rosbag.definitions import (
    ENCODING,
    LENGTH,
    PULSE,
    WRENCH_STAMPED,
    fields_of,
    known_types,
    record_type,
    written_definition,
)
from rpms_ros.recording.rosbag.metadata import KEY, NAME, write_checksums
from rpms_ros.recording.rosbag.records import Batch, Records

_LARGEST_SECOND = 2**31 - 1


def encode_pulses(pulses: PulseTrain, frame_id: str) -> Records:
    """Return one rpms_msgs/Pulse a pulse, received at its onset."""
    values = {name: getattr(pulses, name) for name in ('sequence', 'intensity', 'width')}
    return _encode(PULSE, pulses.onset_ns, frame_id, values)


def encode_forces(forces: ForceTrace, axis: Axis, quantity: str = FORCE) -> Records:
    """Return one geometry_msgs/WrenchStamped a sample, received at its stamp.

    Parameters
    ----------
    forces : ForceTrace
        Samples.
    axis : three floats
        Unit vector of the force in the frame of the sensor.
    quantity : str
        ``force``, or ``torque`` of a dynamometer, which is about the axis.
    """
    values = {
        f'wrench.{quantity}.{name}': forces.force * share
        for name, share in zip('xyz', axis, strict=True)
        # Infinity times nothing is no number.
        if share
    }
    return _encode(WRENCH_STAMPED, forces.stamp_ns, forces.frame_id, values)


def _encode(
    type_name: str, stamp_ns: IntArray, frame_id: str, values: Mapping[str, npt.NDArray[Any]]
) -> Records:
    """Return records of a message with a header; fields that are not given are zero."""
    second, nanosecond = np.divmod(stamp_ns, NANOSECONDS_PER_SECOND)
    if len(second) and not (second.min() >= 0 and second.max() <= _LARGEST_SECOND):
        fault = f'expected stamps from 0 to {_LARGEST_SECOND} s'
        raise RecordingError(f'{fault}, got {second.min()} to {second.max()} s')
    text = frame_id.encode()
    fields = fields_of(known_types(), type_name)
    rows = np.zeros(len(stamp_ns), record_type(fields, '<', len(text) + 1))
    own = {ENCODING: 1, LENGTH: len(text) + 1, 'header.frame_id': text}
    stamp = {'header.stamp.sec': second, 'header.stamp.nanosec': nanosecond}
    for path, value in {**own, **stamp, **values}.items():
        rows[path] = value
    end = np.arange(1, len(rows) + 1, dtype=np.int64) * rows.itemsize
    return Records(np.frombuffer(rows, np.uint8), end - rows.itemsize, end, stamp_ns)


_NO_TIME = 2**63 - 1
PULSES_TOPIC = '/pulses'
FORCE_TOPIC = '/force'
PULSE_FRAME = 'coil'


class FurtherTopic(NamedTuple):
    """Messages of a topic, ready to be written.

    Attributes
    ----------
    name, type_name : str
        Topic and type of its messages.
    time_ns : sequence of int
        When each message was received [ns].
    messages : sequence of bytes
        Each of them serialised.
    """

    name: str
    type_name: str
    time_ns: Sequence[int]
    messages: Sequence[bytes]


class RecordingWriter:
    """A recording that is being written: a folder with an mcap file and metadata.yaml.

    Every `flush` hands its messages to the operating system: a process that is killed afterwards
    leaves them readable.  Once the device has refused something, the recording stays without its
    end, so that every reader sees that something is missing.

    Parameters
    ----------
    path : Path or str
        Folder that does not exist yet.
    compression : str
        Of the chunks: empty, ``lz4`` or ``zstd``.
    custom : mapping of str to str, optional
        Notes for people, kept in metadata.yaml.

    Raises
    ------
    RecordingError
        If the folder exists or cannot be made.
    """

    def __init__(
        self, path: Path | str, compression: str = '', custom: Mapping[str, str] | None = None
    ) -> None:
        self.path = Path(path)
        self.custom = dict(custom or {})
        self._schemas: dict[str, int] = {}
        # Entries of metadata.yaml.
        self._topics: dict[int, dict[str, Any]] = {}
        self._span_ns: tuple[int, int] | None = None
        if compression not in ('', 'lz4', 'zstd'):
            raise RecordingError(f'expected compression lz4 or zstd, got {compression!r}')
        if os.path.lexists(self.path):
            raise RecordingError(f'expected a new folder for the recording, got {path}')
        self._name = f'{self.path.name}_0.mcap'
        try:
            self.path.mkdir(parents=True)
            self._file = _WholeWrites(self.path / self._name)
            self._writer = Writer(
                cast(IO[Any], self._file),
                chunk_size=1 << 20,
                compression=CompressionType[compression.upper() or 'NONE'],
                enable_data_crcs=True,
            )
            self._writer.start('ros2', 'rpms_ros')
        except OSError as error:
            raise _refused(self.path, error) from error

    def add_topic(self, name: str, type_name: str, qos: Sequence[Qos] = ()) -> int:
        """Return the number of a new topic, for `append`.

        Parameters
        ----------
        name, type_name : str
            Topic and type of its messages.
        qos : sequence of Qos
            Quality of service that its publishers offer.
        """
        text, digest = written_definition(type_name)
        profiles = dump_qos_v9(list(qos))
        offered = _as_yaml(profiles) if qos else ''
        notes = {'offered_qos_profiles': offered, 'topic_type_hash': digest}
        if type_name not in self._schemas:
            schema = self._writer.register_schema(type_name, 'ros2msg', text.encode())
            self._schemas[type_name] = schema
        number = self._writer.register_channel(name, 'cdr', self._schemas[type_name], notes)
        described = {
            'name': name,
            'type': type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': profiles,
            'type_description_hash': digest,
        }
        self._topics[number] = {'topic_metadata': described, 'message_count': 0}
        return number

    def append(self, topic: int, time_ns: int, message: bytes | memoryview) -> None:
        """Take one message, received at `time_ns`; it is written with the next `flush`.

        Raises
        ------
        RecordingError
            If the device refuses what has come so far, for instance because it is full.
        """
        if self._file.closed:
            raise RecordingError(f'expected an open recording, got {self.path} that is closed')
        entry = self._topics[topic]
        number = entry['message_count'] % 2**32
        self._writer.add_message(topic, time_ns, cast(bytes, message), time_ns, number)
        entry['message_count'] += 1
        first, last = self._span_ns or (time_ns, time_ns)
        self._span_ns = min(first, time_ns), max(last, time_ns)

    def flush(self) -> None:
        """Write the messages that were appended."""
        if not self._file.closed:
            self._writer.flush()

    @property
    def ended(self) -> bool:
        """Whether nothing more can be written: it was closed, or the disk took no more."""
        return self._file.closed

    def close(self) -> None:
        """Write what is left, the index, metadata.yaml and the checksums."""
        if self._file.closed:
            return
        content = self._metadata()
        try:
            try:
                self._writer.flush()
                self._writer.add_metadata('rosbag2', {'serialized_metadata': _as_yaml(content)})
                self._writer.finish()
            finally:
                self._file.close()
            (self.path / NAME).write_text(_as_yaml({KEY: content}), 'utf-8')
            write_checksums(self.path, (self._name, NAME))
        except OSError as error:
            raise _refused(self.path, error) from error

    def _metadata(self) -> dict[str, Any]:
        """Return the metadata of version 9 of rosbag2."""
        first, last = self._span_ns or (_NO_TIME, _NO_TIME)
        span = {
            'starting_time': {'nanoseconds_since_epoch': first},
            'duration': {'nanoseconds': last - first},
            'message_count': sum(one['message_count'] for one in self._topics.values()),
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            'relative_file_paths': [self._name],
            **span,
            'topics_with_message_count': list(self._topics.values()),
            'compression_format': '',
            'compression_mode': '',
            'files': [{'path': self._name, **span}],
            'custom_data': dict(self.custom) or None,
            'ros_distro': 'jazzy',
        }

    def __enter__(self) -> 'RecordingWriter':
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # What was recorded before the failure is worth an index; the failure is what counts.
        with nullcontext() if kind is None else suppress(RecordingError):
            self.close()


def _as_yaml(document: object) -> str:
    """Return a document as rosbag2 writes it."""
    return yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


class _Dumper(yaml.SafeDumper):
    """Writes what stands in two places twice, not once and a reference to it."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


class _WholeWrites:
    """A file that takes each write as a whole; if the device refuses one, not at all, and no more.

    Unbuffered: what was written is with the operating system, and survives a killed process.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open('xb', buffering=0)
        self.tell, self.flush = self._file.tell, self._file.flush
        self.closed = False

    def close(self) -> None:
        self.closed = True
        self._file.close()

    def write(self, content: bytes) -> int:
        begin = self._file.tell()
        view = memoryview(content)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), begin)
            self.close()
            raise _refused(self._path.parent, error) from error
        return len(content)


def _refused(path: Path, error: OSError) -> RecordingError:
    return RecordingError(f'expected room and permission to write {path}, got {error}')


def _merged(topics: Mapping[int, Records]) -> Batch:
    """Return the messages of several topics in the order of reception.

    The order within a topic is kept, also where its clock was set back.  If that happened equally
    often in every topic, what came after it is merged by the times after it.  At equal times the
    topic that comes first in `topics` is first: give pulses before forces.
    """
    parts = list(topics.values())
    counts, sizes = [len(part) for part in parts], [len(part.buffer) for part in parts]
    shift = np.repeat(np.cumsum([0, *sizes[:-1]]), counts)
    order = _order_of_reception([part.time_ns for part in parts])
    columns = zip(*((one.buffer, one.start, one.end, one.time_ns) for one in parts), strict=True)
    buffer, start, end, time_ns = map(np.concatenate, columns)
    whole = Records(buffer, start + shift, end + shift, time_ns)
    return np.repeat(list(topics), counts)[order], whole.select(order)


def _order_of_reception(times_ns: Sequence[IntArray]) -> IntArray:
    """Return what sorts the joined times of all topics without changing the order within one."""
    lines = [
        np.cumsum(np.diff(times, prepend=times[:1]) < 0, dtype=np.int64) for times in times_ns
    ]
    if len({int(line[-1]) for line in lines if len(line)}) > 1:
        rising = [np.maximum.accumulate(times) for times in times_ns]
        return np.argsort(np.concatenate(rising), kind='stable')
    return np.lexsort((np.concatenate(times_ns), np.concatenate(lines)))


def write_recording(
    path: Path | str,
    pulses: PulseTrain,
    forces: ForceTrace,
    *,
    compression: str = '',
    axis: str | Sequence[float] = 'z',
    custom: Mapping[str, str] | None = None,
    further: Sequence['FurtherTopic'] = (),
    quantity: str = FORCE,
) -> None:
    """Write pulses and forces as a recording.

    They are received at their stamps; pulses come before samples of the same time.

    Parameters
    ----------
    path : Path or str
        Folder that does not exist yet.
    pulses : PulseTrain
        Go to topic ``/pulses``.
    forces : ForceTrace
        Go to topic ``/force``.
    compression, custom
        As in `RecordingWriter`.
    axis : str or sequence of float
        Axis of the force in the frame of the sensor.
    further : sequence of FurtherTopic
        Messages of other topics, merged with them by their times.
    quantity : str
        ``force`` [N], or ``torque`` [N m], which readers are told to read too.

    Raises
    ------
    RecordingError
        If the folder exists, the device refuses, or there is no such quantity.
    """
    if quantity not in UNITS:
        raise RecordingError(f'expected a quantity of {", ".join(UNITS)}, got {quantity}')
    encoded = {
        (PULSES_TOPIC, PULSE): encode_pulses(pulses, PULSE_FRAME),
        (FORCE_TOPIC, WRENCH_STAMPED): encode_forces(forces, unit_vector(axis), quantity),
    }
    with RecordingWriter(path, compression, custom) as writer:
        topics = {writer.add_topic(*topic): part for topic, part in encoded.items()}
        for topic in further:
            number = writer.add_topic(topic.name, topic.type_name)
            topics[number] = Records.of(topic.messages, np.asarray(topic.time_ns, np.int64))
        numbers, records = _merged(topics)
        # Not a copy of each message but a view: a thousand of them are a small part of the work.
        view = records.buffer.data
        columns = (numbers, records.time_ns, records.start, records.end)
        for topic, time_ns, start, end in zip(*(one.tolist() for one in columns), strict=True):
            writer.append(topic, time_ns, view[start:end])
