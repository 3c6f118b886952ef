# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Records that are laid out alike, found without decoding them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpms_ros.pulses import IntArray
from rpms_ros.recording.layout import ENCAPSULATION
from rpms_ros.recording.layout import LENGTH_SIZE
from rpms_ros.recording.layout import Layout
from rpms_ros.recording.records import Records
from rpms_ros.recording.records import gather

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
