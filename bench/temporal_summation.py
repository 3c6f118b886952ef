# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trains of a rat at 100 Hz: equal pulses, pulses weighted by those before, the history law.

The law is learned on the trains of 4 and 7 pulses; all have a latency, T_a, gain and baseline of
their own.  Beside it what a law could gain that is fitted to the force by its weights, as an
estimator could do on line, with a weak prior and on the same trains; and one weight for each place
in a train, the mean of the gains of all trains of that length.  Needs the recordings of
RPMS_RECORDINGS.

python bench/temporal_summation.py [--every 1]
"""

import argparse
import os
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.trains import analyze_trains, fit_scaled, pulse_twitches
from rpms_ros.identification.model.history_law import PulseHistory, TemporalSummation
from rpms_ros.schema import plain

FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[1] / '../shared/data'))
GATE_VOLTS = 4.0
ORDER = 3
LONGEST = 10
KEEP = 4
# What is fitted, standard deviation of its logarithm and weight of the prior [% of fit].
NUMBERS = ('half_level', 'cooperation', 'facilitation', 'facilitation_decay', 'time_constant')
SPREAD = np.log(3.0)
PRIOR = 0.05
EVALUATIONS = 80


def train_of(path):
    """Return the train in a file, every fourth sample."""
    time, _, gate, force = np.loadtxt(path, delimiter=',', skiprows=1, usecols=range(4)).T
    onset = time[1:][(gate[1:] > GATE_VOLTS) & (gate[:-1] <= GATE_VOLTS)]
    part = np.flatnonzero((time >= onset[0] - 0.05) & (time < onset[-1] + 0.5))[::KEEP]
    usable = np.ones(len(part), dtype=np.bool_)
    return Response(onset - onset[0], time[part] - onset[0], force[part], usable, np.nan, np.nan)


def weighted_fit(train, law):
    """Return the fit [%] of twitches weighted by a law."""
    onset_ns = np.rint(1e9 * train.onset).astype(np.int64)
    return fit_of(train, PulseHistory(law, 20.0).weights(onset_ns, np.ones(len(onset_ns))))


def fit_of(train, weights):
    """Return the fit [%] of twitches with weights (pulses,)."""

    def shape(latency, constant):
        return pulse_twitches(train, ORDER, latency, constant) @ weights

    return fit_scaled(train, shape).fit


def fitted_law(trains, law):
    """Return the law whose weights explain trains best, with a weak prior around `law`."""
    start = np.log([getattr(law, name) for name in NUMBERS])

    def of(numbers):
        return replace(law, **dict(zip(NUMBERS, np.exp(numbers).tolist(), strict=True)))

    def unexplained(numbers):
        rest = np.mean([100.0 - weighted_fit(train, of(numbers)) for train in trains])
        return rest + PRIOR * float(np.sum(((numbers - start) / SPREAD) ** 2))

    simplex = np.vstack((start, start + 0.5 * SPREAD * np.eye(len(start))))
    options = {'maxfev': EVALUATIONS, 'initial_simplex': simplex}
    return of(minimize(unexplained, start, method='Nelder-Mead', options=options).x)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--every', type=int, default=1, help='take every so many trials')
    every = parser.parse_args(argv).every
    paths = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))[::every]
    if not paths:
        print(f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
        return 0
    found = analyze_trains([train_of(path) for path in paths], ORDER)
    numbers = {'order': ORDER, 'time_constant': found.time_constant, 'law': plain(found.law)}
    law = TemporalSummation.of_analysis({'summation': numbers})
    learned = [one.response for one in found.trains if len(one.response.onset) < LONGEST]
    fitted = fitted_law(learned, law)
    by_place = defaultdict(list)
    for one in found.trains:
        by_place[len(one.response.onset)].append(one.gains.gains / one.gains.gains.mean())
    rows = defaultdict(list)
    shares = []
    for one in found.trains:
        train = one.response
        pulses = len(train.onset)
        rows[pulses].append(
            (
                one.equal.fit,
                weighted_fit(train, law),
                weighted_fit(train, fitted),
                fit_of(train, np.mean(by_place[pulses], axis=0)),
                one.law.fit,
            )
        )
        shares.append(one.law.time_constant / one.equal.time_constant)
    print('learned:', law)
    print('by weights:', fitted)
    print(f'T_a with the law, as share of that of equal pulses: {np.mean(shares):.2f}')
    print('mean fit [%]    equal pulses  weighed  fitted  by place  history law')
    for pulses, fits in sorted(rows.items()):
        equal, weighed, by_weights, place, by_law = np.mean(fits, axis=0)
        print(
            f'  {pulses:>2} pulses ({len(fits)})  {equal:10.1f} {weighed:8.1f} {by_weights:7.1f} '
            f'{place:9.1f} {by_law:12.1f}'
        )
    return 0


if __name__ == '__main__':
    sys.exit(main())
