# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where ROS messages become domain values and back; `schedule_messages` does so for schedules.

Nothing of ROS is imported here.  Messages are read by their attributes, so rclpy's classes and
those of rosbags do alike; what is built is built from the classes that the caller brings.

Every number passes ``float``, ``int`` or ``bool`` on its way into a message: Jazzy's generated
classes do not check their fields by default and would send an int in a float64 as garbage.
"""

import math
import struct
from array import array
from collections.abc import Callable
from collections.abc import Mapping
from typing import Any
from typing import get_type_hints

import numpy as np
import numpy.typing as npt

from rpms_ros.axis import AXES as AXES
from rpms_ros.axis import FORCE
from rpms_ros.axis import TORQUE
from rpms_ros.axis import Axis
from rpms_ros.axis import unit_vector
from rpms_ros.errors import MessageError
from rpms_ros.identification.estimate import Estimate
from rpms_ros.muscle.state import MuscleState
from rpms_ros.muscle.truth import Truth
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import Pulse

MessageTypes = Mapping[str, Callable[..., Any]]
"""Message classes by name, such as ``std_msgs/msg/Header``; they take their fields by keyword."""

TIME = 'builtin_interfaces/msg/Time'
HEADER = 'std_msgs/msg/Header'
VECTOR = 'geometry_msgs/msg/Vector3'
WRENCH = 'geometry_msgs/msg/Wrench'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
PULSE = 'rpms_msgs/msg/Pulse'
MUSCLE_ESTIMATE = 'rpms_msgs/msg/MuscleEstimate'
MUSCLE_TRUTH = 'rpms_msgs/msg/MuscleTruth'


def _fields_of(kind: Any, *apart: str) -> tuple[str, ...]:
    """Return the fields of an estimate of one type, but for those that are converted apart."""
    hints = get_type_hints(Estimate)
    return tuple(name for name, hint in hints.items() if hint == kind and name not in apart)


# Fields of MuscleEstimate are called as those of Estimate: a new one of these types needs no line.
_NUMBERS = _fields_of(float)
_COUNTS = _fields_of(int, 'stamp_ns')
_NAMES = _fields_of(tuple[str, ...])
_ARRAYS = _fields_of(FloatArray, 'nonlinear_covariance')
_CURVES = tuple(name for name in _ARRAYS if name.startswith('curve_'))
_RESPONSES = tuple(name for name in _ARRAYS if name.startswith('response_'))
_PHYSIOLOGY = tuple(name for name in _ARRAYS if name.startswith('physiology'))

_RATES = tuple(name for name in _ARRAYS if name.startswith('rate'))
# Arrays that older recordings do not have.
_YOUNGER = (*_RATES, 'change_ago')


def axis_of(text: str) -> Axis:
    """Return the unit vector of ``x``, ``-z`` or ``0.6,0,0.8``.

    Raises
    ------
    MessageError
        If it is no direction.
    """
    try:
        return unit_vector(text)
    except ValueError as error:
        raise MessageError(str(error)) from error


def nanoseconds(stamp: Any) -> int:
    """Return a builtin_interfaces/Time in nanoseconds."""
    return int(stamp.sec) * NANOSECONDS_PER_SECOND + int(stamp.nanosec)


def stamp_of_bytes(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header.

    Behind four bytes of encapsulation, whose second names the byte order (odd: little-endian),
    come seconds and nanoseconds.
    """
    seconds, rest = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    return int(seconds) * NANOSECONDS_PER_SECOND + int(rest)


def time_message(stamp_ns: int, types: MessageTypes) -> Any:
    """Return a builtin_interfaces/Time of integer nanoseconds."""
    seconds, rest = divmod(int(stamp_ns), NANOSECONDS_PER_SECOND)
    return types[TIME](sec=seconds, nanosec=rest)


