# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many CDR records at once, equal in every byte to what rosbags serialises one by one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.axis import FORCE
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording.definitions import PULSE
from rpms_ros.recording.definitions import WRENCH_STAMPED
from rpms_ros.recording.definitions import known_types
from rpms_ros.recording.layout import layout_of
from rpms_ros.recording.records import Records

_LITTLE_ENDIAN = (0, 1, 0, 0)
_LARGEST_SECOND = 2**31 - 1


def encode_pulses(pulses: PulseTrain, frame_id: str) -> Records:
    """Return one rpms_msgs/Pulse a pulse, received at its onset."""
    values = {
        'sequence': pulses.sequence,
        'intensity': pulses.intensity,
        'width': pulses.width,
    }
    return _encode(PULSE, pulses.onset_ns, frame_id, values)


def encode_forces(forces: ForceTrace, axis: FloatArray, quantity: str = FORCE) -> Records:
    """Return one geometry_msgs/WrenchStamped a sample, received at its stamp.

    Parameters
    ----------
    forces : ForceTrace
        Samples.
    axis : ndarray, shape (3,)
        Unit vector of the force in the frame of the sensor.
    quantity : str
        ``force``, or ``torque`` of a dynamometer, which is about the axis.
    """
    values = {
        f'wrench.{quantity}.{name}': forces.force * share
        for name, share in zip('xyz', axis.tolist(), strict=True)
        # Infinity times nothing is no number.
        if share
    }
    return _encode(WRENCH_STAMPED, forces.stamp_ns, forces.frame_id, values)


def _encode(
    type_name: str,
    stamp_ns: IntArray,
    frame_id: str,
    values: Mapping[str, npt.NDArray[Any]],
) -> Records:
    """Return records of a message with a header; fields that are not given are zero."""
    layout = layout_of(known_types(), type_name)
    assert layout is not None, f'{type_name} has no fixed layout'
    text = np.frombuffer(frame_id.encode() + b'\0', np.uint8)
    places = layout.places(len(text))
    rows = np.zeros((len(stamp_ns), places.end), np.uint8)
    rows[:, : len(_LITTLE_ENDIAN)] = _LITTLE_ENDIAN

    def put(path: str, value: npt.ArrayLike) -> None:
        kind = layout.kind(path).newbyteorder('<')
        begin = places.offset[path]
        column = np.ascontiguousarray(value, kind).view(np.uint8)
        rows[:, begin : begin + kind.itemsize] = column.reshape(len(rows), kind.itemsize)

    second, nanosecond = _split(stamp_ns)
    put('header.stamp.sec', second)
    put('header.stamp.nanosec', nanosecond)
    begin = places.offset['header.frame_id']
    rows[:, begin - 4 : begin] = np.frombuffer(np.array(len(text), '<u4').tobytes(), np.uint8)
    rows[:, begin : begin + len(text)] = text
    for path, value in values.items():
        put(path, value)
    start = np.arange(len(rows), dtype=np.int64) * places.end
    return Records(rows.reshape(-1), start, start + places.end, stamp_ns)


def _split(stamp_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Return seconds and nanoseconds, each (messages,), as builtin_interfaces/Time has them."""
    second, nanosecond = np.divmod(stamp_ns, NANOSECONDS_PER_SECOND)
    if len(second) and not (second.min() >= 0 and second.max() <= _LARGEST_SECOND):
        raise RecordingError(
            f'expected stamps from 0 to {_LARGEST_SECOND} s, '
            f'got {second.min()} to {second.max()} s'
        )
    return second, nanosecond
