# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written: raw messages as they come, or arrays at once.

Arrays become records equal in every byte to what rosbags serialises one by one.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from sqlite3 import Error as SqliteError
from types import TracebackType
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Qos

from rpms_ros.axis import FORCE, UNITS
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, ForceTrace, IntArray, PulseTrain
from rpms_ros.recording.rosbag import metadata
from rpms_ros.recording.rosbag.definitions import (
    ENCODING,
    LENGTH,
    PULSE,
    WRENCH_STAMPED,
    direction_of,
    fields_of,
    known_types,
    record_type,
    written_definition,
)
from rpms_ros.recording.rosbag.mcap_files import McapFileWriter
from rpms_ros.recording.rosbag.metadata import CRC_KEY, TopicEntry, file_crc32, write_checksums
from rpms_ros.recording.rosbag.records import Batch, Channel, Records
from rpms_ros.recording.rosbag.sqlite_files import SqliteFileWriter

_LARGEST_SECOND = 2**31 - 1


def encode_pulses(pulses: PulseTrain, frame_id: str) -> Records:
    """Return one rpms_msgs/Pulse a pulse, received at its onset."""
    values = {
        'sequence': pulses.sequence,
        'intensity': pulses.intensity,
        'width': pulses.width,
    }
    return _encode(PULSE, pulses.onset_ns, frame_id, values)


def encode_forces(forces: ForceTrace, axis: FloatArray, quantity: str = FORCE) -> Records:
    """Return one geometry_msgs/WrenchStamped a sample, received at its stamp.

    Parameters
    ----------
    forces : ForceTrace
        Samples.
    axis : ndarray, shape (3,)
        Unit vector of the force in the frame of the sensor.
    quantity : str
        ``force``, or ``torque`` of a dynamometer, which is about the axis.
    """
    values = {
        f'wrench.{quantity}.{name}': forces.force * share
        for name, share in zip('xyz', axis.tolist(), strict=True)
        # Infinity times nothing is no number.
        if share
    }
    return _encode(WRENCH_STAMPED, forces.stamp_ns, forces.frame_id, values)


def _encode(
    type_name: str,
    stamp_ns: IntArray,
    frame_id: str,
    values: Mapping[str, npt.NDArray[Any]],
) -> Records:
    """Return records of a message with a header; fields that are not given are zero."""
    fields = fields_of(known_types(), type_name)
    text = frame_id.encode()
    rows = np.zeros(len(stamp_ns), record_type(fields, '<', len(text) + 1))
    second, nanosecond = _split(stamp_ns)
    own = {ENCODING: 1, LENGTH: len(text) + 1, 'header.frame_id': text}
    stamp = {'header.stamp.sec': second, 'header.stamp.nanosec': nanosecond}
    for path, value in {**own, **stamp, **values}.items():
        rows[path] = value
    end = np.arange(1, len(rows) + 1, dtype=np.int64) * rows.itemsize
    return Records(np.frombuffer(rows, np.uint8), end - rows.itemsize, end, stamp_ns)


