# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Time until the error of the curve stays within 1 %: 20 seeds each.

`python bench/convergence.py [seeds]`
"""

import sys

import numpy as np
from scenarios import EXPERIMENTAL, SIMULATED, experiment, model_force, table_4

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.horizon import HorizonEstimator

SECOND = 1000


def curve_errors(estimator, scenario):
    """Return the curve's error after each second, and the a-priori predictions."""
    estimator.add_pulses(scenario.onset_ns, scenario.intensity)
    errors, predictions = [], []
    for start in range(0, len(scenario.stamp_ns), SECOND):
        part = slice(start, start + SECOND)
        usable = np.ones(len(scenario.stamp_ns[part]), dtype=bool)
        stamp, force = scenario.stamp_ns[part], scenario.force[part]
        predictions.append(estimator.update(stamp, force, usable))
        errors.append(scenario.curve_error(estimator.estimate(0, {}).curve_force))
    return np.array(errors), np.concatenate(predictions)


def right_from(errors, limit):
    """Return the second from which the error stays below the limit."""
    above = np.flatnonzero(errors >= limit)
    return int(above[-1]) + 2 if len(above) else 1


def simulated(seeds):
    print('Table 4, 40 s: second from which the curve stays within 1 % (paper: about 36)')
    print(f'{"intensity":>10} {"noise":>6} {"median":>7} {"worst":>6}  error at 40 s')
    for kind in ('random', 'sinusoid'):
        for noise in (0.0, 0.01):
            outcomes = [
                curve_errors(HorizonEstimator(SIMULATED), table_4(seed, 40.0, kind, noise))[0]
                for seed in range(seeds)
            ]
            when = [right_from(errors, 0.01) for errors in outcomes]
            last = 100 * np.median([errors[-1] for errors in outcomes])
            print(
                f'{kind:>10} {noise:6.2f} {np.median(when):7.1f} {max(when):6d}  {last:.4f} %',
                flush=True,
            )


def noise_free(seeds):
    worst, late = 0.0, 0.0
    for seed in range(seeds):
        scenario = table_4(seed, 40.0, ('random', 'sinusoid')[seed % 2])
        prediction = curve_errors(HorizonEstimator(SIMULATED), scenario)[1]
        error = np.abs(prediction - scenario.force)
        size = np.sqrt(np.mean(scenario.force**2))
        parts = [slice(k, k + 2 * SECOND) for k in range(10_000, 40_000, 2 * SECOND)]
        shares = [float(np.sqrt(np.mean(error[part] ** 2)) / size) for part in parts]
        worst, late = max(worst, *shares), max(late, shares[-1])
    print(f'noise-free output error, worst seed: {100 * worst:.5f} % from 10 s on (goal 0.1),')
    print(f'  {100 * late:.5f} % at the end (goal 0.01)')


def experimental(seeds):
    print('Like the experiments, latency 9 ms, noise, drift, pulses off the grid: from 15 s on')
    for kind in (BatchEstimator, HorizonEstimator):
        curves, forces = [], []
        for seed in range(seeds):
            for seconds in (15.0, 25.0, 35.0):
                scenario = experiment(seed, seconds)
                estimator = kind(EXPERIMENTAL)
                estimator.add_pulses(scenario.onset_ns, scenario.intensity)
                every = np.ones(len(scenario.stamp_ns), dtype=bool)
                estimator.update(scenario.stamp_ns, scenario.force, every)
                curve = estimator.estimate(0, {}).curve_force
                curves.append(scenario.curve_error(curve))
                error = model_force(estimator, scenario) - scenario.clean
                forces.append(np.linalg.norm(error) / np.linalg.norm(scenario.clean))
        print(
            f'{kind.name:>10}  force median {100 * np.median(forces):.3f} %, '
            f'worst {100 * max(forces):.3f} % (goal 0.3); curve median '
            f'{100 * np.median(curves):.3f} %, worst {100 * max(curves):.3f} % (goal 0.5)',
            flush=True,
        )


def main():
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    simulated(seeds)
    noise_free(seeds)
    experimental(seeds)


if __name__ == '__main__':
    main()
