# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions: those of ROS 2 Jazzy and of rpms_msgs, and those that a recording carries.

A recording may have been made with another version of a message.  What it carries counts; what
the package knows is for recordings that carry nothing, and for writing.

In plain CDR (XCDR version 1, as in every recording) a number is aligned to its own size, counted
from the end of the four bytes of encapsulation; a string is its length with the closing NUL (four
bytes), then its bytes.  A message of numbers and one string therefore has fixed places once the
length of that string is known, and records of one such length are an array of one NumPy type:
rosbags, which decodes one message after the other, takes minutes for an hour at 1 kHz.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from rpms_ros.errors import MISREAD, RecordingError

PULSE = 'rpms_msgs/msg/Pulse'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
WRENCH = 'geometry_msgs/msg/Wrench'
FLOAT64 = 'std_msgs/msg/Float64'

FOLDER = Path(__file__).parents[1] / 'msg'

# Ten times what the largest messages of ROS have.
_LONGEST = 500_000
_MOST_FIELDS = 10_000
_DEEPEST = 30
# What rosbags raises at texts that are no definitions.
_ERRORS = (TypesysError, *MISREAD)

Types = dict[str, tuple[Any, list[tuple[str, Any]]]]
"""Constants, and names and descriptions of fields, by type name: rosbags' `Typesdict`."""
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


def encoded(message: Any, type_name: str) -> bytes:
    """Return a message of rosbags as a recording has it; of arrays it takes those of NumPy."""
    for name, value in vars(message).items():
        if isinstance(value, array):
            setattr(message, name, np.array(value))
    return bytes(known_types().serialize_cdr(message, type_name))


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
        ``ros2msg``, as recorders write it; a definition in another one, such as ``ros2idl``, is
        not read, and a type that is known is taken as it is known.

    Raises
    ------
    RecordingError
        If the definition cannot be used, or is missing and the type is not known either.
    """
    if type_name in known_types().fielddefs and (not text or encoding != 'ros2msg'):
        return known_types()
    if not text:
        raise RecordingError(f'expected a definition of {type_name} in the recording, got none')
    store = get_typestore(Stores.EMPTY)
    try:
        if len(text) > _LONGEST:
            raise TypesysError(f'{len(text)} characters')
        if encoding != 'ros2msg':
            raise TypesysError(f'one in {encoding}')
        store.register(dict(get_types_from_msg(text, type_name)))
        fields_of(store, type_name)
    except _ERRORS as error:
        reason = str(error).splitlines() or [type(error).__name__]
        fault = f'expected a definition of {type_name} that can be used, got {reason[0]:.200}'
        raise RecordingError(fault) from error
    return store


ENCODING, LENGTH = 'CDR encoding', 'string length'
"""Names in a type of records: of its first two bytes, and of the length of its string [bytes]."""
_ENCAPSULATION = 4
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_INTEGERS = [f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)]
_NUMBERS = {'bool': 'uint8', 'byte': 'uint8', 'char': 'uint8'}
_NUMBERS |= {name: name for name in ('float32', 'float64', *_INTEGERS)}


@dataclass(frozen=True)
class Field:
    """One number, array of numbers or string of a message.

    Attributes
    ----------
    path : str
        Names from the top of the message, joined by dots.
    kind : str
        Type as rosbags names it.
    count : int
        How many; 0 where that is not fixed.
    """

    path: str
    kind: str
    count: int = 1

    @property
    def number(self) -> str | None:
        """NumPy's name of the type of a number, else None."""
        return _NUMBERS.get(self.kind)


def fields_of(types: Typestore, type_name: str) -> tuple[Field, ...]:
    """Return all fields of a message with those of its parts, in the order of transmission.

    Raises
    ------
    TypesysError
        If a part is missing or contains itself, or if they are more than any message has.
    """
    fields = tuple(islice(_flattened(types.fielddefs, type_name), _MOST_FIELDS + 1))
    if len(fields) > _MOST_FIELDS:
        raise TypesysError(f'more than {_MOST_FIELDS} fields')
    return fields


def _flattened(fielddefs: Types, type_name: str, depth: int = 0) -> Iterator[Field]:
    if type_name not in fielddefs:
        raise TypesysError(f'no {type_name} among {", ".join(fielddefs) or "no types"}')
    if depth > _DEEPEST:
        raise TypesysError(f'more than {_DEEPEST} levels')
    for path, (kind, detail) in fielddefs[type_name][1]:
        (element, name), count = ((kind, detail), 1) if kind in (_BASE, _NAME) else detail
        if element == _BASE:
            yield Field(path, name[0], 0 if kind == _SEQUENCE else count)
            continue
        for field in _flattened(fielddefs, name, depth + 1):
            yield Field(f'{path}.{field.path}', field.kind, field.count if kind == _NAME else 0)


def differs_from_known(type_name: str, types: Typestore) -> bool:
    """Tell whether a definition out of a recording contradicts the one that the package knows.

    One that ends earlier, or goes on with more fields, is of an older or newer version and tells
    the same.
    """
    if type_name not in known_types().fielddefs:
        return False
    both = fields_of(known_types(), type_name), fields_of(types, type_name)
    return any(here != there for here, there in zip(*both, strict=False))


def has_fixed_places(fields: Sequence[Field]) -> bool:
    """Tell whether the places of all fields follow from the length of at most one string."""
    strings = [field.count for field in fields if field.kind == 'string']
    paths = {field.path for field in fields}
    counted = all(0 < field.count <= _MOST_FIELDS for field in fields)
    known = all(field.number or field.kind == 'string' for field in fields)
    return strings in ([], [1]) and len(paths) == len(fields) and counted and known


@lru_cache(1000)
def record_type(
    fields: tuple[Field, ...], order: Literal['<', '>'], string_length: int
) -> np.dtype[Any]:
    """Return the type of whole records: the paths of the fields, `ENCODING` and `LENGTH`.

    Parameters
    ----------
    fields : tuple of Field
        Of a message whose fields have fixed places.
    order : str
        ``<`` or ``>``, the order of bytes.
    string_length : int
        Of its string, if it has one, with the closing NUL [bytes].
    """
    columns: list[Any] = []
    for field in fields:
        if field.number is None:
            columns += [(LENGTH, f'{order}u4'), (field.path, f'S{string_length}')]
        else:
            number = np.dtype(field.number).newbyteorder(order)
            columns.append((field.path, number, *([field.count] if field.count > 1 else [])))
    # Without the gap that NumPy leaves behind the last field.
    body: Any = np.dtype(columns, align=True)
    offsets = [_ENCAPSULATION + body.fields[name][1] for name in body.names]
    kinds = [body[name] for name in body.names]
    places: Any = {
        'names': [ENCODING, *body.names],
        'formats': ['>u2', *kinds],
        'offsets': [0, *offsets],
        'itemsize': offsets[-1] + kinds[-1].itemsize,
    }
    kind: np.dtype[Any] = np.dtype(places)
    return kind
