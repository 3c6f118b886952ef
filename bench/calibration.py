# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals contain the truth, and how wide they are: 200 sessions of 15 s.

`python bench/calibration.py [sessions]`

`recursive` and `batch`, which finds latency and time constant of its functions itself, on people
drawn at random.
"""

import sys

import numpy as np
from scenarios import MILLISECOND, RATE, intensities, record

from rpms_ros.identification import estimator_by_name
from rpms_ros.muscle import random_subject, twitch

SECONDS = 15.0


def session(seed, name):
    """Return which truths lie in their interval: parameters, curve, response, physiology.

    The last are the standard deviations of physiology that the estimate states.
    """
    generator = np.random.default_rng(seed)
    count = int(SECONDS * RATE)
    onset = 1_000 + np.arange(count, dtype=np.int64) * 50 * MILLISECOND
    intensity = intensities(('random', 'sinusoid')[seed % 2], count, generator)
    muscle = random_subject(generator)
    scenario = record(muscle, onset, intensity, SECONDS, 0.01, generator)
    estimator = estimator_by_name(name)
    estimator.add_pulses(onset, intensity)
    estimator.update(scenario.stamp_ns, scenario.force, np.ones(len(scenario.force), dtype=bool))
    estimate = estimator.estimate(0, {})
    shape = muscle.recruitment
    theta = [shape.threshold, shape.saturation, shape.saturation_slope, shape.threshold_slope]
    width = 1.96 * np.sqrt(np.diag(estimate.nonlinear_covariance))
    rise = muscle.pulse_weight(1.0, RATE) - muscle.pulse_weight(0.0, RATE)
    response = rise * twitch(estimate.response_time - muscle.latency, muscle.time_constant)
    later = estimate.response_time > muscle.latency
    twitch_truth = np.array([muscle.time_constant, muscle.latency, 3.0, rise])
    return (
        np.abs(estimate.nonlinear - theta) <= width,
        _held(estimate.curve_lower, scenario.curve, estimate.curve_upper)[5:].mean(),
        _held(estimate.response_lower, response, estimate.response_upper)[later].mean(),
        _held(estimate.physiology_lower, twitch_truth, estimate.physiology_upper),
        (estimate.physiology_upper - estimate.physiology_lower) / (2.0 * 1.96),
    )


def _held(lower, truth, upper):
    return (lower <= truth) & (truth <= upper)


def main():
    sessions = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print('share of 95 % intervals that hold the truth (goal 0.90 to 0.99)')
    print('             u_thr u_sat a_sat a_thr  curve response   T_a latency order peak')
    for name in ('recursive', 'batch', 'tracking'):
        outcomes = [session(seed, name) for seed in range(sessions)]
        columns = list(zip(*outcomes, strict=True))
        theta, curve, response, physiology = (np.mean(column, axis=0) for column in columns[:4])
        constant, _, order, _ = np.median(columns[4], axis=0)
        shares = ' '.join(f'{share:5.2f}' for share in theta)
        numbers = ' '.join(f'{share:5.2f}' for share in physiology)
        print(f'{name:>11}  {shares}  {curve:5.2f} {response:8.2f}  {numbers}')
        print(
            f'{"":13}standard deviation, median session: T_a {1e3 * constant:.1f} ms, '
            f'order {order:.2f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
