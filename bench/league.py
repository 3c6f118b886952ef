# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscles and situations of other kinds than the model's, by estimator.

`python bench/league.py [--seeds 3] [--muscles boltzmann ...] [--estimators batch scipy ...]
                        [--excitations upper ...]`
`python bench/league.py --drawn 1000 [--first 0] [--estimators batch ...]`
`python bench/league.py --steady 240 [--first 0] [--estimators recursive ...]`
`python bench/league.py --begin [--seeds 10] [--estimators tracking ...]`

Random people with a recruitment of another shape, another summation, or something beside the
stimulation, simulated here without code of the package: 60 s at 20 Hz with 0.5 % noise, random
intensities and a sinusoid of 9 s.  Error of the curve and half of its 95 % interval in % of the
curve's maximum (median and worst; median), share of the curve inside the interval, verdicts and
doubts, processor time of a session, and for muscles that stay the same error and coverage of the
response to one pulse at full intensity (worst; mean).  `silent` counts sessions whose curve is
wrong by more than 2 % and outside its interval, with the verdict good.  Beside the muscle of the
model's own family, `arctan`, stands the least deviation that any unbiased estimator of its eight
parameters can have (Cramer and Rao), that of one that is unbiased for recruitment and response of
any shape too, and by how much the error exceeds them, all as root mean squares over curve and
people.
`scipy`, `polynomial` and `ekf` are those of peers.py; they state no interval.

With --drawn, each session has a muscle and up to two situations, an excitation, a rate, a duration
and a noise of its own, all drawn; those that are silent are printed, and how many of the model's
family with nothing beside the stimulation were doubted.

With --steady, each session is of five minutes of a muscle that does not change, with pulses that
are not heard, intervals that vary by 8 ms, glitches of the sensor, or all three; those in which a
change is named are printed.

