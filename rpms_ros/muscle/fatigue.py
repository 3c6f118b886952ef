# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Effects of use on a muscle: fatigue, recovery and potentiation.

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

from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import MuscleError


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
            _require_rate(name, getattr(self, name))
        _require_duration('recovery', self.recovery)
        if not 0.0 < self.lowest_gain <= 1.0:
            raise MuscleError(f'expected a lowest_gain above 0 up to 1, got {self.lowest_gain}')


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
        _require_rate('largest', self.largest)
        if not 0.0 <= self.per_pulse <= 1.0:
            raise MuscleError(f'expected a per_pulse from 0 to 1, got {self.per_pulse}')
        _require_duration('decay', self.decay)


def _require_rate(name: str, value: float) -> None:
    if not (np.isfinite(value) and value >= 0.0):
        raise MuscleError(f'expected a finite {name} of at least 0, got {value}')


def _require_duration(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise MuscleError(f'expected a finite {name} above 0 s, got {value}')
