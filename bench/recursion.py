# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost of one update of the recursion: 8 basis functions, pulses at 20 Hz, force at 1 kHz.

In blocks of 1000 samples and as single samples through the Python call, beside the plain NumPy
version of the same equations and beside padasip's RLS with 8 weights, which does a part only: the
linear parameters, with given regressors.  Process time, median of
repetitions.  Import time is that of a fresh interpreter with a warm cache.
"""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import padasip
from numpy_recursion import NumpyRecursion

from rpms_ros.identification import TABLE_4, ModifiedRecursiveLM
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain

SECONDS = 10
REPETITIONS = 5
BLOCK = 1000
PLAIN_SAMPLES = 1000
IMPORT = (
    'import time; start = time.perf_counter(); import rpms_ros.identification; '
    'print(time.perf_counter() - start)'
)


def recording() -> tuple[PulseTrain, ForceTrace]:
    intensity = np.random.default_rng(1).uniform(size=20 * SECONDS)
    pulses = PulseTrain.regular(intensity, 20.0)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = 1_000_000 * np.arange(1000 * SECONDS, dtype=np.int64)
    return pulses, ForceTrace(stamps, muscle.force(stamps))


def microseconds(run: Callable[[], int]) -> float:
    """Median process time of a sample; `run` returns how many it has processed."""
    run()
    costs = []
    for _ in range(REPETITIONS):
        start = time.process_time()
        samples = run()
        costs.append(1e6 * (time.process_time() - start) / samples)
    return statistics.median(costs)


def compiled(pulses: PulseTrain, forces: ForceTrace, block: int) -> Callable[[], int]:
    def run() -> int:
        estimator = ModifiedRecursiveLM(TABLE_4)
        estimator.add_pulses(pulses.onset_ns, pulses.intensity)
        usable = np.ones(block, dtype=np.bool_)
        for start in range(0, len(forces), block):
            part = slice(start, start + block)
            estimator.update(forces.stamp_ns[part], forces.force[part], usable)
        return len(forces)

    return run


def plain(pulses: PulseTrain, forces: ForceTrace) -> Callable[[], int]:
    stamps = forces.stamp_ns[1000 : 1000 + PLAIN_SAMPLES].tolist()
    values = forces.force[1000 : 1000 + PLAIN_SAMPLES].tolist()
    acting = pulses[(pulses.onset_ns > 1_300e6) & (pulses.onset_ns < 1_700e6)]

    def run() -> int:
        recursion = NumpyRecursion(TABLE_4)
        for stamp, value in zip(stamps, values, strict=True):
            recursion.update(stamp, value, acting.onset_ns, acting.intensity)
        return PLAIN_SAMPLES

    return run


def padasip_rls() -> Callable[[], int]:
    regressors = np.random.default_rng(1).normal(size=(PLAIN_SAMPLES, 8))
    force = regressors.sum(axis=1)

    def run() -> int:
        rls = padasip.filters.FilterRLS(n=8, mu=0.99, w='zeros')
        for row, value in zip(regressors, force, strict=True):
            rls.adapt(value, row)
        return PLAIN_SAMPLES

    return run


def import_time() -> float:
    def once() -> float:
        output = subprocess.run(
            [sys.executable, '-c', IMPORT], capture_output=True, text=True, check=True
        )
        return float(output.stdout)

    once()
    return statistics.median(once() for _ in range(3))


def main() -> int:
    pulses, forces = recording()
    blocks = microseconds(compiled(pulses, forces, BLOCK))
    rows = [
        (f'compiled, blocks of {BLOCK}', blocks, 'target 3 us'),
        ('compiled, single samples', microseconds(compiled(pulses, forces, 1)), 'target 60 us'),
        ('plain NumPy, single samples', microseconds(plain(pulses, forces)), 'same equations'),
        ("padasip's RLS, single samples", microseconds(padasip_rls()), 'linear part only'),
    ]
    print('one update, 8 basis functions, 20 Hz')
    for name, cost, remark in rows:
        print(f'  {name:32} {cost:8.2f} us   x {cost / blocks:6.1f}   {remark}')
    print(f'import of rpms_ros.identification   {import_time():.2f} s   target 2 s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
