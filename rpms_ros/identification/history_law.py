# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""History law: how earlier pulses of a train change the effect of later ones.

Pulse q is facilitated by the earlier ones, whose effect decays,

.. math:: p_q = 1 + a \sum_{j<q} e^{-(t_q - t_j) / \tau_p}

(potentiation and the doublet effect).  The weighted twitches add up to an activation
``x = sum_q p_q F^(t - t_q)`` (Eqs. 5, 6), and the force rises with it cooperatively at low
activation and saturates at high activation, ``S(x) = (1 + k^h) x^h / (k^h + x^h)``.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.pulses import FloatArray


@dataclass(frozen=True)
class HistoryLaw:
    """Parameters of the history law.

    Attributes
    ----------
    half_level : float
        k, activation at half the greatest force, in peaks of a single twitch.
    cooperation : float
        h, exponent.
    facilitation : float
        a, increase of the gain of the next pulse by one pulse.
    facilitation_decay : float
        tau_p [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    # what has to be above zero
    POSITIVE: ClassVar[tuple[str, ...]] = ('half_level', 'cooperation', 'facilitation_decay')

    half_level: float = 3.0
    cooperation: float = 1.5
    facilitation: float = 0.3
    facilitation_decay: float = 0.1

    def __post_init__(self) -> None:
        for name in self.POSITIVE:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise IdentificationError(f'expected a {name} above 0, got {value}')
        if not (math.isfinite(self.facilitation) and self.facilitation >= 0):
            raise IdentificationError(
                f'expected a facilitation of at least 0, got {self.facilitation}'
            )

    def saturated(self, activation: FloatArray) -> FloatArray:
        """Return S(x) of activations, 1 at 1 and 0 below 0."""
        power = np.maximum(activation, 0.0) ** self.cooperation
        level = self.half_level**self.cooperation
        force: FloatArray = (1.0 + level) * power / (level + power)
        return force
