# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One topic out of a recording, decoded while the recording is read.

Records that are laid out alike are found without decoding them, and read as an array; the others
are decoded by rosbags, one by one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from rosbags.serde import SerdeError

from rpms_ros.axis import UNITS
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, IntArray
from rpms_ros.recording.rosbag.definitions import (
    FLOAT64,
    LENGTH,
    PULSE,
    WRENCH,
    WRENCH_STAMPED,
    Field,
    differs_from_known,
    fields_of,
    has_fixed_places,
    record_type,
    types_of,
)
from rpms_ros.recording.rosbag.records import Channel, Records, gather
from rpms_ros.recording.rosbag.scan import Scan

# Plain CDR in either byte order.
_BYTE_ORDERS: tuple[tuple[int, Literal['<', '>']], ...] = ((1, '<'), (0, '>'))


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
            fault = f'expected serialization cdr on topic {channel.topic}'
            raise RecordingError(f'{fault}, got {channel.serialization or "none"}')
        self._type_name = channel.type_name
        self._types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
        self._string = string
        self._fields = fields_of(self._types, channel.type_name)
        self.differs = differs_from_known(channel.type_name, self._types)
        plain = {one.path: one for one in self._fields if one.count == 1}
        self._kinds = {path: plain[path].number for path in wanted if path in plain}
        missing = [path for path in wanted if self._kinds.get(path) is None]
        missing += [string] if string and string not in plain else []
        if missing:
            where = f'the definition of {channel.type_name} on topic {channel.topic}'
            fault = f'expected fields {", ".join(missing)} in {where}'
            raise RecordingError(f'{fault}, got {", ".join(one.path for one in self._fields)}')

    def decode(self, records: Records) -> Columns:
        """Return the wanted numbers of every message."""
        count = len(records)
        number = {path: np.zeros(count, kind) for path, kind in self._kinds.items()}
        columns = Columns(number, np.zeros(count, np.bool_))
        if count and has_fixed_places(self._fields):
            for chosen, kind in _alike(records, self._fields):
                rows = gather(records.buffer, records.start[chosen], f'V{kind.itemsize}')
                rows = rows.view(kind)
                for path, column in number.items():
                    column[chosen] = rows[path]
                if self._string:
                    texts = rows[self._string]
                    texts = texts[:1] if (texts == texts[0]).all() else np.unique(texts)
                    columns.strings |= {text.decode('utf-8', 'replace') for text in texts}
                columns.good[chosen] = True
        for index in np.flatnonzero(~columns.good).tolist():
            self._decode_one(records.message(index), index, columns)
        return columns

    def _decode_one(self, message: bytes, index: int, columns: Columns) -> None:
        """Decode one message with rosbags; leave it out if that fails."""
        try:
            value = self._types.deserialize_cdr(message, self._type_name)
        except SerdeError:
            return
        for path, column in columns.number.items():
            column[index] = attrgetter(path)(value)
        if self._string:
            columns.strings.add(attrgetter(self._string)(value))
        columns.good[index] = True


def _alike(
    records: Records, fields: tuple[Field, ...]
) -> Iterator[tuple[slice | IntArray, np.dtype[Any]]]:
    """Yield well-formed records of one byte order and length of the string, and their type."""
    size = records.end - records.start
    places: Mapping[str, Any] = record_type(fields, '<', 1).fields or {}
    length_at = places[LENGTH][1] if LENGTH in places else None
    readable = np.flatnonzero(size >= (4 if length_at is None else length_at + 4))
    encoding = gather(records.buffer, records.start[readable], '>u2')
    for code, order in _BYTE_ORDERS:
        index = readable[encoding == code]
        length = np.ones(len(index), np.int64)
        if length_at is not None:
            length[:] = gather(records.buffer, records.start[index] + length_at, f'{order}u4')
        index, length = (one[(length > 0) & (length <= size[index])] for one in (index, length))
        for value in np.unique(length[:1] if (length == length[:1]).all() else length).tolist():
            kind = record_type(fields, order, value)
            spare = size[index] - kind.itemsize
            # middlewares round the length of a message up to a multiple of four
            chosen = index[(length == value) & (spare >= 0) & (spare < 4)]
            if length_at is not None:
                closing = records.start[chosen] + (length_at + 4 + value - 1)
                chosen = chosen[gather(records.buffer, closing, 'u1') == 0]
            if len(chosen):
                yield slice(None) if len(chosen) == len(records) else chosen, kind


SECOND, NANOSECOND = 'header.stamp.sec', 'header.stamp.nanosec'
PULSE_TYPES = {PULSE: ('sequence', 'intensity', 'width')}
SENSOR_TYPES = {
    quantity: {
        WRENCH_STAMPED: tuple(f'wrench.{quantity}.{name}' for name in 'xyz'),
        WRENCH: tuple(f'{quantity}.{name}' for name in 'xyz'),
        FLOAT64: ('data',),
    }
    for quantity in UNITS
}
"""Paths of what is read out of the messages of a sensor, by what it measures."""


