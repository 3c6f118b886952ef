# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost of the batch fit of 60 s at 1 kHz, beside scipy's least_squares on the same problem.

`python bench/batch.py`
"""

import time

import numpy as np
from scenarios import SIMULATED, table_4
from scipy.optimize import least_squares

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import RecruitmentParameters, identified_recruitment

MEMORY = 700


def best_of(function, times):
    """Return the least time of some calls [s], and the last result."""
    least = np.inf
    for _ in range(times):
        begun = time.perf_counter()
        result = function()
        least = min(least, time.perf_counter() - begun)
    return least, result


def own(scenario):
    """Fit with the package; return the curve."""
    estimator = BatchEstimator(SIMULATED)
    estimator.add_pulses(scenario.onset_ns, scenario.intensity)
    every = np.ones(len(scenario.stamp_ns), dtype=bool)
    estimator.update(scenario.stamp_ns, scenario.force, every)
    return estimator.estimate(0, {}).curve_force


def with_scipy(scenario):
    """Fit theta by least_squares and w inside by lstsq: one start, no intervals."""
    basis = SIMULATED.basis
    samples = len(scenario.stamp_ns)
    where = np.searchsorted(scenario.stamp_ns, scenario.onset_ns)
    pieces = []
    for onset, first in zip(scenario.onset_ns, where, strict=True):
        part = slice(first, min(first + MEMORY, samples))
        pieces.append((part, basis.evaluate(1e-9 * (scenario.stamp_ns[part] - onset))))

    def regressors(theta):
        rho = identified_recruitment(RecruitmentParameters(*theta), scenario.intensity)
        phi = np.zeros((samples, basis.functions))
        for share, (part, values) in zip(rho, pieces, strict=True):
            phi[part] += share * values
        return phi

    def residual(theta):
        phi = regressors(theta)
        return scenario.force - phi @ np.linalg.lstsq(phi, scenario.force, rcond=None)[0]

    bounds = ([0.0, 0.05, 0.5, 2.0], [1.0, 1.5, 50.0, 15.0])
    fit = least_squares(residual, SIMULATED.start, bounds=bounds, x_scale=[0.1, 0.1, 5.0, 5.0])
    linear = np.linalg.lstsq(regressors(fit.x), scenario.force, rcond=None)[0]
    rho = identified_recruitment(RecruitmentParameters(*fit.x), CURVE_INTENSITY)
    return 20.0 * float(basis.area @ linear) * rho


def compare():
    scenario = table_4(0, 60.0, noise=0.01)
    own(scenario)
    mine, curve = best_of(lambda: own(scenario), 5)
    theirs, other = best_of(lambda: with_scipy(scenario), 1)
    print('60 s at 1 kHz, 7 functions, Table 4 plant, 1 % noise')
    print(
        f'  batch, five starts, intervals   {mine:8.3f} s (goal 0.2)   curve error '
        f'{100 * scenario.curve_error(curve):.3f} %'
    )
    print(
        f'  scipy least_squares, one start  {theirs:8.3f} s              curve error '
        f'{100 * scenario.curve_error(other):.3f} %'
    )


if __name__ == '__main__':
    compare()
