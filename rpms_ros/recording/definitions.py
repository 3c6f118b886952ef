"""Message definitions: those of ROS 2 Jazzy and of rpms_msgs, and those that a recording carries.

A recording may have been made with another version of a message.  What it carries counts; what
the package knows is for recordings that carry nothing, and for writing.
"""

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
        If the definition cannot be parsed, or is missing and the type is not known either.
    """
    if not text:
        if type_name not in known_types().fielddefs:
            raise RecordingError(
                f'expected a definition of {type_name} in the recording, got none'
            )
        return known_types()
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(_parse(type_name, text, encoding))
    except TypesysError as error:
        raise RecordingError(
            f'expected a definition of {type_name} that can be parsed, got {error}'
        ) from error
    if type_name not in store.fielddefs:
        raise RecordingError(
            f'expected a definition of {type_name}, got one of {", ".join(store.fielddefs)}'
        )
    return store


def _parse(type_name: str, text: str, encoding: str) -> Types:
    if encoding == 'ros2msg':
        return dict(get_types_from_msg(text, type_name))
    types: Types = {}
    parts = text.split(_IDL_SEPARATOR)[1:] if text.startswith(_IDL_SEPARATOR) else [text]
    for part in parts:
        body = part.split('\n', 1)[1] if part.startswith('IDL: ') else part
        types.update(get_types_from_idl(body))
    return types


def differs_from_known(type_name: str, types: Typestore) -> bool:
    """Tell whether a definition out of a recording is not the one that the package knows."""
    known = known_types()
    return type_name in known.fielddefs and (
        known.hash_rihs01(type_name) != types.hash_rihs01(type_name)
    )
