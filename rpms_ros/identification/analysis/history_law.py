# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force of a train by the history law (`rpms_ros.identification.history_law`), behind a lag.

Force is ``G S(x)`` through a series elasticity, a first-order lag tau_s.  A single twitch has the
peak G before the lag.  The linear sum of Eq. (6) is the limit a = 0, h = 1, k to infinity,
tau_s = 0.
"""

from dataclasses import dataclass

import numba
import numpy as np

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.train_model import pulse_twitches
from rpms_ros.identification.history_law import HistoryLaw
from rpms_ros.muscle import twitch
from rpms_ros.pulses import FloatArray


@dataclass(frozen=True)
class TrainLaw(HistoryLaw):
    """History law with a series lag.

    Attributes
    ----------
    series_lag : float
        tau_s [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    POSITIVE = (*HistoryLaw.POSITIVE, 'series_lag')

    series_lag: float = 0.01

    @classmethod
    def of_logarithms(cls, logarithms: FloatArray) -> 'TrainLaw':
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
        return _lagged(response.lag, self.saturated(activation), self.series_lag)

    def single(self, lag: FloatArray, order: int, latency: float, constant: float) -> FloatArray:
        """Return the force after a pulse without another before it, in units of G (samples,)."""
        return _lagged(
            lag, self.saturated(twitch(lag - latency, constant, order)), self.series_lag
        )


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
