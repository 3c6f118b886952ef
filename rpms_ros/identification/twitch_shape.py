# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The normalised twitch of Eq. (2) and its derivatives, compiled."""

import math

import numba

from rpms_ros.pulses import FloatArray

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
