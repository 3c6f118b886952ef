# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers out of many CDR records at once, with the slow way for records that are not alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.serde import SerdeError

from rpms_ros.errors import RecordingError
from rpms_ros.recording.definitions import differs_from_known
from rpms_ros.recording.definitions import types_of
from rpms_ros.recording.grouping import Group
from rpms_ros.recording.grouping import alike
from rpms_ros.recording.layout import Layout
from rpms_ros.recording.layout import field_paths
from rpms_ros.recording.layout import layout_of
from rpms_ros.recording.records import Channel
from rpms_ros.recording.records import Records
from rpms_ros.recording.records import gather

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
