# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Share of fits from random starts that end at the right minimum.

`python bench/wide_starts.py [draws]`
"""

import sys
from dataclasses import replace

import numpy as np
from scenarios import EXPERIMENTAL, SIMULATED, experiment, table_4

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.horizon import HorizonEstimator
from rpms_ros.muscle import RecruitmentParameters


def main():
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    for kind in (BatchEstimator, HorizonEstimator):
        generator = np.random.default_rng(1)
        errors = []
        for draw in range(draws):
            u_thr = generator.uniform(0.2, 0.7)
            u_sat = generator.uniform(u_thr + 0.1, 1.2)
            start = RecruitmentParameters(u_thr, u_sat, generator.uniform(1.0, 20.0))
            simulated = draw % 2 == 0
            scenario = table_4(draw, 10.0, noise=0.01) if simulated else experiment(draw, 15.0)
            settings = replace(SIMULATED if simulated else EXPERIMENTAL, start=start)
            estimator = kind(settings)
            estimator.add_pulses(scenario.onset_ns, scenario.intensity)
            every = np.ones(len(scenario.stamp_ns), dtype=bool)
            estimator.update(scenario.stamp_ns, scenario.force, every)
            errors.append(scenario.curve_error(estimator.estimate(0, {}).curve_force))
        right = np.mean(np.array(errors) < 0.01)
        print(
            f'{kind.name:>10}: {100 * right:.1f} % of {draws} starts end within 1 % of the true '
            f'curve (goal 99); worst {100 * max(errors):.2f} %',
            flush=True,
        )


if __name__ == '__main__':
    main()
