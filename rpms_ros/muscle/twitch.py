# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The twitch: force of a muscle after one pulse, and what a train of them adds up to.

An n-th order system with n equal real poles at ``-1/T_a`` answers an impulse with
``t**(n-1) exp(-t/T_a)``; its maximum lies at ``t = (n-1) T_a``.  Divided by that maximum it is

.. math:: F(t) = \left(\frac{t}{(n-1) T_a}\right)^{n-1} e^{(n-1) - t/T_a}

which is Eq. (2) of Bernhardt et al. without its surplus factor ``n-1``, and Eq. (5) for n = 3.
"""

import math

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.pulses import FloatArray


def _require_twitch(time_constant: float, order: float) -> None:
    check_number(MuscleError, 'time constant', time_constant, 0, above=True, unit='s')
    check_number(MuscleError, 'order', order, 1)


def twitch(lag: npt.ArrayLike, time_constant: float, order: float = 3) -> FloatArray:
    """Return the normalised twitch, Eqs. (2) and (5).

    Parameters
    ----------
    lag : array_like, shape (...)
        Time after the onset of the contraction [s]; 0 is returned before it.
    time_constant : float
        T_a [s].
    order : float
        Number of equal real poles, at least 1; need not be whole.

    Returns
    -------
    ndarray, shape (...)
        Share of the twitch's maximum, 0..1.

    Raises
    ------
    MuscleError
        If the time constant is not above 0 s or the order below 1.
    """
    _require_twitch(time_constant, order)
    scaled = np.asarray(lag, dtype=np.float64) / time_constant
    active = np.maximum(scaled, 0.0)
    power = order - 1.0
    if power == 0.0:
        return np.where(scaled >= 0.0, np.exp(-active), 0.0)
    return np.where(scaled > 0.0, (active / power) ** power * np.exp(power - active), 0.0)


def twitch_area(time_constant: float, order: float = 3) -> float:
    """Return the integral of the normalised twitch [s]: T_a e^2 / 2 for order 3 (Eq. 7).

    Raises
    ------
    MuscleError
        If the time constant is not above 0 s or the order below 1.
    """
    _require_twitch(time_constant, order)
    power = order - 1.0
    peak = 1.0 if power == 0.0 else power**power * math.exp(-power)
    return time_constant * math.gamma(order) / peak


def steady_mean(rate_hz: float, time_constant: float, order: float = 3) -> float:
    """Return the constant part of a train's summed twitches, Eq. (7), in twitch maxima.

    The mean over one period of the superposition is the area of one twitch times the rate;
    the sampled sum of Eq. (7) agrees with this integral to 1e-6 for T_s well below T_a.
    """
    return rate_hz * twitch_area(time_constant, order)


def summed_twitches(
    time: npt.ArrayLike, rate_hz: float, time_constant: float, order: float = 3
) -> FloatArray:
    """Return the superposition of equal twitches from time 0 on, Eq. (6), in twitch maxima.

    Parameters
    ----------
    time : array_like, shape (samples,)
        Time after the onset of the first twitch [s].
    rate_hz : float
        Repetition rate [Hz].
    time_constant, order : float
        As in `twitch`.

    Returns
    -------
    ndarray, shape (samples,)
        Sum of the twitches that have begun.

    Raises
    ------
    MuscleError
        If the rate is not above zero.
    """
    check_number(MuscleError, 'repetition rate', rate_hz, 0, above=True, unit='Hz')
    moments = np.asarray(time, dtype=np.float64)
    total = np.zeros_like(moments)
    for index in range(math.floor(moments.max(initial=0.0) * rate_hz) + 1):
        total += twitch(moments - index / rate_hz, time_constant, order)
    return total


TWITCH, BY_ONSET, BY_LOGARITHM, BY_ORDER = range(4)


@numba.njit(cache=True, nogil=True)
def twitch_row(lag: float, constant: float, order: float, row: FloatArray) -> None:
    """Write the twitch and its derivatives by onset [1/s], ln T_a and order into `row` (4,).

    With ``x = lag / T_a`` and ``k = n - 1`` the twitch is ``(x/k)^k e^(k - x)``; `lag` is the time
    since the onset [s].
    """
    row[:] = 0.0
    if lag > 0.0:
        power = order - 1.0
        scaled = lag / constant
        value = math.exp(power * math.log(scaled / power) + power - scaled)
        row[TWITCH] = value
        row[BY_ONSET] = -value * (power / scaled - 1.0) / constant
        row[BY_LOGARITHM] = value * (scaled - power)
        row[BY_ORDER] = value * math.log(scaled / power)
