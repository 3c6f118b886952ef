# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates, and the truth about a simulated muscle, as ROS messages and back.

As `rpms_ros.messages`, but with what identification is made of: a driver does not load it.
"""

import math
from array import array
from typing import Any, get_type_hints

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MessageError
from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.messages import (
    MUSCLE_ESTIMATE,
    MUSCLE_TRUTH,
    MessageTypes,
    header_message,
    nanoseconds,
)
from rpms_ros.muscle.contraction import MuscleState
from rpms_ros.muscle.simulation import Truth
from rpms_ros.pulses import FloatArray


def _fields_of(kind: Any, *apart: str) -> tuple[str, ...]:
    """Return the fields of an estimate of one type, but for those that are converted apart."""
    hints = get_type_hints(Estimate)
    return tuple(name for name, hint in hints.items() if hint == kind and name not in apart)


# Fields of MuscleEstimate are called as those of Estimate: a new one of these types needs no line.
_NUMBERS = _fields_of(float)
_COUNTS = _fields_of(int, 'stamp_ns')
_NAMES = _fields_of(tuple[str, ...])
_ARRAYS = _fields_of(FloatArray, 'nonlinear_covariance')
_CURVES = [name for name in _ARRAYS if name.startswith('curve_')]
_RESPONSES = [name for name in _ARRAYS if name.startswith('response_')]
_PHYSIOLOGY = [name for name in _ARRAYS if name.startswith('physiology')]
# Arrays as long as the one that names their elements.
_EXACT = {
    'nonlinear': 'nonlinear_names',
    'linear': 'linear_names',
    'fault_counts': 'fault_names',
    'response_force': 'response_time',
    'physiology': 'physiology_names',
    'change_ago': 'change_kinds',
}
# The same, but they may also be empty.
_OR_EMPTY = {
    'nonlinear_identifiability': 'nonlinear_names',
    **dict.fromkeys(_CURVES[1:], 'curve_intensity'),
    **dict.fromkeys(_RESPONSES[2:], 'response_time'),
    **dict.fromkeys(_PHYSIOLOGY[1:], 'physiology_names'),
    **dict.fromkeys((name for name in _ARRAYS if name.startswith('rate')), 'rate_names'),
}


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
    return Truth(
        stamp_ns=nanoseconds(message.header.stamp),
        state=MuscleState(*(float(getattr(message, name)) for name in MuscleState._fields)),
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
        nonlinear_identifiability=np.array(
            getattr(message, 'nonlinear_identifiability', ()), dtype=np.int64
        ),
        faults=dict(zip(names, counts, strict=True)),
        unit=str(getattr(message, 'unit', '') or 'N'),
        **fields,
    )


def _require_lengths(message: Any) -> None:
    """Raise MessageError unless each array is as long as the one that names its elements."""
    covariance = {'nonlinear_covariance': 'nonlinear_names'}
    for name, other in (covariance | _EXACT | _OR_EMPTY).items():
        # one that is younger than the recording is not there
        got, length = (len(getattr(message, one, ())) for one in (name, other))
        length **= 2 if name in covariance else 1
        if got != length and not (got == 0 and name not in _EXACT):
            raise MessageError(f'expected {length} elements in {name}, got {got}')


def _doubles(values: npt.ArrayLike) -> 'array[float]':
    return array('d', np.ascontiguousarray(values, dtype=np.float64).tobytes())


def _array(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64)