With --begin, how soon the curve of a new muscle, `arctan`, stays within 1 % of its maximum, and
the same bounds of the curve's worst point after so long, as medians over people.
"""

import argparse
import math
import sys
import time
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.signal import bilinear, butter, lfilter

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
# the last ones are never drawn
MUSCLES = [*RECRUITMENTS, *SITUATIONS, 'sway', 'second', 'swing', 'zeroed']
# these end as another muscle than they begin
CHANGING = ('slip', 'rests', 'sway')
EXCITATIONS = ['random', 'sinusoid', 'upper', 'staircase', 'groups', 'catch']


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
        'seconds': SECONDS,
        'rate': RATE,
        'noise': NOISE,
    }


def intensities(excitation, one, generator):
    """Return intensities at a steady rate."""
    count = round(one['seconds'] * one['rate'])
    time = np.arange(count) / one['rate']
    slow = 0.5 - 0.5 * np.cos(2.0 * np.pi * time / 9.0)
    if excitation == 'sinusoid':
        return slow
    any_of_them = generator.uniform(0.0, 1.0, count)
    if excitation == 'catch':
        return np.where(generator.uniform(size=count) < 0.1, any_of_them, slow)
    return {
        'random': any_of_them,
        'upper': 0.3 + 0.7 * any_of_them,
        'staircase': np.abs((time // 1.5 * 0.1 + 1.0) % 2.0 - 1.0),
        'groups': np.where(time % 6.0 < 4.0, any_of_them, 0.0),
    }[excitation]


def twitches(grid, onset, size, one, order=3):
    """Return the sum of twitches of area 1."""
    force, constant = np.zeros(len(grid)), one['time_constant']
    for at, each in zip(onset, size, strict=True):
        first = np.searchsorted(grid, at + one['latency'])
        lag = grid[first : first + 900] - at - one['latency']
        force[first : first + 900] += (
            each * (lag / constant) ** (order - 1) * np.exp(-lag / constant)
        )
    return force / (math.factorial(order - 1) * constant)


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


def tired(onset, intensity, one):
    """Return the share of the force that each pulse finds, and the share left at the end.

    Each takes a part of what is left, which comes back within a quarter of a minute.
    """
    share, left, last = np.ones(len(onset)), 1.0, 0.0
    for index, at in enumerate(onset):
        left = 1.0 - (1.0 - left) * math.exp(-(at - last) / RECOVERY)
        share[index], last = left, at
        left *= 1.0 - 0.0015 * intensity[index]
    return share, 1.0 - (1.0 - left) * math.exp(-(one['seconds'] - last) / RECOVERY)


def slipped(kinds, one, at):
    """Return a person whose coil has slipped for a time [s], or sways."""
    way = 0.1 * at / one['seconds'] if 'slip' in kinds else 0.03 * math.sin(at * math.pi / 20.0)
    return one | {name: one[name] + way for name in ('thr', 'sat')}


def contraction(kinds, grid, onset, intensity, one, generator):
    """Return the force of the stimulated muscle and its true curve at the end."""
    shape, rate = RECRUITMENTS[kinds[0]], one['rate']
    recruited, truth = shape(intensity, one), rate * shape(U, one)
    if 'slip' in kinds or 'sway' in kinds:
        people = [slipped(kinds, one, at) for at in onset]
        pairs = zip(intensity, people, strict=True)
        recruited = np.array([shape(np.array([u]), then)[0] for u, then in pairs])
        truth = rate * shape(U, slipped(kinds, one, one['seconds']))
    if 'rests' in kinds:
        share, left = tired(onset, intensity, one)
        recruited, truth = recruited * share, truth * left
    if 'jitter' in kinds:
        onset = onset + 0.5e-3 * generator.standard_normal(len(onset))
    force = twitches(grid, onset, recruited, one, 2 if 'second' in kinds else 3)
    if 'ding' in kinds:
        # units that are above their threshold do all the same
        beat, many = np.arange(0.0, 3.0, 1e-3), np.arange(1e-3, 3.0, 1.0 / rate)
        every = motor_units(beat, many, np.ones(len(many)), one)[-1000:].mean()
        rank = arctan(U, one)
        above = np.searchsorted((np.arange(UNITS) + 0.5) / UNITS, rank / rank[-1])
        force, truth = motor_units(grid, onset, intensity, one), every * above / UNITS
    if 'length' in kinds:
        # the joint swings: force by length, and a passive spring
        swing = np.sin(2.0 * np.pi * 0.31 * grid)
        force = force * (1.0 + 0.15 * swing) + 0.05 * truth.max() * (1.0 + swing)
    if 'release' in kinds:
        force = force * np.where(grid % 10.0 // 0.4 == 12.0, 0.4, 1.0)
    return force, truth


def beside(kinds, grid, onset, intensity, generator):
    """Return the force (10 N is that of the muscle) that no pulse causes."""
    force = np.zeros(len(grid))
    if 'effort' in kinds:
        # the patient tenses with what is felt, half a second late
        felt = np.interp(grid - 0.5, onset, intensity)
        force += np.convolve(felt, np.full(500, 1.0 / 500), 'same')
    if 'heart' in kinds:
        force += 0.2 * np.sin(2.0 * np.pi * 1.1 * grid) + 0.3 * np.sin(2.0 * np.pi * 0.23 * grid)
    if 'hum' in kinds:
        force += 0.1 * np.sin(2.0 * np.pi * 50.0 * grid) + 0.1 * coloured(generator, len(grid))
    if 'zeroed' in kinds:
        # the sensor is zeroed, or its strap slips
        force -= generator.uniform(-1.0, 1.0) * (grid > generator.uniform(0.2, 0.8) * grid[-1])
    return force


def sensed(kinds, force):
    """Return what the sensor makes of the force."""
    if 'filter' in kinds:
        return lfilter(*butter(2, 30.0, fs=1e3), force)
    if 'swing' in kinds:
        # limb or sensor at 8 Hz, damped by a fifth
        own = 2.0 * np.pi * 8.0
        return lfilter(*bilinear([own**2], [1.0, 0.4 * own, own**2], 1e3), force)
    return force


def session(muscle, excitation, seed, seconds=SECONDS):
    """Return pulses, force and the true curve."""
    generator = np.random.default_rng([seed, zlib.crc32(muscle.encode())])
    kinds = [muscle] if muscle in RECRUITMENTS else ['arctan', muscle]
    one = person(generator) | {'seconds': seconds}
    return simulated(kinds, excitation, one, generator)


def response(muscle, seed):
    """Return times [s] and the true response to one pulse at full intensity."""
    generator = np.random.default_rng([seed, zlib.crc32(muscle.encode())])
    kinds = [muscle] if muscle in RECRUITMENTS else ['arctan', muscle]
    grid = np.arange(0.0, 0.9, 1e-3)
    one = person(generator)
    force, truth = contraction(kinds, grid, np.zeros(1), np.ones(1), one, generator)
    force = sensed(kinds, force)
    return grid, 10.0 / truth.max() * force


def drawn(seed, muscles):
    """Return a muscle and situations of these, excitation and person of a session."""
    generator = np.random.default_rng([seed, 7])
    one = person(generator) | {
        'seconds': round(generator.uniform(20.0, 80.0)),
        'rate': float(generator.choice([10.0, 15.0, 20.0, 25.0, 30.0])),
        'noise': 10.0 ** generator.uniform(-3.0, -1.7),
    }
    shapes = [one for one in muscles if one in RECRUITMENTS] or ['arctan']
    situations = [one for one in muscles if one in SITUATIONS]
    kinds = [str(generator.choice(shapes))]
    many = min(generator.integers(0, 3), len(situations))
    kinds += generator.choice(situations, many, replace=False).tolist() if many else []
    return kinds, str(generator.choice(EXCITATIONS)), one, generator


def simulated(kinds, excitation, one, generator):
    """Return pulses, force and the true curve of a muscle in some situations."""
    intensity, rate = intensities(excitation, one, generator), one['rate']
    grid = np.arange(0.0, one['seconds'], 1e-3)
    onset = 1e-3 + np.arange(len(intensity)) / rate
    if 'doublets' in kinds:
        onset, intensity = onset[::2], intensity[::2]
        onset = np.column_stack((onset, onset + 8e-3)).ravel()
        intensity = np.repeat(intensity, 2)
    if 'rests' in kinds:
        # the session ends in a pause
        kept = onset % 16.0 < 8.0
        onset, intensity = onset[kept], intensity[kept]
    force, truth = contraction(kinds, grid, onset, intensity, one, generator)
    scale = 10.0 / truth.max()
    force = scale * force + one['noise'] * 10.0 * generator.standard_normal(len(grid))
    force += beside(kinds, grid, onset, intensity, generator)
    force = sensed(kinds, force)
    if 'lost' in kinds:
        kept = generator.uniform(size=len(onset)) > 0.01
        onset, intensity = onset[kept], intensity[kept]
    if 'late' in kinds:
        onset = onset + 0.05
    return (grid, force, onset, intensity), scale * truth


def steady(number, seconds=300.0):
    """Return what disturbs a session, its excitation, person, arrays and true curve."""
    generator = np.random.default_rng([number, 99])
    rate = float(generator.choice([15.0, 20.0, 25.0]))
    one = person(generator) | {'seconds': seconds, 'rate': rate}
    what = ('unheard', 'irregular', 'glitches', 'all')[number % 4]
    excitation = ('random', 'sinusoid', 'staircase')[number // 4 % 3]
    intensity = intensities(excitation, one, generator)
    grid, onset = np.arange(0.0, seconds, 1e-3), 1e-3 + np.arange(len(intensity)) / rate
    if what in ('irregular', 'all'):
        onset = np.sort(onset + 8e-3 * generator.uniform(-1.0, 1.0, len(onset)))
        onset = np.maximum(onset, 1e-3)
    force, truth = contraction(['arctan'], grid, onset, intensity, one, generator)
    scale = 10.0 / truth.max()
    force = scale * force + one['noise'] * 10.0 * generator.standard_normal(len(grid))
    if what in ('glitches', 'all'):
        for _ in range(round(seconds / 20.0)):
            first, lasts = generator.integers(0, len(grid) - 60), generator.integers(1, 50)
            size = generator.choice([-1.0, 1.0]) * generator.uniform(2.0, 30.0)
            even = generator.uniform() < 0.5
            force[first : first + lasts] += size * (1.0 if even else generator.uniform(size=lasts))
    if what in ('unheard', 'all'):
        heard = generator.uniform(size=len(onset)) > 0.01
        onset, intensity = onset[heard], intensity[heard]
    return what, excitation, one, (grid, force, onset, intensity), scale * truth


def watch(chosen):
    """Identify sessions of muscles that do not change; print those in which one is named."""
    named = Counter()
    for number in range(chosen.first, chosen.first + chosen.steady):
        what, excitation, one, arrays, truth = steady(number)
        for name in chosen.estimators:
            found = rpms_ros.from_arrays(*arrays).identify(name, rate_hz=one['rate'])
            last = found.estimates.last
            error = 100.0 * np.abs(last.curve_force - truth).max() / truth.max()
            named[name] += last.changes
            if last.changes:
                words = [found.verdict.grade, *last.doubts]
                print(
                    f'{number:4} {what}, {excitation}, {one["rate"]:.0f} Hz, {name}: '
                    f'{last.changes} named, {last.change_ago} s ago; {error:.2f} %; {words}',
                    flush=True,
                )
    print(f'{chosen.steady / 12.0:.1f} h, changes named: {dict(named)}')


BOUNDS = {'': peers.bound, ' of any shape': peers.free_bound}


def beginning(arrays, seconds):
    """Return so much of pulses and force."""
    grid, force, onset, intensity = arrays
    seen, given = grid < seconds, onset < seconds
    return grid[seen], force[seen], onset[given], intensity[given]


def least(bound, excitation, seed, seconds=SECONDS):
    """Return this bound (101,) of the curve of `arctan`, for a maximum of 1."""
    generator = np.random.default_rng([seed, zlib.crc32(b'arctan')])
    one = person(generator)
    arrays, truth = session('arctan', excitation, seed)
    grid, _, onset, intensity = beginning(arrays, seconds)
    gain = truth.max() / (RATE * arctan(U, one).max())
    alphas = math.log(one['a_thr']), math.log(one['a_sat'])
    twitch = math.log(one['time_constant']), one['latency']
    known = np.array([one['thr'], one['sat'], *alphas, *twitch, gain, 0.0])
    return bound(known, grid, onset, intensity, NOISE * 10.0) / truth.max()


PEERS = {'scipy': peers.by_scipy, 'polynomial': peers.by_polynomial, 'ekf': peers.by_ekf}


def identified(name, arrays, truth, rate=RATE):
    """Return curve, half of its interval, where it holds, verdict, seconds and estimate."""
    begun = time.process_time()
    if name in PEERS:
        curve = PEERS[name](*arrays)
        return curve, math.nan, np.full(len(U), math.nan), [], time.process_time() - begun, None
    found = rpms_ros.from_arrays(*arrays).identify(name, rate_hz=rate)
    spent, last = time.process_time() - begun, found.estimates.last
    held = (last.curve_lower <= truth) & (truth <= last.curve_upper)
    half = (last.curve_upper - last.curve_lower).max() / 2.0
    return last.curve_force, half, held, [found.verdict.grade, *last.doubts], spent, last


def within(name, excitation, seed):
    """Return after how many seconds the curve of `arctan` stays within 1 %."""
    arrays, truth = session('arctan', excitation, seed)
    found = rpms_ros.from_arrays(*beginning(arrays, 12.0)).identify(name, rate_hz=RATE)
    wrong = 0.0
    for one in found.estimates.estimates:
        known = len(one.curve_force) and np.abs(one.curve_force - truth).max() < 0.01 * truth.max()
        wrong = wrong if known else 1e-9 * one.stamp_ns
    return wrong


def begin(chosen):
    """Print how soon a new muscle is known, and when it can be."""
    for excitation, moments in (('random', (5.0,)), ('sinusoid', (4.0, 4.5, 5.0))):
        for name in chosen.estimators:
            after = [within(name, excitation, seed) for seed in range(chosen.seeds)]
            print(f'{excitation:12} {name:10} within 1 % after {np.median(after):.1f} s (median)')
        for seconds in moments:
            said = []
            for which, bound in BOUNDS.items():
                known = [least(bound, excitation, one, seconds) for one in range(chosen.seeds)]
                said.append(f'{which} {100.0 * np.median(np.max(known, axis=1)):.2f} %')
            print(f'{excitation:12} bound after {seconds} s:{",".join(said)}', flush=True)


def without_a_word(words, error, held):
    """Tell whether an error (101,) [%] is large outside its interval, and the verdict good."""
    return words[:1] == ['good'] and bool((error[held == 0] > 2.0).any())


def draw(chosen):
    """Identify drawn sessions; print those that are wrong without a word."""
    print('     muscle and situations, excitation, estimator: error, half of the interval, inside')
    count, alone = Counter(), Counter()
    for seed in range(chosen.first, chosen.first + chosen.drawn):
        for name in chosen.estimators:
            kinds, excitation, one, generator = drawn(seed, chosen.muscles)
            arrays, truth = simulated(kinds, excitation, one, generator)
            curve, half, held, words, *_ = identified(name, arrays, truth, one['rate'])
            error = 100.0 * np.abs(curve - truth) / truth.max()
            silent = without_a_word(words, error, held)
            count.update([(name, words[0]), *[(name, 'silent')] * silent])
            if kinds == ['arctan']:
                alone.update([(name, words[0])])
            if silent or chosen.every:
                print(
                    f'{seed:4} {"+".join(kinds)}, {excitation}, {name}: {error.max():.2f} '
                    f'% +-{100.0 * half / truth.max():.2f}, {held[5:].mean():.2f}; '
                    f'{one["rate"]:.0f} Hz, '
                    f'{one["seconds"]:.0f} s, noise {100.0 * one["noise"]:.2f} %; {words}',
                    flush=True,
                )
    print(dict(count))
    print('arctangents alone:', dict(alone))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--muscles', nargs='+', choices=MUSCLES, default=MUSCLES)
    parser.add_argument('--estimators', nargs='+', default=['batch', 'tracking', 'recursive'])
    usual = {'choices': EXCITATIONS, 'default': ['random', 'sinusoid']}
    parser.add_argument('--excitations', nargs='+', **usual, help='of the table')
    parser.add_argument('--drawn', type=int, default=0, help='how many sessions to draw')
    parser.add_argument('--steady', type=int, default=0, help='how many without a change')
    parser.add_argument('--first', type=int, default=0, help='number of the first such session')
    parser.add_argument('--every', action='store_true', help='print all drawn sessions')
    parser.add_argument('--begin', action='store_true', help='how soon a new muscle is known')
    chosen = parser.parse_args()
    if chosen.drawn or chosen.steady or chosen.begin:
        (begin if chosen.begin else draw if chosen.drawn else watch)(chosen)
        return
    print('muscle       intensities  estimator   error, median / worst   half   coverage   time')
    silent = 0
    for muscle in chosen.muscles:
        for excitation in chosen.excitations:
            for name in chosen.estimators:
                rows, said, off, answers = [], Counter(), [], []
                for seed in range(chosen.seeds):
                    arrays, truth = session(muscle, excitation, seed)
                    curve, half, held, words, spent, last = identified(name, arrays, truth)
                    off.append((curve - truth) / truth.max())
                    error = 100.0 * np.abs(off[-1])
                    inside = held[5:].mean()
                    rows.append((error.max(), 100.0 * half / truth.max(), inside, spent))
                    said.update(words)
                    silent += without_a_word(words, error, held)
                    if last is not None and muscle not in CHANGING:
                        true = np.interp(last.response_time, *response(muscle, seed))
                        gone = 100.0 * np.abs(last.response_force - true) / true.max()
                        right = (last.response_lower <= true) & (true <= last.response_upper)
                        answers.append((gone.max(), right.mean()))
                error, half, held, spent = np.array(rows).T
                line = (
                    f'{muscle:12} {excitation:12} {name:10} {np.median(error):7.3f} / '
                    f'{error.max():7.3f} % {np.median(half):7.3f} {held.mean():8.2f} '
                    f'{np.median(spent):7.1f} s  {dict(said)}'
                )
                if answers:
                    gone, right = np.array(answers).T
                    line += f'  response {gone.max():.2f} % {right.mean():.2f}'
                if muscle == 'arctan':
                    rms = 100.0 * np.sqrt(np.mean(np.square(off)))
                    for which, bound in BOUNDS.items():
                        known = [least(bound, excitation, seed) for seed in range(chosen.seeds)]
                        deviation = 100.0 * np.sqrt(np.mean(np.square(known)))
                        line += f'  bound{which} {deviation:.4f} %, ratio {rms / deviation:.2f}'
                print(line, flush=True)
    print(f'silent: {silent}')


if __name__ == '__main__':
    main()
