# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Share of a twitch that Laguerre functions miss, by their number and time constant.

`python bench/basis_functions.py`

L2 norm of the error over that of the twitch, for the ranges of T_a and latency of the paper's
Tables 1 and 2.  The functions begin 8 ms after the pulse.
"""

import itertools

import numpy as np

from rpms_ros.identification import LaguerreBasis
from rpms_ros.muscle import twitch

TIME_CONSTANTS = np.linspace(26.71e-3, 49.81e-3, 12)
LATENCIES = np.linspace(6.28e-3, 14.63e-3, 12)
LAG = np.arange(0.0, 0.8, 0.1e-3)


def missed(basis: LaguerreBasis) -> np.ndarray:
    """Return the shares of the twitches that a basis misses (twitches,)."""
    values = basis.evaluate(LAG)
    found = []
    for time_constant, latency in itertools.product(TIME_CONSTANTS, LATENCIES):
        force = twitch(LAG - latency, time_constant)
        weights = np.linalg.lstsq(values, force, rcond=None)[0]
        found.append(np.linalg.norm(force - values @ weights) / np.linalg.norm(force))
    return np.array(found)


def main() -> None:
    """Print a row for each basis."""
    print('T_p [ms]  functions  median [%]  worst [%]')
    for time_constant, functions in (
        *((38e-3, count) for count in (5, 6, 7, 8, 10)),
        *((other, 7) for other in (26e-3, 32e-3)),
    ):
        share = 100.0 * missed(LaguerreBasis(functions, time_constant, 8e-3))
        print(
            f'{1e3 * time_constant:8.0f}  {functions:9d}  {np.median(share):10.2f}  '
            f'{share.max():9.2f}'
        )


if __name__ == '__main__':
    main()
