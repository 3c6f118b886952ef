# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a known muscle, as arrays."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import PulseTrain


@dataclass(frozen=True)
class Take:
    """Pulses and force samples, and the curve behind them."""

    onset_ns: npt.NDArray[np.int64]
    intensity: npt.NDArray[np.float64]
    stamp_ns: npt.NDArray[np.int64]
    force: npt.NDArray[np.float64]
    curve: npt.NDArray[np.float64]

    def feed(self, estimator, block=None):
        """Run an estimator over it; return its predictions."""
        estimator.add_pulses(self.onset_ns, self.intensity)
        count = len(self.stamp_ns)
        usable = np.ones(count, dtype=bool)
        block = block or count
        parts = [slice(start, start + block) for start in range(0, count, block)]
        return np.concatenate(
            [estimator.update(self.stamp_ns[p], self.force[p], usable[p]) for p in parts]
        )

    def curve_error(self, estimate):
        """Return the worst error of the curve, relative to its maximum."""
        return np.abs(estimate.curve_force - self.curve).max() / self.curve.max()


def record(
    seconds, intensity=None, noise=0.0, seed=0, subject=None, rate_hz=20.0, silence=0.0
) -> Take:
    """Return a recording at 1 kHz of random intensities; `silence` follows the last pulse."""
    generator = np.random.default_rng(seed)
    muscle = subject if subject is not None else simulation_subject()
    count = int(seconds * rate_hz)
    values = generator.uniform(0, 1, count) if intensity is None else np.asarray(intensity)
    train = PulseTrain.regular(values, rate_hz, start_ns=1_000)
    contraction = Contraction(muscle)
    contraction.add_pulses(train.onset_ns, train.intensity)
    stamp = np.arange(int((seconds + silence) * 1000), dtype=np.int64) * 1_000_000
    force = contraction.force(stamp)
    force = force + noise * np.abs(force).max() * generator.standard_normal(len(force))
    curve = muscle.steady_force(CURVE_INTENSITY, 20.0)
    return Take(train.onset_ns, train.intensity, stamp, force, curve - curve[0])


@pytest.fixture(name='record', scope='session')
def record_fixture():
    return record