def _split(stamp_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Return seconds and nanoseconds, each (messages,), as builtin_interfaces/Time has them."""
    second, nanosecond = np.divmod(stamp_ns, NANOSECONDS_PER_SECOND)
    if len(second) and not (second.min() >= 0 and second.max() <= _LARGEST_SECOND):
        raise RecordingError(
            f'expected stamps from 0 to {_LARGEST_SECOND} s, '
            f'got {second.min()} to {second.max()} s'
        )
    return second, nanosecond


STORAGES: dict[str, type[McapFileWriter] | type[SqliteFileWriter]] = {
    'mcap': McapFileWriter,
    'sqlite3': SqliteFileWriter,
}
COMPRESSIONS = ('', 'lz4', 'zstd')
PULSES_TOPIC = '/pulses'
FORCE_TOPIC = '/force'
PULSE_FRAME = 'coil'
_REFUSALS = (OSError, SqliteError)


@dataclass(frozen=True)
class FurtherTopic:
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
    """A recording that is being written: a folder with a storage file and metadata.yaml.

    Every `flush` hands its messages to the operating system: a process that is killed afterwards
    leaves them readable.  Once the device has refused something, the recording stays without its
    end, so that every reader sees that something is missing.

    Parameters
    ----------
    path : Path or str
        Folder that does not exist yet.
    storage : str
        ``mcap`` or ``sqlite3``.
    compression : str
        Of the chunks of mcap: empty, ``lz4`` or ``zstd``.
    custom : mapping of str to str, optional
        Notes for people, kept in metadata.yaml.
    key : bytes, optional
        Signs the recording.

    Raises
    ------
    RecordingError
        If the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: Path | str,
        storage: str = 'mcap',
        compression: str = '',
        custom: Mapping[str, str] | None = None,
        key: bytes | None = None,
    ) -> None:
        self.path = Path(path)
        self.custom = dict(custom or {})
        self._storage = storage
        self._key = key
        self._topics: dict[int, TopicEntry] = {}
        self._first_ns: int | None = None
        self._last_ns = 0
        self._closed = False
        if storage not in STORAGES:
            raise RecordingError(f'expected storage {" or ".join(STORAGES)}, got {storage!r}')
        if compression not in (COMPRESSIONS if storage == 'mcap' else ('',)):
            raise RecordingError(
                f'expected compression lz4 or zstd of mcap, got {compression!r} of {storage}'
            )
        if os.path.lexists(self.path):
            raise RecordingError(f'expected a new folder for the recording, got {path}')
        self._file_path = self.path / f'{self.path.name}_0{STORAGES[storage].suffix}'
        try:
            self.path.mkdir(parents=True)
            self._file = STORAGES[storage](self._file_path, compression)
        except _REFUSALS as error:
            raise self._error(error) from error

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
        entry = TopicEntry(Channel(name, type_name, text), digest, qos)
        try:
            number = self._file.add_topic(entry)
        except _REFUSALS as error:
            self._refuse(error)
        self._topics[number] = entry
        return number

    def append(self, topic: int, time_ns: int, message: bytes | memoryview) -> None:
        """Take one message, received at `time_ns`; it is written with the next `flush`.

        Raises
        ------
        RecordingError
            If the device refuses what has come so far, for instance because it is full.
        """
        if self._closed:
            raise RecordingError(f'expected an open recording, got {self.path} that is closed')
        try:
            self._file.append(topic, time_ns, message)
        except _REFUSALS as error:
            self._refuse(error)
        self._topics[topic].count += 1
        if self._first_ns is None:
            self._first_ns = self._last_ns = time_ns
        self._first_ns = min(self._first_ns, time_ns)
        self._last_ns = max(self._last_ns, time_ns)

    def flush(self) -> None:
        """Write the messages that were appended."""
        if self._closed:
            return
        try:
            self._file.flush()
        except _REFUSALS as error:
            self._refuse(error)

    def close(self) -> None:
        """Write what is left, the index, metadata.yaml and the checksums."""
        if self._closed:
            return
        self._closed = True
        span_ns = None if self._first_ns is None else (self._first_ns, self._last_ns)
        name = self._file_path.name
        content = metadata.metadata_of(
            name, self._storage, list(self._topics.values()), span_ns, self.custom
        )
        try:
            self._file.finish(metadata.as_yaml(content))
            if self._storage == 'sqlite3':
                # mcap has checksums of its own.
                checksum = f'{file_crc32(self._file_path):08x}'
                content['custom_data'] = {**self.custom, CRC_KEY: checksum}
            text = metadata.as_yaml({metadata.KEY: content})
            (self.path / metadata.NAME).write_text(text, 'utf-8')
            write_checksums(self.path, (name, metadata.NAME), self._key)
        except _REFUSALS as error:
            raise self._error(error) from error

    def _refuse(self, error: Exception) -> NoReturn:
        self._closed = True
        self._file.abandon()
        raise self._error(error) from error

    def _error(self, error: Exception) -> RecordingError:
        return RecordingError(f'expected room and permission to write {self.path}, got {error}')

    def __enter__(self) -> 'RecordingWriter':
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        _value: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
            return
        # What was recorded before the failure is worth an index; the failure is what counts.
        with suppress(RecordingError):
            self.close()


def _merged(topics: Mapping[int, Records]) -> Batch:
    """Return the messages of several topics in the order of reception.

    The order within a topic is kept, also where its clock was set back.  If that happened equally
    often in every topic, what came after it is merged by the times after it.  At equal times the
    topic that comes first in `topics` is first: give pulses before forces.
    """
    parts = list(topics.values())
    shift = np.cumsum([0, *(len(part.buffer) for part in parts)])
    order = _order_of_reception([part.time_ns for part in parts])
    whole = Records(
        np.concatenate([part.buffer for part in parts]),
        np.concatenate([part.start + offset for part, offset in zip(parts, shift, strict=False)]),
        np.concatenate([part.end + offset for part, offset in zip(parts, shift, strict=False)]),
        np.concatenate([part.time_ns for part in parts]),
    )
    number = np.repeat(list(topics), [len(part) for part in parts])
    return number[order], whole.select(order)


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
    storage: str = 'mcap',
    compression: str = '',
    axis: str | Sequence[float] = 'z',
    custom: Mapping[str, str] | None = None,
    key: bytes | None = None,
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
    storage, compression, custom, key
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
        (FORCE_TOPIC, WRENCH_STAMPED): encode_forces(forces, direction_of(axis), quantity),
    }
    with RecordingWriter(path, storage, compression, custom, key) as writer:
        topics = {writer.add_topic(*topic): part for topic, part in encoded.items()}
        for topic in further:
            number = writer.add_topic(topic.name, topic.type_name)
            topics[number] = Records.of(topic.messages, np.asarray(topic.time_ns, np.int64))
        numbers, records = _merged(topics)
        # Not a copy of each message but a view: a thousand of them are a small part of the work.
        view = records.buffer.data
        for topic, time_ns, start, end in zip(
            numbers.tolist(),
            records.time_ns.tolist(),
            records.start.tolist(),
            records.end.tolist(),
            strict=True,
        ):
            writer.append(topic, time_ns, view[start:end])
