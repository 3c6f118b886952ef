# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions: those of ROS 2 Jazzy and of rpms_msgs, and those that a recording carries.

A recording may have been made with another version of a message.  What it carries counts; what
the package knows is for recordings that carry nothing, and for writing.

Where the fields of a message lie in its CDR record, worked out from its definition.

In plain CDR (XCDR version 1, as in every recording) a number is aligned to its own size, counted
from the end of the four bytes of encapsulation; a string is its length with the closing NUL (four
bytes), then its bytes.  A message of numbers and one string therefore has fixed places once the
length of that string is known, and records of one such length can be decoded together.

Which number of a force message is the force of the muscle.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)

from rpms_ros.axis import unit_vector
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray

PULSE = 'rpms_msgs/msg/Pulse'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
WRENCH = 'geometry_msgs/msg/Wrench'
FLOAT64 = 'std_msgs/msg/Float64'
MUSCLE_ESTIMATE = 'rpms_msgs/msg/MuscleEstimate'

FOLDER = Path(__file__).parents[1] / 'msg'
_IDL_SEPARATOR = '=' * 80 + '\n'

# Ten times what the largest messages of ROS have.
_LONGEST = 500_000
_MOST_FIELDS = 10_000
_DEEPEST = 30
_DEEPEST_IDL = 8
_IDL_TEXT = re.compile(r'"(?:[^"\\\n]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_IDL_EXPRESSION = re.compile(r'\bconst\b[^;=]*=[^;]*[(|^&<>+*/%~]')
# What rosbags raises at texts that are no definitions.
_ERRORS = (
    TypesysError,
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)

Fields = list[tuple[str, Any]]
"""Names and rosbags descriptions of the fields of one type, in order."""
Types = dict[str, tuple[Any, Fields]]
"""Constants and fields by type name: rosbags' `Typesdict`."""
Typestore = Any
"""rosbags' `Typestore`, which carries no usable type information."""


@cache
def known_types() -> Typestore:
    """Return the types of ROS 2 Jazzy and of rpms_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: Types = {}
    for path in sorted(FOLDER.glob('*.msg')):
        types.update(get_types_from_msg(path.read_text(), f'rpms_msgs/msg/{path.stem}'))
    store.register(types)
    return store


@cache
def written_definition(type_name: str) -> tuple[str, str]:
    """Return text and hash of a known type, as a recording carries them.

    Raises
    ------
    RecordingError
        If the type is not known.
    """
    store = known_types()
    if type_name not in store.fielddefs:
        raise RecordingError(f'expected a known message type, got {type_name}')
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return text, store.hash_rihs01(type_name)


def described_type(type_name: str, text_of: Callable[[str], str]) -> tuple[str, str]:
    """Return text and hash of a type that the package does not know, as a recording carries them.

    Parameters
    ----------
    type_name : str
        Name of the message.
    text_of : callable
        Returns the definition of a type by its name.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    waiting = [type_name]
    found: Types = {}
    while waiting:
        name = waiting.pop()
        if name in store.fielddefs or name in found:
            continue
        found.update(get_types_from_msg(text_of(name), name))
        fields = [detail for _, (_, detail) in found[name][1]]
        parts = [detail[0][1] if isinstance(detail[0], tuple) else detail for detail in fields]
        waiting += [part for part in parts if isinstance(part, str)]
    store.register(found)
    return store.generate_msgdef(type_name, ros_version=2)[0], store.hash_rihs01(type_name)


@cache
def types_of(type_name: str, text: str, encoding: str) -> Typestore:
    """Return the types that a definition out of a recording describes.

    Parameters
    ----------
    type_name : str
        Name of the message, such as ``geometry_msgs/msg/WrenchStamped``.
    text : str
        Its definition with those of its parts; empty if the recording carries none.
    encoding : str
        ``ros2msg`` or ``ros2idl``.

    Raises
    ------
    RecordingError
        If the definition cannot be used, or is missing and the type is not known either.
    """
    if not text:
        if type_name not in known_types().fielddefs:
            raise RecordingError(
                f'expected a definition of {type_name} in the recording, got none'
            )
        return known_types()
    store = get_typestore(Stores.EMPTY)
    try:
        if len(text) > _LONGEST:
            raise TypesysError(f'{len(text)} characters')
        store.register(_parse(type_name, text, encoding))
        _count_fields(store.fielddefs, type_name)
    except _ERRORS as error:
        reason = str(error).splitlines() or [type(error).__name__]
        raise RecordingError(
            f'expected a definition of {type_name} that can be used, got {reason[0]:.200}'
        ) from error
    return store


def _count_fields(fielddefs: Types, type_name: str, depth: int = 0) -> int:
    """Return how many fields a type has with those of its parts.

    Raises
    ------
    TypesysError
        If a part is missing or contains itself, or if they are more than any message has.
    """
    if type_name not in fielddefs:
        raise TypesysError(f'no {type_name} among {", ".join(fielddefs) or "no types"}')
    count = 0
    for _, (_, detail) in fielddefs[type_name][1]:
        name = detail[0][1] if isinstance(detail[0], tuple) else detail
        count += _count_fields(fielddefs, name, depth + 1) if isinstance(name, str) else 1
        if depth > _DEEPEST or count > _MOST_FIELDS:
            raise TypesysError(f'more than {_DEEPEST} levels or {_MOST_FIELDS} fields')
    return count


def _parse(type_name: str, text: str, encoding: str) -> Types:
    if encoding == 'ros2msg':
        return dict(get_types_from_msg(text, type_name))
    _expect_simple_idl(text)
    types: Types = {}
    parts = text.split(_IDL_SEPARATOR)[1:] if text.startswith(_IDL_SEPARATOR) else [text]
    for part in parts:
        body = part.split('\n', 1)[1] if part.startswith('IDL: ') else part
        types.update(get_types_from_idl(body))
    return types


def _expect_simple_idl(text: str) -> None:
    """Refuse what rosbags' parser of IDL takes longer for with every level, without end."""
    bare = _IDL_TEXT.sub('', text)
    if _IDL_EXPRESSION.search(bare) or bare.count('<') > _MOST_FIELDS:
        raise TypesysError('a constant that is calculated')
    depth = 0
    for char in filter('<>{}'.__contains__, bare):
        depth += 1 if char in '<{' else -1
        if depth > _DEEPEST_IDL:
            raise TypesysError(f'more than {_DEEPEST_IDL} levels')


def differs_from_known(type_name: str, types: Typestore) -> bool:
    """Tell whether a definition out of a recording contradicts the one that the package knows.

    One that ends earlier, or goes on with more fields, is of an older or newer version and tells
    the same.
    """
    known = known_types()
    if type_name not in known.fielddefs:
        return False
    pairs = zip(_leaves(known, type_name), _leaves(types, type_name), strict=False)
    return any(here != there for here, there in pairs)


def _leaves(types: Typestore, type_name: str, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield names and kinds of all fields in the order in which they are sent."""
    for name, (kind, detail) in types.fielddefs[type_name][1]:
        if detail in types.fielddefs:
            yield from _leaves(types, detail, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', (kind, detail)


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


def direction_of(axis: str | Sequence[float]) -> FloatArray:
    """Return the unit vector (3,) of an axis, as `rpms_ros.axis.unit_vector` reads it.

    Raises
    ------
    RecordingError
        If it is not a direction.
    """
    try:
        return np.array(unit_vector(axis))
    except ValueError as error:
        raise RecordingError(str(error)) from error


def force_along(
    direction: FloatArray, components: Sequence[FloatArray], sign: float
) -> FloatArray:
    """Return the force (samples,) [N] along a direction.

    Components across it do not count, not even when they are not finite.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector.
    components : three ndarrays, shape (samples,)
        Force along x, y and z [N].
    sign : float
        1 or -1: the muscle's pull is positive.
    """
    total: FloatArray | None = None
    for share, component in zip(direction.tolist(), components, strict=True):
        if share:
            part = (sign * share) * component
            total = part if total is None else total + part
    assert total is not None, 'a direction has a component'
    return total
