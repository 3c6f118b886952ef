# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscles of other kinds than the model's, by estimator.

`python bench/league.py [--seeds 3] [--muscles boltzmann ...] [--estimators batch tracking]`

Random people with a recruitment of another shape, or another summation, simulated here without
code of the package: 60 s at 20 Hz with 0.5 % noise, random intensities and a sinusoid of 9 s.
Error of the curve and half of its 95 % interval in % of the curve's maximum (median and worst;
median), share of the curve inside the interval, doubts, and processor time of a session.
"""

import argparse
import math
import time
from collections import Counter

import numpy as np

from rpms_ros.identification import estimator_by_name
from rpms_ros.pulses import ForceTrace, PulseTrain

SECONDS, RATE, NOISE = 60.0, 20.0, 0.005
U = np.linspace(0.0, 1.0, 101)


def arctan(u, one):
    def shape(v):
        low, high = v - one['thr'], v - one['sat']
        return low * np.arctan(one['a_thr'] * low) - high * np.arctan(one['a_sat'] * high)

    return shape(u) - shape(0.0 * u)


def boltzmann(u, one):
    def shape(v):
        return 1.0 / (1.0 + np.exp(-(v - one['middle']) / one['width']))

    return shape(u) - shape(0.0 * u)


def gauss(u, one):
    def shape(v):
        z = (v - one['middle']) / (1.7 * one['width']) / math.sqrt(2.0)
        return 0.5 * (1.0 + np.vectorize(math.erf)(z))

    return shape(u) - shape(0.0 * u)


def weibull(u, one):
    above = np.maximum(u - one['thr'] + 0.15, 0.0)
    return 1.0 - np.exp(-((above / (3.5 * one['width'])) ** 2.2))


def unsaturated(u, one):
    return np.maximum(u - one['thr'] + 0.1, 0.0) ** 1.4


def pools(u, one):
    def step(middle, width):
        return 1.0 / (1.0 + np.exp(-(u - middle) / width)) - 1.0 / (1.0 + math.exp(middle / width))

    return 0.55 * step(one['middle'] - 0.15, 0.025) + 0.45 * step(one['middle'] + 0.2, 0.03)


MUSCLES = {
    'arctan': arctan,
    'boltzmann': boltzmann,
    'gauss': gauss,
    'weibull': weibull,
    'unsaturated': unsaturated,
    'pools': pools,
}


def person(generator):
    """Return what differs among people."""
    thr = generator.uniform(0.35, 0.55)
    return {
        'thr': thr,
        'sat': thr + generator.uniform(0.25, 0.45),
        'a_thr': generator.uniform(4.5, 7.0),
        'a_sat': generator.uniform(3.0, 12.0),
        'middle': generator.uniform(0.5, 0.65),
        'width': generator.uniform(0.05, 0.09),
        'time_constant': generator.uniform(25e-3, 50e-3),
        'latency': generator.uniform(6e-3, 14e-3),
    }


def intensities(excitation, generator):
    count = round(SECONDS * RATE)
    if excitation == 'random':
        return generator.uniform(0.0, 1.0, count)
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / RATE / 9.0)


def session(muscle, excitation, seed):
    """Return pulses, force and the true curve."""
    generator = np.random.default_rng([seed, sorted(MUSCLES).index(muscle)])
    one = person(generator)
    intensity = intensities(excitation, generator)
    recruited = MUSCLES[muscle](intensity, one)
    grid = np.arange(0.0, SECONDS, 1e-3)
    onset = 1e-3 + np.arange(len(intensity)) / RATE
    force = np.zeros(len(grid))
    constant = one['time_constant']
    for at, size in zip(onset, recruited, strict=True):
        first = np.searchsorted(grid, at + one['latency'])
        lag = grid[first : first + 900] - at - one['latency']
        force[first : first + 900] += size * (lag / constant) ** 2 * np.exp(-lag / constant)
    area = 2.0 * constant
    truth = RATE * area * MUSCLES[muscle](U, one)
    scale = 10.0 / truth.max()
    force = scale * force + NOISE * 10.0 * generator.standard_normal(len(grid))
    stamp_ns = np.round(1e9 * grid).astype(np.int64)
    return (
        PulseTrain.regular(intensity, RATE, 1_000_000),
        ForceTrace(stamp_ns, force),
        scale * truth,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--muscles', nargs='+', choices=MUSCLES, default=[*MUSCLES])
    parser.add_argument('--estimators', nargs='+', default=['batch', 'tracking'])
    chosen = parser.parse_args()
    print('muscle       intensities  estimator   error, median / worst   half   coverage   time')
    for muscle in chosen.muscles:
        for excitation in ('random', 'sinusoid'):
            for name in chosen.estimators:
                rows, doubts = [], Counter()
                for seed in range(chosen.seeds):
                    pulses, forces, truth = session(muscle, excitation, seed)
                    begun = time.process_time()
                    estimator = estimator_by_name(name)
                    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
                    usable = np.ones(len(forces.force), dtype=bool)
                    estimator.update(forces.stamp_ns, forces.force, usable)
                    found = estimator.estimate(int(forces.stamp_ns[-1]), {})
                    spent = time.process_time() - begun
                    height = truth.max() / 100.0
                    error = np.abs(found.curve_force - truth).max() / height
                    half = (found.curve_upper - found.curve_lower).max() / 2.0 / height
                    held = (found.curve_lower <= truth) & (truth <= found.curve_upper)
                    rows.append((error, half, held[5:].mean(), spent))
                    doubts.update(found.doubts)
                error, half, held, spent = np.array(rows).T
                print(
                    f'{muscle:12} {excitation:12} {name:10} {np.median(error):7.3f} / '
                    f'{error.max():7.3f} % {np.median(half):7.3f} {held.mean():8.2f} '
                    f'{np.median(spent):7.1f} s  {dict(doubts) or ""}',
                    flush=True,
                )


if __name__ == '__main__':
    main()
