# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost of the horizon estimator at 1 kHz with a 20 s horizon, beside other libraries.

`python bench/horizon.py [--hour]`; with --hour also the memory over a simulated hour.
"""

import resource
import sys
import time

import filterpy.kalman
import numpy as np
import padasip
from batch import compare
from scenarios import SIMULATED, table_4

from rpms_ros.identification.estimation.horizon import HorizonEstimator
from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import RecruitmentParameters, identified_recruitment
from rpms_ros.muscle.recruitment import identified_recruitment_with_gradient

BLOCK = 20
SECONDS = 40
FUNCTIONS = SIMULATED.basis.functions


def own(scenario, first, last):
    """Return processor time of samples first..last-1 [s], the horizon full, and the curve."""
    estimator = HorizonEstimator(SIMULATED)
    estimator.add_pulses(scenario.onset_ns, scenario.intensity)
    usable = np.ones(BLOCK, dtype=bool)
    begun = 0.0
    for start in range(0, last, BLOCK):
        if start == first:
            begun = time.process_time()
        part = slice(start, start + BLOCK)
        estimator.update(scenario.stamp_ns[part], scenario.force[part], usable)
        if start % 100 == 0:
            estimate = estimator.estimate(0, {})
    return time.process_time() - begun, estimate.curve_force


def features(scenario, theta):
    """Return regressors and their derivatives (samples, functions, 1 + 4)."""
    rho, slopes = identified_recruitment_with_gradient(
        RecruitmentParameters(*theta), scenario.intensity
    )
    weights = np.column_stack((rho, slopes))
    total = np.zeros((len(scenario.stamp_ns), FUNCTIONS, 5))
    where = np.searchsorted(scenario.stamp_ns, scenario.onset_ns)
    for onset, first, weight in zip(scenario.onset_ns, where, weights, strict=True):
        part = slice(first, first + 700)
        values = SIMULATED.basis.evaluate(1e-9 * (scenario.stamp_ns[part] - onset))
        total[part] += values[:, :, None] * weight
    return total


class JointFilter:
    """Extended Kalman filter over [theta, w] as a random walk, relinearised at every sample."""

    def __init__(self, noise):
        self.theta = np.array(SIMULATED.start)
        self.linear = np.zeros(FUNCTIONS)
        deviation = np.concatenate(([0.2, 0.2, 4.0, 1.5], np.full(FUNCTIONS, 10.0)))
        self.covariance = np.diag(deviation**2)
        self.noise = noise

    def step(self, values, intensity, force):
        """Take one sample; `values` (pulses, functions) are the basis at the lags."""
        rho, slopes = identified_recruitment_with_gradient(
            RecruitmentParameters(*self.theta), intensity
        )
        phi = rho @ values
        gradient = np.concatenate((slopes.T @ (values @ self.linear), phi))
        spread = self.covariance @ gradient
        gain = spread / (gradient @ spread + self.noise)
        error = force - phi @ self.linear
        self.theta = np.clip(
            self.theta + gain[:4] * error, [0.0, 0.1, 0.5, 2.0], [0.95, 1.5, 50.0, 15.0]
        )
        self.linear += gain[4:] * error
        self.covariance -= np.outer(gain, spread)


def joint_filter(scenario, samples):
    """Return processor time [s] and the curve of the joint filter over some samples."""
    state = JointFilter(float(np.var(scenario.force - scenario.clean)))
    spent = 0.0
    for index in range(samples):
        stamp = scenario.stamp_ns[index]
        first, last = np.searchsorted(scenario.onset_ns, [stamp - 700_000_000, stamp])
        if first == last:
            continue
        begun = time.process_time()
        values = SIMULATED.basis.evaluate(1e-9 * (stamp - scenario.onset_ns[first:last]))
        state.step(values, scenario.intensity[first:last], scenario.force[index])
        spent += time.process_time() - begun
    rho = identified_recruitment(RecruitmentParameters(*state.theta), CURVE_INTENSITY)
    return spent, 20.0 * float(SIMULATED.basis.area @ state.linear) * rho


def linear_parts(scenario, samples):
    """Print what libraries need for the linear unknowns alone, theta given."""
    phi = features(scenario, (0.48, 0.98, 4.0, 6.0))[:samples, :, 0].copy()
    begun = time.process_time()
    adaptive = padasip.filters.FilterRLS(n=FUNCTIONS, mu=0.9999)
    adaptive.run(scenario.force[:samples], phi)
    spent = time.process_time() - begun
    print(f'  padasip RLS, w only, theta and regressors given   {_share(spent, samples)}')
    kalman = filterpy.kalman.KalmanFilter(dim_x=FUNCTIONS, dim_z=1)
    kalman.P *= 1e4
    kalman.R *= float(np.var(scenario.force - scenario.clean))
    begun = time.process_time()
    for index in range(samples):
        kalman.update(scenario.force[index], H=phi[index : index + 1])
    spent = time.process_time() - begun
    print(f'  filterpy Kalman filter, w only, likewise          {_share(spent, samples)}')


def _share(spent, samples):
    return f'{100 * spent / (samples * 1e-3):7.2f} % of a core'


def memory_over_an_hour():
    """Print the resident memory after each quarter of a simulated hour."""
    scenario = table_4(1, 60.0, noise=0.01)
    estimator = HorizonEstimator(SIMULATED)
    usable = np.ones(len(scenario.stamp_ns), dtype=bool)
    for minute in range(60):
        later = minute * 60_000_000_000
        estimator.add_pulses(scenario.onset_ns + later, scenario.intensity)
        estimator.update(scenario.stamp_ns + later, scenario.force, usable)
        estimator.estimate(0, {})
        if minute % 15 == 14:
            kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print(f'  {minute + 1} min: {kilobytes / 1024:.1f} MB at most so far', flush=True)


def main():
    scenario = table_4(0, float(SECONDS), noise=0.01)
    own(scenario, 0, 2_000)
    first, last = 24_000, SECONDS * 1000
    spent, curve = own(scenario, first, last)
    print('on line at 1 kHz, 20 s horizon full, blocks of 20 samples, 10 estimates a second')
    print(
        f'  horizon, intervals and physiology included        {_share(spent, last - first)} '
        f'(goal 5)   curve error {100 * scenario.curve_error(curve):.3f} %'
    )
    spent, curve = joint_filter(scenario, 10_000)
    print(
        f'  joint extended Kalman filter in NumPy, 10 s       {_share(spent, 10_000)}'
        f'            curve error {100 * scenario.curve_error(curve):.3f} %'
    )
    linear_parts(scenario, 10_000)
    compare()
    if '--hour' in sys.argv:
        memory_over_an_hour()


if __name__ == '__main__':
    main()
