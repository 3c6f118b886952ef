# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""History law: how earlier pulses of a train change the effect of later ones.

Pulse q is facilitated by the earlier ones, whose effect decays,

.. math:: p_q = 1 + a \sum_{j<q} e^{-(t_q - t_j) / \tau_p}

(potentiation and the doublet effect).  The weighted twitches add up to an activation
``x = sum_q p_q F^(t - t_q)`` (Eqs. 5, 6), and the force rises with it cooperatively at low
activation and saturates at high activation,

.. math:: F = G \, \frac{(1 + k^h) x^h}{k^h + x^h}

through a series elasticity, a first-order lag tau_s.  A single twitch has the peak G before the
lag.  The linear sum of Eq. (6) is the limit a = 0, h = 1, k to infinity, tau_s = 0.
"""

from dataclasses import dataclass

import numba
import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.train_model import pulse_twitches
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
    series_lag : float
        tau_s [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    half_level: float = 3.0
    cooperation: float = 1.5
    facilitation: float = 0.3
    facilitation_decay: float = 0.1
    series_lag: float = 0.01

    def __post_init__(self) -> None:
        for name in ('half_level', 'cooperation', 'facilitation_decay', 'series_lag'):
            if not getattr(self, name) > 0:
                raise IdentificationError(f'expected a {name} above 0, got {getattr(self, name)}')
        if not self.facilitation >= 0:
            raise IdentificationError(
                f'expected a facilitation of at least 0, got {self.facilitation}'
            )

    @classmethod
    def of_logarithms(cls, logarithms: FloatArray) -> 'HistoryLaw':
        """Return the law from the logarithms (5,) of its parameters, in the order of fields."""
        return cls(*(float(value) for value in np.exp(logarithms)))

    @property
    def logarithms(self) -> FloatArray:
        """Logarithms (5,) of the parameters, in the order of the fields."""
        values = [
            self.half_level,
            self.cooperation,
            max(self.facilitation, 1e-6),
            self.facilitation_decay,
            self.series_lag,
        ]
        return np.log(values)

    def gains(self, onset: FloatArray) -> FloatArray:
        """Return p of pulses at ascending onsets (pulses,) [s]."""
        decay = np.exp(-np.diff(onset) / self.facilitation_decay)
        left = np.zeros(len(onset))
        for index, share in enumerate(decay):
            left[index + 1] = (left[index] + 1.0) * share
        return 1.0 + self.facilitation * left

    def force(self, response: Response, order: int, latency: float, constant: float) -> FloatArray:
        """Return the force of a train in units of G, shape (samples,)."""
        columns = pulse_twitches(response, order, latency, constant)
        activation = columns @ self.gains(response.onset)
        power = np.maximum(activation, 1e-9) ** self.cooperation
        level = self.half_level**self.cooperation
        saturated = (1.0 + level) * power / (level + power)
        return _lagged(response.lag, saturated, self.series_lag)


@numba.njit(cache=True)
def _lagged(time: FloatArray, force: FloatArray, constant: float) -> FloatArray:
    """Return the force behind a first-order lag, exact for a force linear between samples."""
    result = np.empty_like(force)
    result[0] = force[0]
    for k in range(1, len(force)):
        step = (time[k] - time[k - 1]) / constant
        decay = np.exp(-step)
        mean = (1.0 - decay) / step
        result[k] = decay * result[k - 1] + (mean - decay) * force[k - 1] + (1.0 - mean) * force[k]
    return result
