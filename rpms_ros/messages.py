# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where ROS messages become domain values and back: pulses and forces.

`schedule_messages` and `estimate_messages` do so for schedules and estimates.

Nothing of ROS is imported here.  Messages are read by their attributes, so rclpy's classes and
those of rosbags do alike; what is built is built from the classes that the caller brings.

Every number passes ``float``, ``int`` or ``bool`` on its way into a message: Jazzy's generated
classes do not check their fields by default and would send an int in a float64 as garbage.
"""

import struct
from collections.abc import Callable, Mapping
from typing import Any

from rpms_ros.axis import AXES as AXES, FORCE, TORQUE, Axis, along
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, Pulse

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
    return nanoseconds(message.header.stamp), float(along(axis, (force.x, force.y, force.z)))


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
    # no 0 * nan: a bad sample is bad along the axis only
    x, y, z = (share * float(force) if share else 0.0 for share in axis)
    vector = types[VECTOR]
    none = vector(x=0.0, y=0.0, z=0.0)
    wrench = types[WRENCH](**{FORCE: none, TORQUE: none, quantity: vector(x=x, y=y, z=z)})
    return types[WRENCH_STAMPED](header=header_message(stamp_ns, frame_id, types), wrench=wrench)
