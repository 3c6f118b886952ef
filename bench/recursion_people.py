# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recursion for people: error of the curve, intervals, change, and its cost.

`python bench/recursion_people.py [seeds]`

1 % noise, latency 9 ms, 20 Hz, 60 s: largest error of the curve in % of its maximum, median and
worst seed, and the share of the curve inside its 95 % band.  Then people drawn from the ranges of
the paper's tables, and a muscle that changes at 40 s (0.5 % noise): how long until the change is
found, and how long until the error of the curve stays below 1 and 2 %.  Then the processor time.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scenarios import MILLISECOND, RATE, record

from rpms_ros.identification import FixedSizeRecursion
from rpms_ros.muscle import random_subject, simulation_subject

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from living_sessions import MOVED_AT, session

AFTER = (5, 10, 20, 36, 60)
STEP = 1000
CHANGED_FOR = 80.0
KINDS = ('gain step', 'coil moved', 'slower', 'baseline')


def scenario(seed, period, seconds, subject):
    """Return a recording; a period of None gives random intensities."""
    generator = np.random.default_rng(seed)
    count = int(seconds * RATE)
    onset = 1_000 + np.arange(count, dtype=np.int64) * 50 * MILLISECOND
    intensity = generator.uniform(0.0, 1.0, count)
    if period is not None:
        intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / RATE / period)
    return record(subject(generator), onset, intensity, seconds, 0.01, generator)


def followed(parts):
    """Return error [%] and coverage after each second, the estimator and the processor time."""
    estimator = FixedSizeRecursion()
    errors, coverage, spent = [], [], 0.0
    for scene, first, last in parts:
        for start in range(int(first * STEP), int(last * STEP), STEP):
            part = slice(start, start + STEP)
            now = scene.stamp_ns[part]
            pulses = (scene.onset_ns >= now[0]) & (scene.onset_ns <= now[-1])
            begun = time.process_time()
            estimator.add_pulses(scene.onset_ns[pulses], scene.intensity[pulses])
            estimator.update(now, scene.force[part], np.ones(STEP, dtype=bool))
            spent += time.process_time() - begun
            found = estimator.estimate(int(now[-1]), {})
            if not found.curve_known:
                # So far all intensities were nearly one.
                errors.append(np.inf)
                coverage.append(1.0)
                continue
            errors.append(100.0 * scene.curve_error(found.curve_force))
            inside = (found.curve_lower <= scene.curve) & (scene.curve <= found.curve_upper)
            coverage.append(inside[5:].mean())
    return np.array(errors), np.array(coverage), estimator, spent


def known(_):
    """Return the subject of the simulated identification, with a latency."""
    return replace(simulation_subject(), latency=9e-3)


def table(name, subject, seeds, seconds):
    print(f'\n{name}: curve error after ... s, median / worst seed [%]; coverage from 10 s on')
    after = [second for second in AFTER if second <= seconds]
    print(f'{"":14}' + ''.join(f'{second:>14} s' for second in after) + '   coverage  changes')
    for kind, period in (('random', None), ('sinusoid 9 s', 9.0), ('sinusoid 18 s', 18.0)):
        runs = [
            followed([(scenario(seed, period, seconds, subject), 0, seconds)])
            for seed in range(seeds)
        ]
        errors = np.array([run[0] for run in runs])
        row = ''.join(
            f'{np.median(errors[:, second - 1]):8.2f} /{errors[:, second - 1].max():6.2f}'
            for second in after
        )
        coverage = np.mean([run[1][9:].mean() for run in runs])
        changes = sum(run[2].estimate(0, {}).changes for run in runs)
        print(f'{kind:14}{row}   {coverage:8.3f}  {changes}', flush=True)
        first, goal = (10, 1.0) if period is None else (36, 2.0)
        if seconds > first:
            worst = errors[:, first - 1 :].max(axis=1)
            share = f'largest from {first} s on: median {np.median(worst):.2f}'
            print(f'{"":14}{share}, worst seed {worst.max():.2f} (goal {goal:g} in the median)')


def altered(kind, excitation, seed):
    """Return a session that changes at 40 s."""
    if kind != 'baseline':
        return session(kind, excitation, seed, CHANGED_FOR)
    what = session('steady', excitation, seed, CHANGED_FOR)
    return what._replace(force=what.force + 1.0 * (what.stamp_ns >= 1e9 * MOVED_AT))


def after_change(kind, excitation, seed):
    """Return when a change was found and the curve was back for good [s], and how many."""
    what = altered(kind, excitation, seed)
    estimator = FixedSizeRecursion()
    estimator.add_pulses(what.onset_ns, what.intensity)
    found, back, first = np.inf, {1.0: 0.0, 2.0: 0.0}, 0
    for time_s, curve in zip(what.noted_s, what.curve, strict=True):
        last = int(np.searchsorted(what.stamp_ns, round(1e9 * time_s)))
        part, first = slice(first, last), last
        usable = np.ones(last - part.start, dtype=bool)
        estimator.update(what.stamp_ns[part], what.force[part], usable)
        estimate = estimator.estimate(int(what.stamp_ns[last - 1]), {})
        if time_s <= MOVED_AT or not estimate.curve_known:
            continue
        found = min(found, time_s - MOVED_AT) if estimate.changes else found
        error = 100.0 * np.abs(estimate.curve_force - curve).max() / curve.max()
        for limit in back:
            back[limit] = time_s - MOVED_AT if error > limit else back[limit]
    return found, back[1.0], back[2.0], estimate.changes


def changed(seeds):
    print('\nchange at 40 s (0.5 % noise): median / worst seed; found once')
    print(f'{"":22}{"once":14}found after        back within 1 %    within 2 %')
    for kind in KINDS:
        for excitation in ('random', 'sinusoid'):
            runs = [after_change(kind, excitation, seed) for seed in range(seeds)]
            found, one, two = np.array([run[:3] for run in runs]).T
            once = sum(run[3] == 1 for run in runs)
            row = '  '.join(
                f'{np.median(times):4.1f} / {times.max():4.1f} s' for times in (found, one, two)
            )
            print(f'{kind:12} {excitation:9} {once:3} of {seeds}   {row}', flush=True)


def cost():
    spent = followed([(scenario(0, None, 60, known), 0, 60)])[3]
    print(f'\ncost at 1 kHz and 20 Hz: {100 * spent / 60:.2f} % of a core')


def main():
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    table('simulated subject', known, seeds, 60)
    table('people', random_subject, max(seeds, 50) if seeds >= 20 else seeds, 40)
    changed(seeds)
    cost()
    return 0


if __name__ == '__main__':
    sys.exit(main())
