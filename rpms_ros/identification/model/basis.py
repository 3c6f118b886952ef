# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Orthonormal basis functions of the impulse response, Eqs. (14) and (31).

**Continuous Laguerre functions** behind a latency have a finite-dimensional state. With pole
``p = 1 / T_p`` and ``x = 2 p t`` the functions are ``phi_l(t) = sqrt(2 p) e^(-x/2) L_l(x)``,
orthonormal on ``t >= 0``. They are the impulse responses of a chain of one low-pass and
all-passes, so the sum over any number of past pulses follows from n states ``z``. Between
pulses a lower triangular Toeplitz matrix advances them,

.. math:: z_l(t + d) = \sum_{k \le l} e_k(2 p d)\, z_{l-k}(t), \qquad
          e_k(x) = e^{-x/2} \left( L_k(x) - L_{k-1}(x) \right),

and a pulse adds ``sqrt(2 p)`` times its recruitment to each of them.  The response is not
truncated; a twitch needs as many functions as it has poles if ``T_p`` is its time constant.

**The paper's distorted sines**, for taps ``i = 1 .. m`` of ``T_s`` seconds each,

.. math:: \tilde r_l(i) = \sqrt{2/m}\,\sin\!\left(l \pi (1 - e^{-(i - 0.5)/\eta})\right)

are continuous in ``i``, so they are evaluated at the true lag ``i = lag / T_s`` of every
pulse: pulses and samples need no common grid. They are zero at ``i = 0.5``, where their
support begins; it ends at ``m + 0.5``, so that a grid of any phase has exactly m taps in it.

``R = (C^T)^{-1} R~`` with ``C^T C = R~ R~^T`` makes them orthonormal on the taps. The sum over
pulses is linear, so the raw functions are summed and the triangular factor is applied once.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.pulses import FloatArray

MOST_FUNCTIONS = 16
# After so many T_p = 38 ms the twitch of the slowest muscle is below 0.2 % of its peak.
_MEMORY = 16.0
# A division takes several times as long as a product.
_INVERSE: FloatArray = 1.0 / np.arange(1.0, MOST_FUNCTIONS + 1.0)


@numba.njit(cache=True)
def transition_generator(distance: float, values: FloatArray) -> None:
    """Write ``e_k(distance)`` into `values` (functions,); `distance` is 2 p t."""
    decay = math.exp(-0.5 * distance)
    before = 0.0
    current = 1.0
    values[0] = decay
    for index in range(1, len(values)):
        # k L_k = (2k - 1 - x) L_{k-1} - (k - 1) L_{k-2}
        after = ((2 * index - 1 - distance) * current - (index - 1) * before) * _INVERSE[index - 1]
        values[index] = decay * (after - current)
        before, current = current, after


@numba.njit(cache=True)
def _laguerre_values(distance: FloatArray, values: FloatArray) -> None:
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
        refused = IdentificationError
        check_number(refused, 'number of Laguerre functions', self.functions, 1, MOST_FUNCTIONS)
        check_number(refused, 'time constant', self.time_constant, 0, above=True, unit='s')
        check_number(refused, 'latency', self.latency, 0, unit='s')

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
        return self.input_gain * self.time_constant * sign

    @cached_property
    def moment(self) -> FloatArray:
        """Integral of each function times the lag (functions,) [s^(3/2)]."""
        mean = self.latency + self.time_constant * (2.0 * np.arange(self.functions) + 1.0)
        return self.area * mean

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
        _laguerre_values(2.0 / self.time_constant * since, values)
        return self.input_gain * values


@numba.njit(cache=True)
def distorted_sines(tap: float, memory: float, form_factor: float, values: FloatArray) -> bool:
    """Write the raw functions at a tap (any real number) into `values` (functions,).

    Returns False, and writes nothing, outside the support.
    """
    if tap <= 0.5 or tap > memory + 0.5:
        return False
    angle = math.pi * (1.0 - math.exp(-(tap - 0.5) / form_factor))
    scale = math.sqrt(2.0 / memory)
    # sin(l x) by the recurrence sin((l+1) x) = 2 cos(x) sin(l x) - sin((l-1) x): one sine for all
    twice_cosine = 2.0 * math.cos(angle)
    before = 0.0
    current = math.sin(angle)
    for index in range(len(values)):
        values[index] = scale * current
        before, current = current, twice_cosine * current - before
    return True


@numba.njit(cache=True)
def _evaluate_all(taps: FloatArray, memory: float, form_factor: float, values: FloatArray) -> None:
    """Write the raw functions at taps (n,) into `values` (n, functions), zero beforehand."""
    for index in range(len(taps)):
        distorted_sines(taps[index], memory, form_factor, values[index])


@dataclass(frozen=True)
class DistortedSineBasis:
    """Distorted sines, Eq. (31), made orthonormal by Cholesky factorisation.

    Attributes
    ----------
    functions : int
        m_r, number of functions.
    memory_taps : int
        m, length of the truncated convolution sum in taps.
    form_factor : float
        eta, in taps: fits the functions to the speed of the plant.
    tap : float
        T_s [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    functions: int = 8
    memory_taps: int = 350
    form_factor: float = 120.0
    tap: float = 1e-3

    def __post_init__(self) -> None:
        refused = IdentificationError
        check_number(refused, 'number of basis functions', self.functions, 1, self.memory_taps)
        check_number(refused, 'form factor', self.form_factor, 0, above=True)
        check_number(refused, 'tap', self.tap, 0, above=True, unit='s')

    @property
    def duration(self) -> float:
        """Lag up to which a pulse acts [s]."""
        return (self.memory_taps + 0.5) * self.tap

    @cached_property
    def mixing(self) -> FloatArray:
        """The factor (C^T)^-1, lower triangular, shape (functions, functions)."""
        raw = self._raw(np.arange(1, self.memory_taps + 1, dtype=np.float64))
        try:
            factor = np.linalg.cholesky(raw.T @ raw)
        except np.linalg.LinAlgError as error:
            raise IdentificationError(
                f'expected a form factor that keeps {self.functions} functions independent over '
                f'{self.memory_taps} taps, got {self.form_factor}'
            ) from error
        return solve_triangular(factor, np.eye(self.functions), lower=True)

    @cached_property
    def area(self) -> FloatArray:
        """Integral of each function, T_s times its sum over the taps, shape (functions,) [s]."""
        taps = self.tap * np.arange(1, self.memory_taps + 1)
        total: FloatArray = self.tap * self.evaluate(taps).sum(axis=0)
        return total

    def evaluate(self, lag: npt.ArrayLike) -> FloatArray:
        """Return the orthonormal functions.

        Parameters
        ----------
        lag : array_like, shape (lags,)
            Time after the onset of a pulse [s].

        Returns
        -------
        ndarray, shape (lags, functions)
            Zero outside the support.
        """
        taps = np.atleast_1d(np.asarray(lag, dtype=np.float64)) / self.tap
        return self._raw(taps) @ self.mixing.T

    def _raw(self, taps: FloatArray) -> FloatArray:
        raw = np.zeros((len(taps), self.functions))
        _evaluate_all(taps, float(self.memory_taps), self.form_factor, raw)
        return raw


def conversion(old: LaguerreBasis, new: LaguerreBasis) -> FloatArray:
    """Return the matrix (functions, functions) that takes coefficients from one basis to another.

    The response of the new coefficients is the projection of the old one.
    """
    step = min(old.time_constant, new.time_constant) / 60.0
    lag = np.arange(0.5 * step, max(old.duration, new.duration), step)
    return step * (new.evaluate(lag).T @ old.evaluate(lag))