class TopicValues(NamedTuple):
    """Numbers of a topic in the order of the recording, which is that of reception.

    Attributes
    ----------
    topic, type_name : str
        Its name in the recording, and type of the messages.
    number : mapping of str to ndarray, shape (messages,)
        Wanted fields.
    received_ns : ndarray of int64, shape (messages,)
        When each message was received [ns], by a clock that may have been set back.
    place : ndarray of int64, shape (messages,)
        Which message of the recording each is, over all topics.
    frame_ids : tuple of str
        All that occur, sorted.
    """

    topic: str
    type_name: str
    number: Mapping[str, npt.NDArray[Any]]
    received_ns: IntArray
    place: IntArray
    frame_ids: tuple[str, ...]

    def stamp_ns(self) -> IntArray:
        """Return the stamps (messages,) [ns], or times of reception if there are none."""
        if SECOND not in self.number:
            return self.received_ns
        stamp_ns: IntArray = self.number[SECOND].astype(np.int64)
        stamp_ns *= NANOSECONDS_PER_SECOND
        return stamp_ns + self.number[NANOSECOND].astype(np.int64)


@dataclass
class _Candidate:
    """Messages of a topic and type that may be the wanted one."""

    blocks: list[tuple[Columns, IntArray, Any]] = field(default_factory=list)
    """Columns with times of reception [ns] and places."""
    decoders: dict[Channel, Decoder] = field(default_factory=dict)
    problem: RecordingError | None = None


class TopicReading:
    """Decodes the messages of a topic as they come.

    Parameters
    ----------
    name : str
        Name of the topic; without a leading slash it fits below a namespace too.
    types : mapping of str to tuple of str
        Types that can be used, and paths of the numbers that are read out of each.
    """

    def __init__(self, name: str, types: Mapping[str, tuple[str, ...]]) -> None:
        self._name = name
        self._types = types
        self._candidates: dict[tuple[str, str], _Candidate] = {}

    def take(self, channel: Channel, records: Records) -> int:
        """Decode messages if they may belong to the topic; return how many were kept."""
        if not self._fits(channel.topic) or channel.type_name not in self._types:
            return 0
        candidate = self._candidates.setdefault((channel.topic, channel.type_name), _Candidate())
        wanted, string = self._types[channel.type_name], None
        # with a header; of others the time of reception counts
        if channel.type_name in (PULSE, WRENCH_STAMPED):
            wanted, string = (*wanted, SECOND, NANOSECOND), 'header.frame_id'
        try:
            if channel not in candidate.decoders:
                candidate.decoders[channel] = Decoder(channel, wanted, string)
        except RecordingError as problem:
            candidate.problem = problem
            return 0
        columns = candidate.decoders[channel].decode(records)
        candidate.blocks.append((columns, records.time_ns, records.place))
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
        return _joined(topic, chosen, candidate, scan)

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
            fault = f'expected one topic {self._name} in {scan.path}, got {", ".join(fitting)}'
            raise RecordingError(fault)
        others = ', '.join(f'{name} ({kind})' for name, kind in sorted(scan.topics)) or 'no topics'
        raise RecordingError(f'expected topic {self._name} in {scan.path}, got {others}')

    def _type(self, scan: Scan, topic: str) -> str:
        """Return the type with most messages among those that can be used."""
        counts = {kind: one.count for (name, kind), one in scan.topics.items() if name == topic}
        if not (usable := [kind for kind in counts if kind in self._types]):
            known = ' or '.join(self._types)
            raise RecordingError(f'expected {known} on topic {topic}, got {", ".join(counts)}')
        chosen = max(usable, key=lambda kind: counts[kind])
        if not counts[chosen]:
            raise RecordingError(f'expected messages on topic {topic} in {scan.path}, got none')
        for kind, count in counts.items():
            if kind != chosen and count:
                left = f'{count} messages of {kind} on {topic} left out'
                scan.findings.add('other_type', left, count)
        return chosen


def _joined(topic: str, type_name: str, candidate: _Candidate, scan: Scan) -> TopicValues:
    """Return all blocks as one, in the order of the recording; note what was left out."""
    columns, times, places = zip(*candidate.blocks, strict=True)
    received_ns, place = np.concatenate(times), np.concatenate(places)
    good = np.concatenate([block.good for block in columns])
    if bad := int(np.count_nonzero(~good)):
        scan.findings.add('undecodable_message', f'{bad} messages on {topic} left out', bad)
    if any(decoder.differs for decoder in candidate.decoders.values()):
        other = f'{topic}: {type_name} is defined in another way than here'
        scan.findings.add('other_definition', other)
    frame_ids = tuple(sorted(set().union(*(block.strings for block in columns))))
    if len(frame_ids) > 1:
        names = ', '.join(map(repr, frame_ids))
        scan.findings.add('mixed_frame_ids', f'{topic} has frame ids {names}', len(frame_ids) - 1)
    order = slice(None) if good.all() else np.flatnonzero(good)
    if (place[1:] < place[:-1]).any():
        # Channels of one topic were read one after the other.
        sorted_places = np.argsort(place, kind='stable')
        order = sorted_places[good[sorted_places]]
    number = {
        # Taken out of the blocks: what is joined need not be there twice.
        path: np.concatenate([block.number.pop(path) for block in columns])[order]
        for path in list(columns[0].number)
    }
    return TopicValues(topic, type_name, number, received_ns[order], place[order], frame_ids)
