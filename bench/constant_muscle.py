# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a muscle that changes: what the batch says of them, and what follows it then.

`python bench/constant_muscle.py [--seeds 3]`

90 s at 20 Hz with 0.5 % noise: the largest share of the force that a part of 5 s would explain
better by a muscle of its own, in how many recordings the batch says that no constant muscle
explains them, its error of the curve as of the end, the share of the curve inside its interval,
the same of `tracking`, which `rpms identify` runs in its place then, and processor time of both.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from rpms_ros.identification import estimator_by_name
from rpms_ros.identification.quality.doubts import NO_CONSTANT_MUSCLE

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from living_sessions import session

KINDS = ('steady', 'fatigue', 'coil moved', 'gain step', 'slower', 'bursts', 'tremor')


def outcome(name, what):
    """Return error of the curve [%], coverage, seconds, the estimator and its estimate."""
    estimator = estimator_by_name(name)
    begun = time.process_time()
    estimator.add_pulses(what.onset_ns, what.intensity)
    estimator.update(what.stamp_ns, what.force, np.ones(len(what.stamp_ns), dtype=bool))
    found = estimator.estimate(int(what.stamp_ns[-1]), {})
    spent = time.process_time() - begun
    truth = what.curve[-1]
    error = 100.0 * np.abs(found.curve_force - truth).max() / truth.max()
    held = (found.curve_lower <= truth)[5:] & (truth <= found.curve_upper)[5:]
    return error, held.mean(), spent, estimator, found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3)
    seeds = parser.parse_args().seeds
    print('                       share   said     batch: curve   held     tracking: curve   held')
    spent = np.zeros(2)
    for kind in KINDS:
        for excitation in ('random', 'sinusoid'):
            rows, said = [], 0
            for seed in range(seeds):
                what = session(kind, excitation, seed)
                error, held, seconds, estimator, found = outcome('batch', what)
                share = estimator.unexplained[:, 0].max()
                said += NO_CONSTANT_MUSCLE in found.doubts
                other = outcome('tracking', what)
                spent += seconds, other[2]
                rows.append((100.0 * share, error, held, *other[:2]))
            share, error, held, followed, within = np.array(rows).T
            print(
                f'{kind:10} {excitation:9} {share.max():6.2f} %  {said} of {seeds}  '
                f'{np.median(error):6.2f} / {error.max():6.2f} %  {held.mean():.2f}  '
                f'{np.median(followed):6.2f} / {followed.max():6.2f} %  {within.mean():.2f}',
                flush=True,
            )
    sessions = 2 * len(KINDS) * seeds
    print(
        f'processor time of 90 s: batch {spent[0] / sessions:.1f} s, tracking '
        f'{spent[1] / sessions:.1f} s'
    )


if __name__ == '__main__':
    main()