def header_message(stamp_ns: int, frame_id: str, types: MessageTypes) -> Any:
    """Return a std_msgs/Header."""
    return types[HEADER](stamp=time_message(stamp_ns, types), frame_id=frame_id)


def pulse_of(message: Any) -> Pulse:
    """Return the pulse in an rpms_msgs/Pulse, as it is: whether it makes sense is not asked."""
    return Pulse(
        nanoseconds(message.header.stamp),
        float(message.intensity),
        int(message.sequence),
        float(message.width),
        # older recordings do not have it
        int(getattr(message, 'unverified', 0)),
    )


def pulse_message(pulse: Pulse, types: MessageTypes, frame_id: str = '') -> Any:
    """Return an rpms_msgs/Pulse; the sequence wraps at 2^32."""
    return types[PULSE](
        header=header_message(pulse.onset_ns, frame_id, types),
        sequence=int(pulse.sequence) % 2**32,
        intensity=float(pulse.intensity),
        width=float(pulse.width),
        unverified=int(pulse.unverified),
    )


def force_of(message: Any, axis: Axis, quantity: str = FORCE) -> tuple[int, float]:
    """Return stamp [ns] and force along `axis` [N] of a geometry_msgs/WrenchStamped.

    Of a sensor of `TORQUE` it is the torque about the axis [N m].  Components across the axis are
    not looked at, so that NaN there does no harm.
    """
    force = getattr(message.wrench, quantity)
    return nanoseconds(message.header.stamp), _along(axis, (force.x, force.y, force.z))


def _along(axis: Axis, vector: tuple[float, float, float]) -> float:
    parts = [share * component for share, component in zip(axis, vector, strict=True) if share]
    total = parts[0]
    for part in parts[1:]:
        total += part
    return float(total)


def force_message(
    stamp_ns: int,
    force: float,
    axis: Axis,
    types: MessageTypes,
    frame_id: str = '',
    quantity: str = FORCE,
) -> Any:
    """Return a geometry_msgs/WrenchStamped with `force` [N] along `axis` and no torque.

    If `quantity` is `TORQUE` it is a torque [N m] about the axis, and there is no force.
    """
    along = float(force)
    # no 0 * nan: a bad sample is bad along the axis only
    x, y, z = (share * along if share else 0.0 for share in axis)
    vector = types[VECTOR]
    none = vector(x=0.0, y=0.0, z=0.0)
    parts = {FORCE: none, TORQUE: none, quantity: vector(x=x, y=y, z=z)}
    wrench = types[WRENCH](**parts)
    return types[WRENCH_STAMPED](header=header_message(stamp_ns, frame_id, types), wrench=wrench)


def estimate_message(estimate: Estimate, types: MessageTypes, frame_id: str = '') -> Any:
    """Return an rpms_msgs/MuscleEstimate."""
    fields: dict[str, Any] = {name: float(getattr(estimate, name)) for name in _NUMBERS}
    fields |= {name: int(getattr(estimate, name)) for name in _COUNTS}
    fields |= {name: [str(item) for item in getattr(estimate, name)] for name in _NAMES}
    fields |= {name: _doubles(getattr(estimate, name)) for name in _ARRAYS}
    return types[MUSCLE_ESTIMATE](
        header=header_message(estimate.stamp_ns, frame_id, types),
        estimator=str(estimate.estimator),
        nonlinear_covariance=_doubles(estimate.nonlinear_covariance),
        nonlinear_identifiability=array('B', estimate.nonlinear_identifiability.tolist()),
        fault_names=[str(name) for name in estimate.faults],
        fault_counts=array('Q', [int(count) for count in estimate.faults.values()]),
        unit=str(estimate.unit),
        **fields,
    )


def truth_message(truth: Truth, types: MessageTypes, frame_id: str = '') -> Any:
    """Return an rpms_msgs/MuscleTruth."""
    return types[MUSCLE_TRUTH](
        header=header_message(truth.stamp_ns, frame_id, types),
        effort=float(truth.effort),
        repetition_rate=float(truth.repetition_rate),
        curve_intensity=_doubles(truth.curve_intensity),
        curve_force=_doubles(truth.curve_force),
        **{name: float(value) for name, value in truth.state._asdict().items()},
    )


