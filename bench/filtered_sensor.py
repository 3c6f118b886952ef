# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Curves of a sensor whose filter makes neighbouring samples of its noise alike.

`python bench/filtered_sensor.py [--seeds 2] [--estimators tracking recursive batch]`

A steady muscle, 20 Hz, 40 s at 1 kHz, 0.5 % noise; muscle and noise go through a low-pass of
second order.  Every second after 15 s (`batch`: at the end): error of the curve and half of its
95 % interval in % of its maximum (median; error also at worst), share of the curve inside the
interval, and share of the estimates that are doubted.
"""

import argparse
import os
import sys
from itertools import product
from pathlib import Path

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from scipy.signal import butter, lfilter

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.pulses import ForceTrace, PulseTrain

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from living_sessions import RATE, session

SECONDS, SETTLED = 40.0, 15
# Corners of the filter [Hz]; 0 for none.
CORNERS = (0, 20, 50)


def run(name, corner, excitation, seed):
    """Return errors, half widths, coverage and doubts (times,)."""
    what = session('steady', excitation, seed, SECONDS)
    force = lfilter(*butter(2, corner, fs=1000.0), what.force) if corner else what.force
    pulses = PulseTrain.regular(what.intensity, RATE, 1_000)
    found = identify(
        estimator_by_name(name),
        pulses,
        ForceTrace(what.stamp_ns, force),
        StreamSettings(estimate_period=1.0),
    ).estimates
    truth = what.curve[-1]
    rows = []
    for one in found:
        if one.stamp_ns < SETTLED * 1_000_000_000:
            continue
        held = (one.curve_lower <= truth) & (truth <= one.curve_upper)
        rows.append(
            (
                100.0 * np.abs(one.curve_force - truth).max() / truth.max(),
                50.0 * (one.curve_upper - one.curve_lower).max() / truth.max(),
                held[5:].mean(),
                len(one.doubts) > 0,
            )
        )
    return np.array(rows, dtype=np.float64)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=2)
    names = ['tracking', 'recursive', 'batch']
    parser.add_argument('--estimators', nargs='+', choices=names, default=names)
    arguments = parser.parse_args()
    print('estimator  low-pass  intensities  error, median / worst  half  coverage  doubted')
    for name, corner, excitation in product(arguments.estimators, CORNERS, ('random', 'sinusoid')):
        seeds = range(1, arguments.seeds + 1)
        rows = np.concatenate([run(name, corner, excitation, seed) for seed in seeds])
        session.cache_clear()
        errors, halves, held, doubted = rows.T
        print(
            f'{name:10} {corner:4} Hz  {excitation:9} {np.median(errors):6.2f} / '
            f'{errors.max():6.2f} %  {np.median(halves):6.2f} %  {held.mean():5.2f}  '
            f'{doubted.mean():5.2f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
