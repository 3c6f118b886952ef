# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the fields of a message lie in its CDR record, worked out from its definition.

In plain CDR (XCDR version 1, as in every recording) a number is aligned to its own size, counted
from the end of the four bytes of encapsulation; a string is its length with the closing NUL (four
bytes), then its bytes.  A message of numbers and one string therefore has fixed places once the
length of that string is known, and records of one such length can be decoded together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.recording.definitions import Typestore

ENCAPSULATION = 4
LENGTH_SIZE = 4

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_ALIASES = {'bool': 'uint8', 'byte': 'uint8', 'char': 'uint8'}
_NUMBERS = frozenset(
    ['float32', 'float64'] + [f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)]
)


@dataclass(frozen=True)
class Field:
    """One number, array of numbers or string of a message.

    Attributes
    ----------
    path : str
        Names from the top of the message, joined by dots.
    kind : dtype or None
        Type of the number in native byte order; None for a string.
    count : int
        How many numbers.
    """

    path: str
    kind: npt.DTypeLike | None
    count: int = 1


@dataclass(frozen=True)
class Places:
    """Offsets in a record whose string has a given length.

    Attributes
    ----------
    offset : dict of str to int
        Start of each field, from the start of the record [bytes].
    end : int
        Length of the record without padding behind it [bytes].
    """

    offset: dict[str, int]
    end: int


@dataclass(frozen=True)
class Layout:
    """Fields of a message that has at most one string and no sequence.

    Attributes
    ----------
    fields : tuple of Field
        All fields in order.
    """

    fields: tuple[Field, ...]

    @property
    def string(self) -> str | None:
        """Path of the string, if there is one."""
        return next((field.path for field in self.fields if field.kind is None), None)

    @property
    def string_length_at(self) -> int:
        """Where the length of the string stands [bytes from the start of the record]."""
        return self.places(0).offset[str(self.string)] - LENGTH_SIZE

    def kind(self, path: str) -> np.dtype[Any]:
        """Return the type of a number."""
        return np.dtype(next(field.kind for field in self.fields if field.path == path))

    def places(self, string_length: int) -> Places:
        """Return the places for a string of this length with its closing NUL [bytes]."""
        offset: dict[str, int] = {}
        position = 0
        for field in self.fields:
            if field.kind is None:
                position = _aligned(position, LENGTH_SIZE) + LENGTH_SIZE
                size = string_length
            else:
                itemsize = np.dtype(field.kind).itemsize
                position = _aligned(position, itemsize)
                size = itemsize * field.count
            offset[field.path] = ENCAPSULATION + position
            position += size
        return Places(offset, ENCAPSULATION + position)


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size


def layout_of(types: Typestore, type_name: str) -> Layout | None:
    """Return the layout of a message, or None where it needs more than one length.

    Parameters
    ----------
    types : Typestore
        Definitions of the message and its parts.
    type_name : str
        Name of the message.
    """
    fields = tuple(_flattened(types, type_name, ''))
    strings = sum(field.kind is None for field in fields)
    if strings > 1 or any(field.count == 0 for field in fields):
        return None
    return Layout(fields)


def field_paths(types: Typestore, type_name: str) -> list[str]:
    """Return the paths of all fields of a message."""
    return [field.path for field in _flattened(types, type_name, '')]


def _flattened(types: Typestore, type_name: str, prefix: str) -> Iterator[Field]:
    """Yield the fields; what has no fixed place has a count of zero."""
    for name, (kind, detail) in types.fielddefs[type_name][1]:
        path = f'{prefix}{name}'
        if kind == _NAME:
            yield from _flattened(types, detail, f'{path}.')
        elif kind == _BASE:
            yield _base(path, detail[0], 1)
        elif kind == _ARRAY and detail[0][0] == _BASE and detail[0][1][0] != 'string':
            yield _base(path, detail[0][1][0], detail[1])
        else:
            yield Field(path, 'u1', 0)


def _base(path: str, name: str, count: int) -> Field:
    if name == 'string':
        return Field(path, None)
    number = _ALIASES.get(name, name)
    return Field(path, number, count) if number in _NUMBERS else Field(path, 'u1', 0)
