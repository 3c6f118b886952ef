# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scripted changes of a simulated muscle: the coil moves, the gain changes."""

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import fields

import numpy as np

from rpms_ros.errors import MuscleError
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION
from rpms_ros.pulses import FloatArray

# Distance of the two knots of a step, shorter than any sampling period [s].
_STEP_S = 1e-9
# No muscle becomes stronger or slower than that; a number beyond has the wrong unit.
_LARGEST_GAIN, _LONGEST_S = 100.0, 1.0


@dataclass(frozen=True)
class Change:
    """A change of the muscle from a time on; a field that is None does not change.

    Attributes
    ----------
    at : float
        When it begins, from the start of the session [s].
    over : float
        Duration of the linear transition [s]; 0 for a step.
    gain : float or None
        Factor on the steady force afterwards, relative to the unchanged subject.
    time_constant : float or None
        T_a [s].
    latency : float or None
        From the pulse to the onset of its twitch [s].
    threshold, saturation : float or None
        u_thr and u_sat of the recruitment curve; a coil that moves changes these two.

    Raises
    ------
    MuscleError
        If a value is not possible, or nothing changes.
    """

    at: float
    over: float = 0.0
    gain: float | None = None
    time_constant: float | None = None
    latency: float | None = None
    threshold: float | None = None
    saturation: float | None = None

    def __post_init__(self) -> None:
        for name in ('at', 'over'):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise MuscleError(f'expected a finite {name} of at least 0, got {value}')
        for name, most in (('gain', _LARGEST_GAIN), ('latency', _LONGEST_S)):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= most:
                raise MuscleError(f'expected a {name} from 0 to {most:g}, got {value}')
        if self.time_constant is not None and not 0.0 < self.time_constant <= _LONGEST_S:
            raise MuscleError(
                f'expected a time_constant above 0 s, at most {_LONGEST_S:g} s, '
                f'got {self.time_constant}'
            )
        for name in ('threshold', 'saturation'):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and -1.0 <= value <= 3.0):
                raise MuscleError(f'expected a {name} from -1 to 3, got {value}')
        if self.threshold is not None and self.saturation is not None:
            _require_apart(self.at + self.over, self.threshold, self.saturation)
        if all(getattr(self, name) is None for name in CHANGEABLE):
            raise MuscleError(f'expected a change of {", ".join(CHANGEABLE)}, got none')


CHANGEABLE = tuple(field.name for field in fields(Change) if field.name not in ('at', 'over'))
"""Names of what a `Change` can change."""


class Timeline:
    """Values over time; each change starts from the value reached so far.

    Parameters
    ----------
    start : dict of str to float
        Values of `CHANGEABLE` before any change.
    changes : sequence of Change
        In any order.

    Raises
    ------
    MuscleError
        If threshold and saturation come too close to each other: beyond each other the muscle
        would push.
    """

    def __init__(self, start: dict[str, float], changes: Sequence[Change] = ()) -> None:
        ordered = sorted(changes, key=lambda change: change.at)
        self._knots = {name: _knots(name, start[name], ordered) for name in CHANGEABLE}
        self._check_recruitment(start)

    def _check_recruitment(self, start: dict[str, float]) -> None:
        names = ('threshold', 'saturation')
        # both are linear from knot to knot, and so is their distance
        knots = np.unique(np.concatenate([self._knots[name][0] for name in names]))
        values = (self(name, knots).tolist() for name in names)
        for time, *pair in zip(knots.tolist(), *values, strict=True):
            # a subject of one's own is taken as it is
            if pair != [start[name] for name in names]:
                _require_apart(time, *pair)

    def __call__(self, name: str, time: FloatArray) -> FloatArray:
        """Return the values of `name` at times from the start (...) [s], same shape."""
        at, value = self._knots[name]
        return np.interp(time, at, value)


def _require_apart(time: float, threshold: float, saturation: float) -> None:
    # differences of decimal numbers are rounded
    if not saturation - threshold > SMALLEST_SEPARATION - 1e-9:
        raise MuscleError(
            f'expected a saturation at least {SMALLEST_SEPARATION} above the threshold, '
            f'got {saturation:g} and {threshold:g} at {time:g} s'
        )


def _knots(name: str, start: float, changes: Sequence[Change]) -> tuple[FloatArray, FloatArray]:
    """Return times and values (knots,) of the piecewise linear course of the changes."""
    at, value = [0.0], [start]
    for change in changes:
        target = getattr(change, name)
        if target is None:
            continue
        # a change that begins during the one before it replaces the rest of that one
        begin = change.at if change.over > 0.0 else change.at - _STEP_S
        here = float(np.interp(begin, at, value))
        kept = bisect.bisect_left(at, begin)
        at = [*at[:kept], begin, change.at + change.over]
        value = [*value[:kept], here, target]
    return np.array(at), np.array(value)
