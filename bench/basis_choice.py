# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Error of the batch on muscles of unknown latency, time constant and order.

`python bench/basis_choice.py [--seeds 5] [--seconds 30]`

Error of the curve in % of its maximum, median and worst session, share of the curve inside its
95 % interval, and errors of latency and T_a, over latencies of 5 to 30 ms, T_a of 8 to 90 ms and
orders 2 to 4, with 0.5 % noise.
"""

import argparse
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from rpms_ros.identification import estimator_by_name
from rpms_ros.muscle import simulation_subject

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from living_sessions import session

LATENCIES = (5e-3, 17e-3, 30e-3)
TIME_CONSTANTS = (8e-3, 20e-3, 40e-3, 90e-3)
ORDERS = (2, 3, 4)


def outcome(muscle, excitation, seed, seconds):
    """Return error of the curve [%], coverage, and errors of latency [ms] and T_a [%]."""
    what = session('steady', excitation, seed, seconds, muscle)
    estimator = estimator_by_name('batch')
    estimator.add_pulses(what.onset_ns, what.intensity)
    every = np.ones(len(what.stamp_ns), dtype=bool)
    estimator.update(what.stamp_ns, what.force, every)
    found = estimator.estimate(int(what.stamp_ns[-1]), {})
    truth = what.curve[-1]
    error = 100.0 * np.abs(found.curve_force - truth).max() / truth.max()
    # intensities below 5 % give hardly any force
    held = (found.curve_lower <= truth)[5:] & (truth <= found.curve_upper)[5:]
    read = dict(zip(found.physiology_names, found.physiology, strict=True))
    return (
        error,
        held.mean(),
        1e3 * abs(read['latency_s'] - muscle.latency),
        100.0 * abs(read['twitch_time_constant_s'] / muscle.time_constant - 1.0),
    )


def rows(seeds, seconds):
    """Print a row for each T_a and excitation."""
    print('T_a   intensities  curve, median / worst  coverage  latency [ms]  T_a [%]')
    for time_constant, excitation in product(TIME_CONSTANTS, ('random', 'sinusoid')):
        found = np.array(
            [
                outcome(
                    replace(
                        simulation_subject(),
                        latency=latency,
                        time_constant=time_constant,
                        order=order,
                    ),
                    excitation,
                    # noise and phase of its own for each
                    seed,
                    seconds,
                )
                for seed, (latency, order, _) in enumerate(
                    product(LATENCIES, ORDERS, range(seeds)), 1
                )
            ]
        )
        error, coverage, latency, constant = found.T
        print(
            f'{1e3 * time_constant:2.0f} ms {excitation:11} {np.median(error):.3f} / '
            f'{error.max():.3f} %  {coverage.mean():12.2f}  {np.median(latency):12.2f}  '
            f'{np.median(constant):7.1f}',
            flush=True,
        )


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=30.0)
    arguments = parser.parse_args()
    rows(arguments.seeds, arguments.seconds)
