# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscles and situations of other kinds than the model's, by estimator.

`python bench/league.py [--seeds 3] [--muscles boltzmann ...] [--estimators batch scipy ...]`

Random people with a recruitment of another shape, another summation, or something beside the
stimulation, simulated here without code of the package: 60 s at 20 Hz with 0.5 % noise, random
intensities and a sinusoid of 9 s.  Error of the curve and half of its 95 % interval in % of the
curve's maximum (median and worst; median), share of the curve inside the interval, verdicts and
doubts, and processor time of a session.  `silent` counts sessions whose curve is wrong by more
than 2 % and outside its interval, with the verdict good.  Beside the muscle of the model's own
family, `arctan`, stands the least deviation that any unbiased estimator of its eight parameters
can have (Cramer and Rao), and by how much the error exceeds it, both as root mean squares over
curve and people.  `scipy`, `polynomial` and `ekf` are those of peers.py; they state no interval.
"""

import argparse
import math
import sys
import time
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter

import rpms_ros

sys.path.insert(0, str(Path(__file__).parent))

import peers

SECONDS, RATE, NOISE, RECOVERY = 60.0, 20.0, 0.005, 15.0
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


RECRUITMENTS = {
    'arctan': arctan,
    'boltzmann': boltzmann,
    'gauss': gauss,
    'weibull': weibull,
    'unsaturated': unsaturated,
    'pools': pools,
}
SITUATIONS = [
    *('doublets', 'ding', 'slip', 'effort', 'heart', 'hum', 'rests', 'length', 'release'),
    *('filter', 'jitter', 'lost', 'late'),
]
MUSCLES = [*RECRUITMENTS, *SITUATIONS]


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


def twitches(grid, onset, size, one):
    """Return the sum of third-order twitches of area 1."""
    force, constant = np.zeros(len(grid)), one['time_constant']
    for at, each in zip(onset, size, strict=True):
        first = np.searchsorted(grid, at + one['latency'])
        lag = grid[first : first + 900] - at - one['latency']
        force[first : first + 900] += each * (lag / constant) ** 2 * np.exp(-lag / constant)
    return force / (2.0 * constant)


UNITS = 40


def motor_units(grid, onset, intensity, one):
    """Return the force of units that sum by calcium (Ding, Wexler and Binder-Macleod 2003), fast.

    Each has a threshold of its own, such that as many are above theirs as `arctan` says.
    """
    rank = arctan(U, one)
    threshold = np.interp((np.arange(UNITS) + 0.5) / UNITS, rank / rank[-1], U)
    tau_c, k_m, tau_1, tau_2 = 11e-3, 0.3, 30e-3, 60e-3
    calcium, trains, unit = np.zeros(UNITS), np.zeros(UNITS), np.zeros(UNITS)
    last = np.full(UNITS, -1.0)
    force, pulse, step = np.zeros(len(grid)), 0, grid[1] - grid[0]
    for index, now in enumerate(grid):
        if pulse < len(onset) and now >= onset[pulse] + one['latency']:
            fired = intensity[pulse] >= threshold
            since = np.where(last < 0.0, np.inf, now - last)
            trains += np.where(fired, 1.0 + 0.04 * np.exp(-since / tau_c), 0.0)
            last = np.where(fired, now, last)
            pulse += 1
        trains -= step * trains / tau_c
        calcium += step * (trains - calcium) / tau_c
        bound = calcium / (k_m + calcium)
        unit += step * (bound - unit / (tau_1 + tau_2 * bound))
        force[index] = unit.sum()
    return force


def coloured(generator, count):
    """Return noise whose power falls with the frequency, of standard deviation 1."""
    spectrum = np.fft.rfft(generator.standard_normal(count))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0.0
    noise = np.fft.irfft(spectrum, count)
    return noise / noise.std()


def tired(onset, intensity):
    """Return the share of the force that each pulse finds, and the share left at the end.

    Each takes a part of what is left, which comes back within a quarter of a minute.
    """
    share, left, last = np.ones(len(onset)), 1.0, 0.0
    for index, at in enumerate(onset):
        left = 1.0 - (1.0 - left) * math.exp(-(at - last) / RECOVERY)
        share[index], last = left, at
        left *= 1.0 - 0.0015 * intensity[index]
    return share, 1.0 - (1.0 - left) * math.exp(-(SECONDS - last) / RECOVERY)


def slipped(one, at):
    """Return a person whose coil has slipped for a time [s]."""
    return one | {name: one[name] + 0.1 * at / SECONDS for name in ('thr', 'sat')}


def contraction(muscle, grid, onset, intensity, one, generator):
    """Return the force of the stimulated muscle and its true curve at the end."""
    shape = RECRUITMENTS.get(muscle, arctan)
    recruited, truth = shape(intensity, one), RATE * shape(U, one)
    if muscle == 'ding':
        # units that are above their threshold do all the same
        beat, many = np.arange(0.0, 3.0, 1e-3), np.arange(1e-3, 3.0, 1.0 / RATE)
        every = motor_units(beat, many, np.ones(len(many)), one)[-1000:].mean()
        rank = arctan(U, one)
        above = np.searchsorted((np.arange(UNITS) + 0.5) / UNITS, rank / rank[-1])
        return motor_units(grid, onset, intensity, one), every * above / UNITS
    if muscle == 'slip':
        pairs = zip(intensity, onset, strict=True)
        recruited = np.array([shape(np.array([u]), slipped(one, at))[0] for u, at in pairs])
        truth = RATE * shape(U, slipped(one, SECONDS))
    if muscle == 'rests':
        share, left = tired(onset, intensity)
        recruited, truth = recruited * share, truth * left
    if muscle == 'jitter':
        onset = onset + 0.5e-3 * generator.standard_normal(len(onset))
    force = twitches(grid, onset, recruited, one)
    if muscle == 'length':
        # the joint swings: force by length, and a passive spring
        swing = np.sin(2.0 * np.pi * 0.31 * grid)
        force = force * (1.0 + 0.15 * swing) + 0.05 * truth.max() * (1.0 + swing)
    if muscle == 'release':
        force = force * np.where(grid % 10.0 // 0.4 == 12.0, 0.4, 1.0)
    return force, truth


def beside(muscle, grid, onset, intensity, generator):
    """Return the force (10 N is that of the muscle) that no pulse causes."""
    if muscle == 'effort':
        # the patient tenses with what is felt, half a second late
        felt = np.interp(grid - 0.5, onset, intensity)
        return np.convolve(felt, np.full(500, 1.0 / 500), 'same')
    if muscle == 'heart':
        return 0.2 * np.sin(2.0 * np.pi * 1.1 * grid) + 0.3 * np.sin(2.0 * np.pi * 0.23 * grid)
    if muscle == 'hum':
        return 0.1 * np.sin(2.0 * np.pi * 50.0 * grid) + 0.1 * coloured(generator, len(grid))
    return 0.0


def session(muscle, excitation, seed):
    """Return pulses, force and the true curve."""
    generator = np.random.default_rng([seed, zlib.crc32(muscle.encode())])
    one = person(generator)
    intensity = intensities(excitation, generator)
    grid = np.arange(0.0, SECONDS, 1e-3)
    onset = 1e-3 + np.arange(len(intensity)) / RATE
    if muscle == 'doublets':
        onset, intensity = onset[::2], intensity[::2]
        onset = np.column_stack((onset, onset + 8e-3)).ravel()
        intensity = np.repeat(intensity, 2)
    if muscle == 'rests':
        # the session ends in a pause
        kept = onset % 16.0 < 8.0
        onset, intensity = onset[kept], intensity[kept]
    force, truth = contraction(muscle, grid, onset, intensity, one, generator)
    scale = 10.0 / truth.max()
    force = scale * force + NOISE * 10.0 * generator.standard_normal(len(grid))
    force += beside(muscle, grid, onset, intensity, generator)
    if muscle == 'filter':
        force = lfilter(*butter(2, 30.0, fs=1e3), force)
    if muscle == 'lost':
        kept = generator.uniform(size=len(onset)) > 0.01
        onset, intensity = onset[kept], intensity[kept]
    if muscle == 'late':
        onset = onset + 0.05
    return (grid, force, onset, intensity), scale * truth


def least(excitation, seed):
    """Return the bound (101,) of the curve of `arctan`, for a maximum of 1."""
    generator = np.random.default_rng([seed, zlib.crc32(b'arctan')])
    one = person(generator)
    (grid, _, onset, intensity), truth = session('arctan', excitation, seed)
    gain = truth.max() / (RATE * arctan(U, one).max())
    alphas = math.log(one['a_thr']), math.log(one['a_sat'])
    twitch = math.log(one['time_constant']), one['latency']
    known = np.array([one['thr'], one['sat'], *alphas, *twitch, gain, 0.0])
    return peers.bound(known, grid, onset, intensity, NOISE * 10.0) / truth.max()


PEERS = {'scipy': peers.by_scipy, 'polynomial': peers.by_polynomial, 'ekf': peers.by_ekf}


def identified(name, arrays, truth):
    """Return curve, half of its interval, what is inside, the verdict and doubts, seconds."""
    begun = time.process_time()
    if name in PEERS:
        curve = PEERS[name](*arrays)
        return curve, math.nan, math.nan, [], time.process_time() - begun
    found = rpms_ros.from_arrays(*arrays).identify(name)
    spent, last = time.process_time() - begun, found.estimates.last
    held = (last.curve_lower <= truth) & (truth <= last.curve_upper)
    half = (last.curve_upper - last.curve_lower).max() / 2.0
    return last.curve_force, half, held[5:].mean(), [found.verdict.grade, *last.doubts], spent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--muscles', nargs='+', choices=MUSCLES, default=MUSCLES)
    parser.add_argument('--estimators', nargs='+', default=['batch', 'tracking', 'recursive'])
    chosen = parser.parse_args()
    print('muscle       intensities  estimator   error, median / worst   half   coverage   time')
    silent = 0
    for muscle in chosen.muscles:
        for excitation in ('random', 'sinusoid'):
            for name in chosen.estimators:
                rows, said, off = [], Counter(), []
                for seed in range(chosen.seeds):
                    arrays, truth = session(muscle, excitation, seed)
                    curve, half, held, words, spent = identified(name, arrays, truth)
                    off.append((curve - truth) / truth.max())
                    error = 100.0 * np.abs(off[-1]).max()
                    rows.append((error, 100.0 * half / truth.max(), held, spent))
                    said.update(words)
                    silent += words[:1] == ['good'] and error > 2.0 and held < 1.0
                error, half, held, spent = np.array(rows).T
                line = (
                    f'{muscle:12} {excitation:12} {name:10} {np.median(error):7.3f} / '
                    f'{error.max():7.3f} % {np.median(half):7.3f} {held.mean():8.2f} '
                    f'{np.median(spent):7.1f} s  {dict(said)}'
                )
                if muscle == 'arctan':
                    bound = [least(excitation, seed) for seed in range(chosen.seeds)]
                    deviation, rms = (100.0 * np.sqrt(np.mean(np.square(x))) for x in (bound, off))
                    line += f'  bound {deviation:.4f} %, ratio {rms / deviation:.2f}'
                print(line, flush=True)
    print(f'silent: {silent}')


if __name__ == '__main__':
    main()