def truth_of(message: Any) -> Truth:
    """Return what an rpms_msgs/MuscleTruth says.

    Raises
    ------
    MessageError
        If the arrays of the curve differ in length.
    """
    intensity, force = _array(message.curve_intensity), _array(message.curve_force)
    if len(intensity) != len(force):
        raise MessageError(f'expected {len(intensity)} elements in curve_force, got {len(force)}')
    state = MuscleState(*(float(getattr(message, name)) for name in MuscleState._fields))
    return Truth(
        stamp_ns=nanoseconds(message.header.stamp),
        state=state,
        repetition_rate=float(message.repetition_rate),
        curve_intensity=intensity,
        curve_force=force,
        effort=float(message.effort),
    )


def estimate_of(message: Any) -> Estimate:
    """Return the estimate in an rpms_msgs/MuscleEstimate.

    Raises
    ------
    MessageError
        If arrays that belong together differ in length.
    """
    names, counts = list(message.fault_names), [int(count) for count in message.fault_counts]
    _require_lengths(message)
    # A field that is younger than the recording is empty.
    fields: dict[str, Any] = {name: float(getattr(message, name, 0.0)) for name in _NUMBERS}
    fields |= {name: int(getattr(message, name, 0)) for name in _COUNTS}
    fields |= {name: tuple(getattr(message, name, ())) for name in _NAMES}
    fields |= {name: _array(getattr(message, name, ())) for name in _ARRAYS}
    covariance = _array(message.nonlinear_covariance)
    size = math.isqrt(len(covariance))
    return Estimate(
        stamp_ns=nanoseconds(message.header.stamp),
        estimator=str(message.estimator),
        nonlinear_covariance=covariance.reshape(size, size),
        nonlinear_identifiability=np.array(_identifiability(message), dtype=np.int64),
        faults=dict(zip(names, counts, strict=True)),
        unit=str(getattr(message, 'unit', '') or 'N'),
        **fields,
    )


def _require_lengths(message: Any) -> None:
    """Raise MessageError unless each array is as long as the one that names its elements."""
    parameters = len(message.nonlinear_names)
    exact = {
        'nonlinear': parameters,
        'linear': len(message.linear_names),
        'fault_counts': len(message.fault_names),
        'response_force': len(message.response_time),
        'physiology': len(message.physiology_names),
    }
    optional = {
        'nonlinear_covariance': parameters**2,
        'nonlinear_identifiability': parameters,
        **dict.fromkeys(_CURVES[1:], len(message.curve_intensity)),
        **dict.fromkeys(_RESPONSES[2:], len(message.response_time)),
        **dict.fromkeys(_PHYSIOLOGY[1:], len(message.physiology_names)),
    }
    younger = {
        'nonlinear_identifiability': len(_identifiability(message)),
        **{name: len(getattr(message, name, ())) for name in _YOUNGER},
    }
    exact |= {'change_ago': len(getattr(message, 'change_kinds', ()))}
    optional |= dict.fromkeys(_RATES, len(getattr(message, 'rate_names', ())))
    for name, length in (exact | optional).items():
        got = younger[name] if name in younger else len(getattr(message, name))
        if got != length and not (name in optional and got == 0):
            raise MessageError(f'expected {length} elements in {name}, got {got}')


def _identifiability(message: Any) -> Any:
    """Return the flags of the parameters, which had another name in older recordings."""
    older = getattr(message, 'nonlinear_excitation', ())
    return getattr(message, 'nonlinear_identifiability', older)


def _doubles(values: npt.ArrayLike) -> 'array[float]':
    return array('d', np.ascontiguousarray(values, dtype=np.float64).tobytes())


def _array(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64)
