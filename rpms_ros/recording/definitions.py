# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions: those of ROS 2 Jazzy and of rpms_msgs, and those that a recording carries.

A recording may have been made with another version of a message.  What it carries counts; what
the package knows is for recordings that carry nothing, and for writing.
"""

import re
from collections.abc import Callable
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores
from rosbags.typesys import TypesysError
from rosbags.typesys import get_types_from_idl
from rosbags.typesys import get_types_from_msg
from rosbags.typesys import get_typestore

from rpms_ros.errors import RecordingError

PULSE = 'rpms_msgs/msg/Pulse'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
WRENCH = 'geometry_msgs/msg/Wrench'
FLOAT64 = 'std_msgs/msg/Float64'
MUSCLE_ESTIMATE = 'rpms_msgs/msg/MuscleEstimate'

FOLDER = Path(__file__).parent / 'msg'
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
