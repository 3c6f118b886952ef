# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""What changes in a muscle while it is stimulated: fatigue, potentiation, scripted changes.

How they act on the force is said in `contraction`.

Fatigue has the form of Ding, Wexler and Binder-Macleod (J Electromyogr Kinesiol 13, 2003): the
scaling of the force and a time constant move away from their rested values in proportion to the
force, and return with one time constant,

.. math::
    \dot g = -\frac{g - 1}{\tau_{fat}} - a\,\frac{F}{F_{max}}, \qquad
    \dot s = -\frac{s - 1}{\tau_{fat}} + b\,\frac{F}{F_{max}}

with the steady force `g` and the time constant of the twitch `s` relative to the rested muscle.
Their value for human quadriceps is tau_fat = 127 s; their rates are per newton of that muscle, so
`a` and `b` are stated here per share of the subject's own maximum.

Potentiation is the growth of the twitch with the number of preceding pulses, which fades within
minutes (Rassier and MacIntosh, Braz J Med Biol Res 33, 2000): each pulse adds a share of the
difference to the largest potentiation, in proportion to its recruitment; it decays exponentially.
"""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION
from rpms_ros.pulses import FloatArray


@dataclass(frozen=True)
class Fatigue:
    """Fatigue and recovery; without effect by default.

    Attributes
    ----------
    force_loss : float
        `a`: loss of steady force while the muscle gives its maximum force [1/s].
    slowing : float
        `b`: growth of the time constant while the muscle gives its maximum force [1/s].
    recovery : float
        Time constant with which both return [s].
    lowest_gain : float
        The steady force never falls below this share of the rested one.

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    force_loss: float = 0.0
    slowing: float = 0.0
    recovery: float = 127.0
    lowest_gain: float = 0.05

    def __post_init__(self) -> None:
        for name in ('force_loss', 'slowing'):
            check_number(MuscleError, name, getattr(self, name), 0)
        check_number(MuscleError, 'recovery', self.recovery, 0, above=True, unit='s')
        check_number(MuscleError, 'lowest_gain', self.lowest_gain, 0, 1, above=True)


@dataclass(frozen=True)
class Potentiation:
    """Growth of the twitch with use; without effect by default.

    Attributes
    ----------
    largest : float
        Largest growth of the twitch, as a share of the rested one.
    per_pulse : float
        Share of the difference to `largest` that one pulse at full recruitment adds.
    decay : float
        Time constant with which it fades [s].

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    largest: float = 0.0
    per_pulse: float = 0.01
    decay: float = 180.0

    def __post_init__(self) -> None:
        check_number(MuscleError, 'largest', self.largest, 0)
        check_number(MuscleError, 'per_pulse', self.per_pulse, 0, 1)
        check_number(MuscleError, 'decay', self.decay, 0, above=True, unit='s')


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
            check_number(MuscleError, name, getattr(self, name), 0, unit='s')
        for name, least, most in (
            ('gain', 0.0, _LARGEST_GAIN),
            ('time_constant', 0.0, _LONGEST_S),
            ('latency', 0.0, _LONGEST_S),
            ('threshold', -1.0, 3.0),
            ('saturation', -1.0, 3.0),
        ):
            if (value := getattr(self, name)) is not None:
                check_number(MuscleError, name, value, least, most, above=name == 'time_constant')
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
        return np.interp(time, *self._knots[name])


def _require_apart(time: float, threshold: float, saturation: float) -> None:
    # differences of decimal numbers are rounded
    if not saturation - threshold > SMALLEST_SEPARATION - 1e-9:
        fault = f'expected a saturation at least {SMALLEST_SEPARATION} above the threshold'
        raise MuscleError(f'{fault}, got {saturation:g} and {threshold:g} at {time:g} s')


def _knots(name: str, start: float, changes: Sequence[Change]) -> tuple[FloatArray, FloatArray]:
    """Return times and values (knots,) of the piecewise linear course of the changes."""
    at, value = [0.0], [start]
    for change in changes:
        if (target := getattr(change, name)) is None:
            continue
        # a change that begins during the one before it replaces the rest of that one
        begin = change.at if change.over > 0.0 else change.at - _STEP_S
        here = float(np.interp(begin, at, value))
        kept = bisect.bisect_left(at, begin)
        at = [*at[:kept], begin, change.at + change.over]
        value = [*value[:kept], here, target]
    return np.array(at), np.array(value)


@dataclass(frozen=True)
class LivingSettings:
    """What changes in a muscle.

    Attributes
    ----------
    fatigue : Fatigue
        Changes caused by its force.
    potentiation : Potentiation
        Changes caused by the pulses.
    changes : tuple of Change
        Scripted changes.
    """

    fatigue: Fatigue = Fatigue()
    potentiation: Potentiation = Potentiation()
    changes: tuple[Change, ...] = ()
