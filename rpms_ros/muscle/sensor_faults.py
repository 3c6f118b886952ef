# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a force sensor: frozen, clipped, scaled, samples that are lost or sent twice."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray

FROZEN, CLIPPED, SCALED, OFFSET = 'frozen', 'clipped', 'scaled', 'offset'
LOST, DOUBLED = 'lost', 'doubled'
NEED_VALUE = (CLIPPED, SCALED, OFFSET)
KINDS = (FROZEN, CLIPPED, SCALED, OFFSET, LOST, DOUBLED)


@dataclass(frozen=True)
class SensorFault:
    """A fault of a sensor, for a limited time.

    Attributes
    ----------
    fault : str
        ``frozen`` repeats the last value, ``clipped`` cuts at `value` [N], ``scaled`` multiplies
        by `value`, ``offset`` adds `value` [N], ``lost`` leaves samples out, ``doubled`` sends
        each sample twice.
    at : float
        Beginning, from the start of the session [s].
    duration : float
        Length [s].
    value : float
        See `fault`, not 0; not used by the other faults.

    Raises
    ------
    MuscleError
        If the fault is unknown or a number is not possible.
    """

    fault: str
    at: float
    duration: float
    value: float = 0.0

    def __post_init__(self) -> None:
        if self.fault not in KINDS:
            raise MuscleError(f'expected a fault of {", ".join(KINDS)}, got {self.fault!r}')
        if not 0.0 <= self.at < math.inf:
            raise MuscleError(f'expected a finite at of at least 0 s, got {self.at}')
        if not 0.0 < self.duration < math.inf:
            raise MuscleError(f'expected a finite duration above 0 s, got {self.duration}')
        if not math.isfinite(self.value):
            raise MuscleError(f'expected a finite value, got {self.value}')
        if self.fault in NEED_VALUE and self.value == 0.0:
            raise MuscleError(f'expected a value for a {self.fault} sensor, got 0')


class FaultySensor:
    """Applies sensor faults to samples, in blocks of any length.

    Parameters
    ----------
    faults : sequence of SensorFault
        Applied one after another.
    start_ns : int
        Start of the session [ns].
    """

    def __init__(self, faults: Sequence[SensorFault], start_ns: int) -> None:
        self._faults = tuple(faults)
        self._start_ns = start_ns
        # value that each frozen sensor repeats
        self._last: dict[SensorFault, float] = {}

    def __call__(self, stamp_ns: IntArray, force: FloatArray) -> ForceTrace:
        """Return the samples that leave the sensor; stamps ascend [ns], force in [N]."""
        time = (stamp_ns - self._start_ns) / NANOSECONDS_PER_SECOND
        shown = force.copy()
        copies = np.ones(len(stamp_ns), dtype=np.int64)
        for fault in self._faults:
            during = (time >= fault.at) & (time < fault.at + fault.duration)
            self._apply(fault, shown, during)
            if fault.fault == LOST:
                copies[during] = 0
            elif fault.fault == DOUBLED:
                copies[during] *= 2
        return ForceTrace(np.repeat(stamp_ns, copies), np.repeat(shown, copies))

    def _apply(self, fault: SensorFault, shown: FloatArray, during: npt.NDArray[np.bool_]) -> None:
        """Change the shown force (samples,) in place where the fault holds."""
        if fault.fault == SCALED:
            shown[during] *= fault.value
        elif fault.fault == OFFSET:
            shown[during] += fault.value
        elif fault.fault == CLIPPED:
            shown[during] = np.clip(shown[during], -abs(fault.value), abs(fault.value))
        elif fault.fault == FROZEN and len(shown):
            first = int(np.argmax(during)) if during.any() else 0
            before = shown[first - 1] if first else self._last.get(fault, shown[0])
            shown[during] = before
            self._last[fault] = float(shown[-1])
