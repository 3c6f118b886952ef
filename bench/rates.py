# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the intervals of rates of change hold the true ones, in short sessions.

`python bench/rates.py [--seeds N] [--seconds S ...]`

A steady muscle and one that tires, 20 pulses a second, noise of 0.05 N, estimator `tracking`.  The
true rate is the mean of the last five seconds, the distance of two knots of the estimator; for how
many of the sessions it lies inside the 95 % interval at the end, and how wide that is.
"""

import argparse

import numpy as np

import rpms_ros

_KNOT = 5.0
_NAMES = ('force_percent', 'time_constant_percent')


def true_rate(session, name, end_ns):
    """Return the mean rate of the last seconds, percent a minute."""
    if session.truth is None:
        return 0.0
    stamps = np.array([end_ns - int(_KNOT * 1e9), end_ns])
    truth = session.truth
    paths = {'force_percent': truth.curve_at(stamps)[-1]}
    paths['time_constant_percent'] = truth.at('time_constant', stamps)
    before, now = paths[name]
    return 6000.0 / _KNOT * (now - before) / now


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--seconds', type=float, nargs='+', default=[20.0, 40.0, 60.0])
    arguments = parser.parse_args()
    print(f'{"muscle, schedule, length":38} {"rate":22} inside  half width  error  true rate')
    for scenario in (None, 'fatigue'):
        for schedule in ('uniform_random', 'sinusoid'):
            for seconds in arguments.seconds:
                judged(scenario, schedule, seconds, arguments.seeds)


def judged(scenario, schedule, seconds, seeds):
    """Print a line for each rate."""
    rows = {name: [] for name in _NAMES}
    for seed in range(1, seeds + 1):
        session = rpms_ros.simulate(
            schedule, duration=seconds, subject='rpms', noise=0.05, scenario=scenario, seed=seed
        )
        last = session.identify('tracking', most_estimates=4).estimates.last
        ends = zip(last.rate_names, last.rate, last.rate_lower, last.rate_upper, strict=True)
        for name, rate, lower, upper in ends:
            if name in rows:
                truth = true_rate(session, name, last.stamp_ns)
                rows[name].append((lower <= truth <= upper, 0.5 * (upper - lower), rate, truth))
    for name, found in rows.items():
        inside, half, rate, truth = np.array(found).T
        label = f'{scenario or "steady"}, {schedule}, {seconds:g} s'
        print(
            f'{label:38} {name:22} '
            f'{int(inside.sum())} of {len(found)}  {np.median(half):6.2f}  '
            f'{np.sqrt(np.mean((rate - truth) ** 2)):6.2f}  {truth.mean():6.1f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
