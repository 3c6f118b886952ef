# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One topic out of a recording, decoded while the recording is read.

Numbers out of many CDR records at once, with the slow way for records that are not alike.

Records that are laid out alike, found without decoding them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from rosbags.serde import SerdeError

from rpms_ros.axis import UNITS
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray
from rpms_ros.recording.rosbag.definitions import (
    ENCAPSULATION,
    FLOAT64,
    LENGTH_SIZE,
    PULSE,
    WRENCH,
    WRENCH_STAMPED,
    Layout,
    differs_from_known,
    field_paths,
    layout_of,
    types_of,
)
from rpms_ros.recording.rosbag.records import Channel, Records, gather
from rpms_ros.recording.rosbag.scan import Scan

# Middlewares round the length of a message up to a multiple of four.
LARGEST_PADDING = 3
ByteOrder = Literal['<', '>']
# Second byte of the encapsulation: plain CDR in either byte order.
_BYTE_ORDERS: tuple[tuple[int, ByteOrder], ...] = ((1, '<'), (0, '>'))


@dataclass(frozen=True)
class Group:
    """Records of one byte order whose string has one length.

    Attributes
    ----------
    chosen : slice or ndarray of int64
        Which records.
    order : str
        ``<`` or ``>``, as NumPy writes it.
    string_length : int
        Length of the string with its closing NUL [bytes]; 0 where the message has none.
    """

    chosen: slice | IntArray
    order: ByteOrder
    string_length: int


def alike(records: Records, layout: Layout) -> Iterator[Group]:
    """Yield groups of well-formed records; those that belong to no group are malformed.

    Parameters
    ----------
    records : Records
        Messages of one type.
    layout : Layout
        Of that type.
    """
    if not len(records):
        return
    first_need = max(ENCAPSULATION, layout.string_length_at + LENGTH_SIZE if layout.string else 0)
    readable = np.flatnonzero(records.end - records.start >= first_need)
    encapsulation = gather(records.buffer, records.start[readable], '>u2')
    for code, order in _BYTE_ORDERS:
        index = readable[encapsulation == code]
        length = _string_lengths(records, layout, index, order)
        for value in _different(length):
            chosen = _well_formed(records, layout, index[length == value], value)
            if len(chosen):
                whole = len(chosen) == len(records)
                yield Group(slice(None) if whole else chosen, order, value)


def _string_lengths(
    records: Records, layout: Layout, index: IntArray, order: ByteOrder
) -> IntArray:
    """Return the lengths of the string (index,) [bytes]; what cannot be is -1."""
    if not layout.string:
        return np.zeros(len(index), np.int64)
    start = records.start[index]
    length = gather(records.buffer, start + layout.string_length_at, f'{order}u4').astype(np.int64)
    possible = (length > 0) & (length <= records.end[index] - start)
    return np.where(possible, length, -1)


def _different(length: IntArray) -> list[int]:
    if len(length) and (length == length[0]).all():
        length = length[:1]
    return [int(value) for value in np.unique(length) if value >= 0]


def _well_formed(
    records: Records, layout: Layout, index: IntArray, string_length: int
) -> IntArray:
    """Return those of the records that end where they should and close their string."""
    places = layout.places(string_length)
    spare = records.end[index] - records.start[index] - places.end
    index = index[(spare >= 0) & (spare <= LARGEST_PADDING)]
    if layout.string:
        last = records.start[index] + (places.offset[layout.string] + string_length - 1)
        index = index[gather(records.buffer, last, 'u1') == 0]
    return index


BoolArray = npt.NDArray[np.bool_]


@dataclass
class Columns:
    """Fields of many messages.

    Attributes
    ----------
    number : dict of str to ndarray, shape (messages,)
        Each wanted number.
    strings : set of str
        Every value that the string of the message had.
    good : ndarray of bool, shape (messages,)
        Whether the message could be decoded; the numbers of the others are zero.
    """

    number: dict[str, npt.NDArray[Any]]
    good: BoolArray
    strings: set[str] = field(default_factory=set)


