# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of simulated muscles, made once."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest

from rpms_ros.identification import CURVE_INTENSITY, Estimate
from rpms_ros.muscle import Contraction, Subject, simulation_subject
from rpms_ros.pulses import FloatArray, ForceTrace, IntArray, PulseTrain

MILLISECOND = 1_000_000
Record = Callable[..., tuple[PulseTrain, ForceTrace]]


@pytest.fixture(scope='session')
def record() -> Record:
    """Force of the simulated subject at 1 kHz for intensities at 20 Hz."""

    def simulate(
        intensity: FloatArray, start_ns: int = 0, sequence: int = 0
    ) -> tuple[PulseTrain, ForceTrace]:
        pulses = PulseTrain.regular(intensity, 20.0, start_ns)
        muscle = Contraction(simulation_subject())
        muscle.add_pulses(pulses.onset_ns, pulses.intensity)
        stamps = start_ns + MILLISECOND * np.arange(50 * len(intensity), dtype=np.int64)
        pulses.sequence[:] = (pulses.sequence + sequence) % 2**32
        return pulses, ForceTrace(stamps, muscle.force(stamps))

    return simulate


class Take(NamedTuple):
    """Pulses and force samples of a muscle."""

    subject: Subject
    onset_ns: IntArray
    intensity: FloatArray
    stamp_ns: IntArray
    force: FloatArray

    @property
    def curve(self) -> FloatArray:
        """True steady force [N] (101,)."""
        curve = self.subject.steady_force(CURVE_INTENSITY, 20.0)
        return curve - curve[0]

    def curve_error(self, estimate: Estimate) -> float:
        """Worst error of the curve, relative to its maximum."""
        return float(np.abs(estimate.curve_force - self.curve).max() / self.curve.max())

    def feed(self, estimator, first_s=-np.inf, last_s=np.inf, block=10**9) -> FloatArray:
        """Hand a part to an estimator, in blocks of samples; return its predictions."""
        pulses = (self.onset_ns >= 1e9 * first_s) & (self.onset_ns < 1e9 * last_s)
        estimator.add_pulses(self.onset_ns[pulses], self.intensity[pulses])
        first, last = (int(np.clip(1000 * at, 0, len(self.force))) for at in (first_s, last_s))
        edges = [*range(first, last, block), last]
        return np.concatenate(
            [
                estimator.update(
                    self.stamp_ns[a:b], self.force[a:b], np.ones(b - a, dtype=np.bool_)
                )
                for a, b in pairwise(edges)
            ]
        )

    def fit(self, estimator, last_s=np.inf) -> Estimate:
        """Return the estimate after the first seconds."""
        self.feed(estimator, last_s=last_s)
        return estimator.estimate(int(self.stamp_ns[-1]), {})


@pytest.fixture(scope='session')
def recorded() -> Callable[..., Take]:
    """Record a muscle at 1 kHz under random or given intensities, with noise and a rest after."""

    def make(
        seconds, intensity=None, noise=0.0, seed=0, subject=None, rate_hz=20.0, silence=0.0
    ) -> Take:
        generator = np.random.default_rng(seed)
        muscle = subject if subject is not None else simulation_subject()
        drawn = generator.uniform(0.0, 1.0, int(seconds * rate_hz))
        train = PulseTrain.regular(drawn if intensity is None else intensity, rate_hz, 1_000)
        contraction = Contraction(muscle)
        contraction.add_pulses(train.onset_ns, train.intensity)
        stamp = MILLISECOND * np.arange(int((seconds + silence) * 1000), dtype=np.int64)
        force = contraction.force(stamp)
        force += noise * np.abs(force).max() * generator.standard_normal(len(force))
        return Take(muscle, train.onset_ns, train.intensity, stamp, force)

    return make


@pytest.fixture(scope='session')
def images() -> Callable[[Sequence[Estimate]], list[list[bytes]]]:
    """Every field of estimates in every bit, the order of faults included."""

    def of(estimates: Sequence[Estimate]) -> list[list[bytes]]:
        return [
            [
                repr(one).encode() if isinstance(one, dict | tuple) else np.asarray(one).tobytes()
                for one in vars(estimate).values()
            ]
            for estimate in estimates
        ]

    return of


@pytest.fixture(scope='session')
def numpy_recursion(module_at) -> ModuleType:
    """The plain version of the recursion, which stands beside the benchmarks."""
    return module_at(Path(__file__).parents[2] / 'bench' / 'numpy_recursion.py')


@pytest.fixture(scope='session')
def living_sessions(beside) -> ModuleType:
    """The module of sessions in the folder of all tests: `session`, `SUBJECT`."""
    return beside('living_sessions')


@pytest.fixture(scope='session')
def league(module_at) -> ModuleType:
    """Muscles of other kinds than the model's: `session`."""
    return module_at(Path(__file__).parents[2] / 'bench' / 'league.py')
