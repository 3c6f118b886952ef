# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings that several benchmarks share."""

from typing import NamedTuple

import numpy as np

from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import (
    Contraction,
    IntensityRecruitment,
    RecruitmentParameters,
    Subject,
    simulation_subject,
)

RATE = 20.0
MILLISECOND = 1_000_000
# The simulated plant of the paper has no latency; for people the basis begins 8 ms after a pulse.
SIMULATED = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))
EXPERIMENTAL = ProjectionSettings(start=RecruitmentParameters(0.40, 0.90, 10.0))


class Scenario(NamedTuple):
    """A recording and its true values."""

    subject: Subject
    onset_ns: np.ndarray
    intensity: np.ndarray
    stamp_ns: np.ndarray
    clean: np.ndarray
    force: np.ndarray

    @property
    def curve(self):
        """True K rho(u) [N] (101,)."""
        curve = self.subject.steady_force(CURVE_INTENSITY, RATE)
        return curve - curve[0]

    def curve_error(self, curve):
        """Worst error of a curve, relative to the maximum."""
        return float(np.abs(curve - self.curve).max() / self.curve.max())


def intensities(kind, count, generator):
    """Return random or sinusoidal (period 9 s) intensities."""
    if kind == 'random':
        return generator.uniform(0.0, 1.0, count)
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / RATE / 9.0)


def record(subject, onset_ns, intensity, seconds, noise, generator, rate=1000, drift=None):
    """Return a scenario; noise and drift are shares of the largest force."""
    contraction = Contraction(subject)
    contraction.add_pulses(onset_ns, intensity)
    stamp = np.arange(int(seconds * rate), dtype=np.int64) * (1_000_000_000 // rate)
    clean = contraction.force(stamp)
    largest = np.abs(clean).max()
    force = clean + noise * largest * generator.standard_normal(len(clean))
    if drift is not None:
        force = force + largest * drift(1e-9 * stamp)
    return Scenario(subject, onset_ns, intensity, stamp, clean, force)


def table_4(seed, seconds, kind='random', noise=0.0):
    """Return the paper's simulated identification."""
    generator = np.random.default_rng(seed)
    count = int(seconds * RATE)
    onset = 1_000 + np.arange(count, dtype=np.int64) * 50 * MILLISECOND
    intensity = intensities(kind, count, generator)
    return record(simulation_subject(), onset, intensity, seconds, noise, generator)


def experiment(seed, seconds):
    """Return a recording as in the paper's experiments, with their disturbances."""
    generator = np.random.default_rng(seed)
    count = int(seconds * RATE)
    jitter = generator.uniform(0.0, 0.7 * MILLISECOND, count)
    onset = np.arange(count, dtype=np.int64) * 50 * MILLISECOND + jitter.astype(np.int64)
    shape = IntensityRecruitment(0.65, 0.86, threshold_slope=5.0, saturation_slope=12.0)
    subject = Subject(25e-3, 9e-3, recruitment=shape.normalised())
    phase = generator.uniform(0.0, 2.0 * np.pi)

    def drift(time):
        return 0.01 * np.sin(2.0 * np.pi * time / 60.0 + phase)

    intensity = intensities('sinusoid', count, generator)
    return record(subject, onset, intensity, seconds, 0.005, generator, drift=drift)


def model_force(estimator, scenario):
    """Return the force of the pulses alone (samples,), the model's baseline left out."""
    copy = type(estimator)(estimator.settings)
    copy._predictor.theta[:] = estimator._predictor.theta
    copy._predictor.linear[:] = estimator._predictor.linear
    copy.add_pulses(scenario.onset_ns, scenario.intensity)
    never = np.zeros(len(scenario.stamp_ns), dtype=bool)
    return copy.update(scenario.stamp_ns, scenario.force, never)
