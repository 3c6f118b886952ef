# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated people for the recursion."""

from typing import NamedTuple

import numpy as np
import pytest

from rpms_ros.identification import CURVE_INTENSITY, FixedSizeRecursion
from rpms_ros.muscle import Contraction, Subject, average_subject
from rpms_ros.pulses import FloatArray, IntArray

RATE = 20.0


class Session(NamedTuple):
    """A noisy session of a muscle that may become another one."""

    subject: Subject
    onset_ns: IntArray
    intensity: FloatArray
    stamp_ns: IntArray
    force: FloatArray

    @property
    def curve(self) -> FloatArray:
        """True steady force [N] (101,)."""
        curve = self.subject.steady_force(CURVE_INTENSITY, RATE)
        return curve - curve[0]

    def error(self, curve: FloatArray) -> float:
        """Largest error of a curve, relative to the maximum."""
        return float(np.abs(curve - self.curve).max() / self.curve.max())

    def until(self, estimator: FixedSizeRecursion, first_s: float, last_s: float) -> FloatArray:
        """Feed an estimator; return the predictions."""
        part = slice(int(1000 * first_s), int(1000 * last_s))
        pulses = (self.onset_ns >= 1e9 * first_s) & (self.onset_ns < 1e9 * last_s)
        estimator.add_pulses(self.onset_ns[pulses], self.intensity[pulses])
        usable = np.ones(len(self.stamp_ns[part]), dtype=np.bool_)
        return estimator.update(self.stamp_ns[part], self.force[part], usable)


@pytest.fixture(scope='session')
def session():
    """Make a session: seed, period (None: random), seconds, noise, muscle, when pulses end."""

    def make(
        seed: int = 1,
        period: float | None = None,
        seconds: float = 20.0,
        noise: float = 0.01,
        subject: Subject | None = None,
        rest_from: float = np.inf,
    ) -> Session:
        generator = np.random.default_rng(seed)
        count = int(seconds * RATE)
        onset = 1_000 + np.arange(count, dtype=np.int64) * 50_000_000
        intensity = generator.uniform(0.0, 1.0, count)
        if period is not None:
            intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / RATE / period)
        intensity[onset > 1e9 * rest_from] = 0.0
        muscle = subject if subject is not None else average_subject()
        contraction = Contraction(muscle)
        contraction.add_pulses(onset, intensity)
        stamp = np.arange(int(seconds * 1000), dtype=np.int64) * 1_000_000
        force = contraction.force(stamp)
        force = force + noise * np.abs(force).max() * generator.standard_normal(len(force))
        return Session(muscle, onset, intensity, stamp, force)

    return make