class Decoder:
    """Reads wanted numbers out of the records of one channel.

    Parameters
    ----------
    channel : Channel
        Topic, type and definition.
    wanted : sequence of str
        Paths of the numbers, such as ``wrench.force.x``.
    string : str or None
        Path of the string whose values are noted, such as ``header.frame_id``.

    Raises
    ------
    RecordingError
        If the definition cannot be used or does not have these fields.
    """

    def __init__(self, channel: Channel, wanted: Sequence[str], string: str | None = None) -> None:
        if channel.serialization != 'cdr':
            raise RecordingError(
                f'expected serialization cdr on topic {channel.topic}, '
                f'got {channel.serialization or "none"}'
            )
        self._channel = channel
        self._types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
        self._wanted = tuple(wanted)
        self._string = string
        self._layout = layout_of(self._types, channel.type_name)
        self.differs = differs_from_known(channel.type_name, self._types)
        self._expect_fields()

    def _expect_fields(self) -> None:
        paths = field_paths(self._types, self._channel.type_name)
        named = [*self._wanted, *([self._string] if self._string else [])]
        if missing := [path for path in named if path not in paths]:
            raise RecordingError(
                f'expected fields {", ".join(missing)} in the definition of '
                f'{self._channel.type_name} on topic {self._channel.topic}, '
                f'got {", ".join(paths)}'
            )

    def decode(self, records: Records) -> Columns:
        """Return the wanted numbers of every message."""
        count = len(records)
        columns = Columns(
            {path: np.zeros(count, self._kind(path)) for path in self._wanted},
            np.zeros(count, np.bool_),
        )
        if self._layout is not None:
            for group in alike(records, self._layout):
                self._decode_group(records, self._layout, group, columns)
        for index in np.flatnonzero(~columns.good).tolist():
            self._decode_one(records.message(index), index, columns)
        return columns

    def _kind(self, path: str) -> npt.DTypeLike:
        return np.float64 if self._layout is None else self._layout.kind(path)

    def _decode_group(
        self, records: Records, layout: Layout, group: Group, columns: Columns
    ) -> None:
        places = layout.places(group.string_length)
        start = records.start[group.chosen]
        for path in self._wanted:
            kind = layout.kind(path).newbyteorder(group.order)
            at = start + places.offset[path]
            columns.number[path][group.chosen] = gather(records.buffer, at, kind)
        if self._string:
            at = start + places.offset[self._string]
            columns.strings |= _distinct(records, at, group.string_length - 1)
        columns.good[group.chosen] = True

    def _decode_one(self, message: bytes, index: int, columns: Columns) -> None:
        """Decode one message with rosbags; leave it out if that fails."""
        try:
            value = self._types.deserialize_cdr(message, self._channel.type_name)
        except SerdeError:
            return
        for path in self._wanted:
            columns.number[path][index] = _attribute(value, path)
        if self._string:
            columns.strings.add(_attribute(value, self._string))
        columns.good[index] = True


def _attribute(message: object, path: str) -> Any:
    return reduce(getattr, path.split('.'), message)


def _distinct(records: Records, at: npt.NDArray[np.int64], size: int) -> set[str]:
    """Return the distinct strings of `size` bytes that start at these places."""
    if size <= 0:
        return {''}
    values = gather(records.buffer, at, f'S{size}')
    if (values == values[0]).all():
        values = values[:1]
    return {value.decode('utf-8', 'replace') for value in np.unique(values)}


SECOND, NANOSECOND = 'header.stamp.sec', 'header.stamp.nanosec'
FRAME_ID = 'header.frame_id'


@dataclass(frozen=True)
class Fields:
    """What is read out of a message type.

    Attributes
    ----------
    values : tuple of str
        Paths of numbers.
    stamped : bool
        Whether it has a header; else the time of reception counts.
    """

    values: tuple[str, ...]
    stamped: bool

    @property
    def wanted(self) -> tuple[str, ...]:
        """Paths of all numbers, those of the stamp included."""
        return (*self.values, SECOND, NANOSECOND) if self.stamped else self.values

    def along(self, direction: FloatArray) -> 'Fields':
        """Return the fields without the components (of three) across a direction (3,)."""
        if len(self.values) != len(direction):
            return self
        kept = tuple(path for path, share in zip(self.values, direction, strict=True) if share)
        return Fields(kept, self.stamped)


PULSE_TYPES = {PULSE: Fields(('sequence', 'intensity', 'width'), stamped=True)}
SENSOR_TYPES = {
    quantity: {
        WRENCH_STAMPED: Fields(tuple(f'wrench.{quantity}.{name}' for name in 'xyz'), stamped=True),
        WRENCH: Fields(tuple(f'{quantity}.{name}' for name in 'xyz'), stamped=False),
        FLOAT64: Fields(('data',), stamped=False),
    }
    for quantity in UNITS
}
"""What is read out of the messages of a sensor, by what it measures."""


@dataclass(frozen=True)
class TopicValues:
    """Numbers of a topic in the order of the recording, which is that of reception.

    Attributes
    ----------
    type_name : str
        Type of the messages.
    number : mapping of str to ndarray, shape (messages,)
        Wanted fields.
    received_ns : ndarray of int64, shape (messages,)
        When each message was received [ns], by a clock that may have been set back.
    place : ndarray of int64, shape (messages,)
        Which message of the recording each is, over all topics.
    frame_ids : tuple of str
        All that occur, sorted.
    """

    type_name: str
    number: Mapping[str, npt.NDArray[Any]]
    received_ns: IntArray
    place: IntArray
    frame_ids: tuple[str, ...]

    def stamp_ns(self) -> IntArray:
        """Return the stamps (messages,) [ns], or times of reception if there are none."""
        if SECOND not in self.number:
            return self.received_ns
        second = self.number[SECOND].astype(np.int64)
        nanosecond: IntArray = self.number[NANOSECOND].astype(np.int64)
        return second * NANOSECONDS_PER_SECOND + nanosecond


