# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of `tracking` on a muscle that changes.

`python bench/living.py [--seeds 20] [--hours 1] [--excitation sinusoid] [kinds ...]`

Sessions of 90 s at 20 Hz with 0.5 % noise, latency 9 ms, all unknown to the estimator.
Errors are those of the recruitment curve against its maximum, from 15 s on; coverage is the share
of the curve within its 95 % band.
"""

import argparse
import os
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

# the matrices are small: a second thread of the linear algebra only waits, which counts as time
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np

from rpms_ros.identification.estimation.tracking import TrackingEstimator

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from living_sessions import MOVED_AT, SUBJECT, session

KINDS = ('steady', 'fatigue', 'coil moved', 'gain step', 'slower', 'bursts', 'tremor')
DYNAMICS = ((5e-3, None, 3), (24e-3, None, 3), (30e-3, None, 3), (9e-3, 8e-3, 3), (9e-3, 10e-3, 3))
DYNAMICS += ((9e-3, 70e-3, 3), (9e-3, 90e-3, 3), (9e-3, None, 2), (9e-3, None, 4))
EXCITATIONS = ('random', 'sinusoid')
SETTLED = 15.0
RIGHT = {'coil moved': 'thresholds', 'gain step': 'gain', 'slower': 'dynamics'}


class Outcome:
    """Results of an estimator, every half second."""

    def __init__(self, estimator, recording):
        estimator.add_pulses(recording.onset_ns, recording.intensity)
        self.errors, self.held, self.changes, self.rates = [], [], [], []
        half = len(recording.stamp_ns) // len(recording.noted_s)
        started = time.process_time()
        for index in range(len(recording.noted_s)):
            part = slice(index * half, (index + 1) * half)
            every = np.ones(half, dtype=bool)
            estimator.update(recording.stamp_ns[part], recording.force[part], every)
            estimate = estimator.estimate(int(recording.stamp_ns[part][-1]), {})
            curve = recording.curve[index]
            known = estimate.curve_known
            away = estimate.curve_force - curve if known else np.full(len(curve), np.inf)
            self.errors.append(float(np.abs(away).max() / curve.max()))
            if known and len(estimate.curve_upper):
                inside = (estimate.curve_lower <= curve) & (curve <= estimate.curve_upper)
                self.held.append(float(inside[1:].mean()))
            else:
                self.held.append(0.0)
            self.changes.append(estimate.changes)
            self.rates.append(estimate.rate[0] if len(estimate.rate) else 0.0)
        self.cost = (time.process_time() - started) / recording.noted_s[-1]
        self.kinds = estimate.change_kinds
        self.errors, self.held = np.array(self.errors), np.array(self.held)
        self.changes, self.noted_s = np.array(self.changes), recording.noted_s
        # of the last five seconds, a knot, as the estimator states it
        force = np.log(recording.curve[:, -1])
        self.true_rates = 6000.0 * (force[10:] - force[:-10]) / 5.0

    @property
    def late(self):
        """Which estimates count."""
        return self.noted_s > SETTLED

    @property
    def found_after(self):
        """Seconds from the change until it was found, infinite if it was not."""
        found = self.noted_s[(self.changes > 0) & (self.noted_s > MOVED_AT)]
        return found[0] - MOVED_AT if len(found) else np.inf

    @property
    def back_after(self):
        """Seconds from the change until the curve stays within 1 %."""
        after = self.noted_s > MOVED_AT
        wrong = self.noted_s[after][self.errors[after] > 0.01]
        return wrong[-1] + 0.5 - MOVED_AT if len(wrong) else 0.0


def percent(values):
    """Return median and worst in percent."""
    return f'{100 * np.median(values):6.2f} {100 * np.max(values):7.2f}'


def row(name, outcomes):
    worst = [one.errors[one.late].max() for one in outcomes]
    last = [one.errors[-1] for one in outcomes]
    held = np.mean([one.held[one.late].mean() for one in outcomes])
    cost = np.median([one.cost for one in outcomes])
    print(
        f'{name:34} {percent(worst)} {percent(last)} {held:9.2f} {100 * cost:6.1f} %', flush=True
    )


def outcomes_of(kind, excitation, seeds, estimator=TrackingEstimator):
    """Return the outcomes of so many sessions of a kind; none is kept."""
    outcomes = []
    for seed in range(seeds):
        outcomes.append(Outcome(estimator(), session(kind, excitation, seed)))
        session.cache_clear()
    return outcomes


def changing(kind, outcomes):
    """Print when a change was found and its kind."""
    found = np.array([one.found_after for one in outcomes])
    named = [one.kinds[-1:] == (RIGHT[kind],) for one in outcomes]
    back = np.array([one.back_after for one in outcomes])
    print(
        f'    found after {np.median(found):.1f} s, worst {found.max():.1f} s; named right in '
        f'{sum(named)} of {len(named)}; within 1 % after {np.median(back):.1f} s, worst '
        f'{back.max():.1f} s',
        flush=True,
    )


def rates(outcomes):
    """Print the error of the rate of change of the force."""
    away = []
    for one in outcomes:
        stated = np.array(one.rates)[10:]
        away.append(np.abs(stated / one.true_rates - 1.0)[one.late[10:]])
    errors = 100 * np.concatenate(away)
    print(
        f'    rate of change of the force: off by {np.median(errors):.0f} % of it in the median, '
        f'{np.percentile(errors, 90):.0f} % in a tenth of the estimates',
        flush=True,
    )


def unknown_dynamics(excitations, seeds):
    """Print errors in muscles of unknown latency, time constant and order."""
    for latency, constant, order in DYNAMICS:
        constant = SUBJECT.time_constant if constant is None else constant
        subject = replace(SUBJECT, latency=latency, time_constant=constant, order=order)
        for excitation in excitations:
            outcomes = [
                Outcome(TrackingEstimator(), session('steady', excitation, seed, 30.0, subject))
                for seed in range(seeds)
            ]
            session.cache_clear()
            name = f'{1e3 * latency:.0f} ms, T_a {1e3 * constant:.0f} ms, order {order}'
            row(f'{name}, {excitation}', outcomes)


def false_alarms(excitations, length_h):
    """Print how many changes are found in a muscle that does not change, hour by hour."""
    for excitation in excitations:
        alarms, sessions = 0, round(12 * length_h)
        for seed in range(sessions):
            recording = session('steady', excitation, 1000 + seed, 300.0)
            alarms += int(Outcome(TrackingEstimator(), recording).changes[-1])
            session.cache_clear()
            if (seed + 1) % 12 == 0 or seed + 1 == sessions:
                hours = (seed + 1) / 12
                print(f'false alarms in {hours:g} h of {excitation}: {alarms}', flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('kinds', nargs='*', choices=[[], *KINDS, 'dynamics'], default=[])
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument(
        '--hours', type=float, default=0.0, help='of false alarms, each excitation'
    )
    parser.add_argument('--excitation', choices=EXCITATIONS)
    arguments = parser.parse_args()
    kinds = arguments.kinds or [*KINDS, 'dynamics']
    excitations = (arguments.excitation,) if arguments.excitation else EXCITATIONS
    seeds = arguments.seeds
    if arguments.hours:
        false_alarms(excitations, arguments.hours)
    print(f'{seeds} seeds: worst error after 15 s and error at the end [%], median and worst seed')
    print(f'{"":34} {"worst":>14} {"at the end":>14} {"coverage":>9} {"cost":>8}')
    for kind in kinds:
        for excitation in excitations:
            if kind == 'dynamics':
                continue
            outcomes = outcomes_of(kind, excitation, seeds)
            row(f'{kind}, {excitation}', outcomes)
            if kind == 'fatigue':
                rates(outcomes)
            if kind in RIGHT:
                changing(kind, outcomes)
    if 'dynamics' in kinds:
        unknown_dynamics(excitations, seeds)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f'largest memory {used:.0f} MB')


if __name__ == '__main__':
    main()
