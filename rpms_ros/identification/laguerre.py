# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Continuous Laguerre functions behind a latency: a basis with a finite-dimensional state.

With pole ``p = 1 / T_p`` and ``x = 2 p t`` the functions are
``phi_l(t) = sqrt(2 p) e^(-x/2) L_l(x)``, orthonormal on ``t >= 0``.  They are the impulse
responses of a chain of one low-pass and all-passes, so the sum over any number of past pulses
follows from n states ``z``.  Between pulses a lower triangular Toeplitz matrix advances them,

.. math:: z_l(t + d) = \sum_{k \le l} e_k(2 p d)\, z_{l-k}(t), \qquad
          e_k(x) = e^{-x/2} \left( L_k(x) - L_{k-1}(x) \right),

and a pulse adds ``sqrt(2 p)`` times its recruitment to each of them.  The response is not
truncated; a twitch needs as many functions as it has poles if ``T_p`` is its time constant.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import IdentificationError
from rpms_ros.pulses import FloatArray

MOST_FUNCTIONS = 16
# After so many T_p = 38 ms the twitch of the slowest muscle is below 0.2 % of its peak.
_MEMORY = 16.0


@numba.njit(cache=True)
def transition_generator(distance: float, values: FloatArray) -> None:
    """Write ``e_k(distance)`` into `values` (functions,); `distance` is 2 p t."""
    decay = math.exp(-0.5 * distance)
    before = 0.0
    current = 1.0
    values[0] = decay
    for index in range(1, len(values)):
        # k L_k = (2k - 1 - x) L_{k-1} - (k - 1) L_{k-2}
        after = ((2 * index - 1 - distance) * current - (index - 1) * before) / index
        values[index] = decay * (after - current)
        before, current = current, after


@numba.njit(cache=True)
def _evaluate_all(distance: FloatArray, values: FloatArray) -> None:
    """Write ``e^(-x/2) L_l(x)`` at distances (n,) into `values` (n, functions), zero before."""
    for index in range(len(distance)):
        if distance[index] >= 0.0:
            transition_generator(distance[index], values[index])
            for function in range(1, values.shape[1]):
                values[index, function] += values[index, function - 1]


@dataclass(frozen=True)
class LaguerreBasis:
    """Continuous Laguerre functions behind a latency.

    Attributes
    ----------
    functions : int
        Number of functions.
    time_constant : float
        T_p = 1 / p [s].
    latency : float
        Time from a pulse to the beginning of the functions [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    functions: int = 6
    time_constant: float = 38e-3
    latency: float = 0.0

    def __post_init__(self) -> None:
        if not 1 <= self.functions <= MOST_FUNCTIONS:
            raise IdentificationError(
                f'expected 1 to {MOST_FUNCTIONS} Laguerre functions, got {self.functions}'
            )
        if not (math.isfinite(self.time_constant) and self.time_constant > 0):
            raise IdentificationError(
                f'expected a time constant above 0 s, got {self.time_constant}'
            )
        if not (math.isfinite(self.latency) and self.latency >= 0):
            raise IdentificationError(f'expected a latency of at least 0 s, got {self.latency}')

    @property
    def input_gain(self) -> float:
        """Increase of each state by a pulse of recruitment 1, sqrt(2 p) [s^-1/2]."""
        return math.sqrt(2.0 / self.time_constant)

    @property
    def duration(self) -> float:
        """Lag up to which a pulse acts noticeably [s]."""
        return self.latency + _MEMORY * self.time_constant

    @cached_property
    def area(self) -> FloatArray:
        """Integral of each function, its transfer function at zero (functions,) [s^1/2]."""
        sign = np.where(np.arange(self.functions) % 2, -1.0, 1.0)
        total: FloatArray = self.input_gain * self.time_constant * sign
        return total

    @cached_property
    def moment(self) -> FloatArray:
        """Integral of each function times the lag (functions,) [s^(3/2)]."""
        mean = self.latency + self.time_constant * (2.0 * np.arange(self.functions) + 1.0)
        total: FloatArray = self.area * mean
        return total

    def evaluate(self, lag: npt.ArrayLike) -> FloatArray:
        """Return the functions.

        Parameters
        ----------
        lag : array_like, shape (lags,)
            Time after the onset of a pulse [s].

        Returns
        -------
        ndarray, shape (lags, functions)
            Zero up to the latency [s^-1/2].
        """
        since = np.atleast_1d(np.asarray(lag, dtype=np.float64)) - self.latency
        values = np.zeros((len(since), self.functions))
        _evaluate_all(2.0 / self.time_constant * since, values)
        return self.input_gain * values