@dataclass
class _Candidate:
    """Messages of a topic and type that may be the wanted one."""

    columns: list[Columns] = field(default_factory=list)
    place: list[IntArray] = field(default_factory=list)
    received_ns: list[IntArray] = field(default_factory=list)
    decoders: dict[Channel, Decoder] = field(default_factory=dict)
    problem: RecordingError | None = None


class TopicReading:
    """Decodes the messages of a topic as they come.

    Parameters
    ----------
    name : str
        Name of the topic; without a leading slash it fits below a namespace too.
    types : mapping of str to Fields
        Types that can be used.
    """

    def __init__(self, name: str, types: Mapping[str, Fields]) -> None:
        self._name = name
        self._types = types
        self._candidates: dict[tuple[str, str], _Candidate] = {}

    def take(self, channel: Channel, records: Records) -> int:
        """Decode messages if they may belong to the topic; return how many were kept."""
        if not self._fits(channel.topic) or channel.type_name not in self._types:
            return 0
        key = channel.topic, channel.type_name
        candidate = self._candidates.setdefault(key, _Candidate())
        fields = self._types[channel.type_name]
        try:
            if channel not in candidate.decoders:
                string = FRAME_ID if fields.stamped else None
                candidate.decoders[channel] = Decoder(channel, fields.wanted, string)
        except RecordingError as problem:
            candidate.problem = problem
            return 0
        candidate.columns.append(candidate.decoders[channel].decode(records))
        candidate.received_ns.append(records.time_ns)
        assert records.place is not None, 'a scan counts the places'
        candidate.place.append(records.place)
        return len(records)

    def values(self, scan: Scan) -> TopicValues:
        """Return the numbers of the topic, after the pass over the recording.

        Raises
        ------
        RecordingError
            If the topic is missing, ambiguous, empty or of another type.
        """
        topic = self._topic(scan)
        chosen = self._type(scan, topic)
        candidate = self._candidates[topic, chosen]
        if candidate.problem:
            raise candidate.problem
        return _joined(topic, chosen, self._types[chosen], candidate, scan)

    def _fits(self, topic: str) -> bool:
        if self._name.startswith('/'):
            return topic == self._name
        return f'/{topic}'.endswith(f'/{self._name}')

    def _topic(self, scan: Scan) -> str:
        fitting = sorted({name for name, _ in scan.topics if self._fits(name)})
        exact = f'/{self._name.lstrip("/")}'
        if exact in fitting:
            return exact
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise RecordingError(
                f'expected one topic {self._name} in {scan.path}, got {", ".join(fitting)}'
            )
        others = ', '.join(f'{name} ({kind})' for name, kind in sorted(scan.topics)) or 'no topics'
        raise RecordingError(f'expected topic {self._name} in {scan.path}, got {others}')

    def _type(self, scan: Scan, topic: str) -> str:
        """Return the type with most messages among those that can be used."""
        counts = {
            kind: facts.count for (name, kind), facts in scan.topics.items() if name == topic
        }
        usable = [kind for kind in counts if kind in self._types]
        if not usable:
            raise RecordingError(
                f'expected {" or ".join(self._types)} on topic {topic}, got {", ".join(counts)}'
            )
        chosen = max(usable, key=lambda kind: counts[kind])
        if not counts[chosen]:
            raise RecordingError(f'expected messages on topic {topic} in {scan.path}, got none')
        for kind, count in counts.items():
            if kind != chosen and count:
                scan.findings.add(
                    'other_type', f'{count} messages of {kind} on {topic} left out', count
                )
        return chosen


def _joined(
    topic: str, type_name: str, fields: Fields, candidate: _Candidate, scan: Scan
) -> TopicValues:
    """Return all blocks as one, in the order of the recording; note what was left out."""
    received_ns = np.concatenate(candidate.received_ns)
    good = np.concatenate([columns.good for columns in candidate.columns])
    if bad := int(np.count_nonzero(~good)):
        scan.findings.add('undecodable_message', f'{bad} messages on {topic} left out', bad)
    if any(decoder.differs for decoder in candidate.decoders.values()):
        scan.findings.add(
            'other_definition', f'{topic}: {type_name} is defined in another way than here'
        )
    frame_ids = sorted(set().union(*(columns.strings for columns in candidate.columns)))
    if len(frame_ids) > 1:
        names = ', '.join(map(repr, frame_ids))
        scan.findings.add('mixed_frame_ids', f'{topic} has frame ids {names}', len(frame_ids) - 1)
    place = np.concatenate(candidate.place)
    order = slice(None) if good.all() else np.flatnonzero(good)
    if len(candidate.decoders) > 1:
        # Channels were read one after the other.
        sorted_places = np.argsort(place, kind='stable')
        order = sorted_places[good[sorted_places]]
    number = {
        # Taken out of the blocks: what is joined need not be there twice.
        path: np.concatenate([columns.number.pop(path) for columns in candidate.columns])[order]
        for path in fields.wanted
    }
    return TopicValues(type_name, number, received_ns[order], place[order], tuple(frame_ids))
