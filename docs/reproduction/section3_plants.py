# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Plants of Sec. 3 as they are simulated here, and a run of an estimator over one of them."""

from typing import NamedTuple

import numpy as np

from rpms_ros.identification import CURVE_INTENSITY
from rpms_ros.muscle import (
    Contraction,
    IntensityRecruitment,
    RecruitmentParameters,
    Subject,
    identified_recruitment,
    simulation_subject,
)

RATE = 20.0
STEP = 200

# Table 6 as printed: u_thr, u_sat, alpha_sat of two subjects, two coil positions, two takes.
TABLE_6 = {
    'S1 P1': ((0.657, 0.855, 13.9), (0.647, 0.869, 13.7)),
    'S1 P2': ((0.647, 0.875, 16.2), (0.688, 0.875, 10.7)),
    'S2 P1': ((0.637, 0.817, 8.7), (0.662, 0.874, 3.8)),
    'S2 P2': ((0.672, 0.839, 10.4), (0.648, 0.931, 13.2)),
}
# T_a that eta = 45 suits, latency, largest force: what the paper does not print of its subjects.
PEOPLE = {'S1': (24e-3, 9.0e-3, 12.0), 'S2': (27e-3, 10.0e-3, 8.0)}


class Plant(NamedTuple):
    """A simulated session."""

    subject: Subject
    onset_ns: np.ndarray
    intensity: np.ndarray
    stamp_ns: np.ndarray
    clean: np.ndarray
    force: np.ndarray

    @property
    def curve(self):
        """True K rho(u) at 20 Hz [N] (101,)."""
        curve = self.subject.steady_force(CURVE_INTENSITY, RATE)
        return curve - curve[0]


class Path(NamedTuple):
    """What an estimator did with a plant."""

    time: np.ndarray
    theta: np.ndarray
    curve_error: np.ndarray
    prediction: np.ndarray
    last: object


def plant(subject, seconds, kind, seed, noise=0.0, drift=0.0, jitter=0.0):
    """Return a session at 1 kHz; noise and drift are shares of the largest force."""
    generator = np.random.default_rng(seed)
    count = int(seconds * RATE)
    time = np.arange(count) / RATE
    intensity = (
        generator.uniform(0.0, 1.0, count)
        if kind == 'random'
        else 0.5 - 0.5 * np.cos(2.0 * np.pi * time / 9.0)
    )
    onset = np.rint(1e9 * (time + generator.uniform(0.0, 1.0, count) * jitter)).astype(np.int64)
    contraction = Contraction(subject)
    contraction.add_pulses(onset, intensity)
    stamp = np.arange(int(1000 * seconds), dtype=np.int64) * 1_000_000
    clean = contraction.force(stamp)
    largest = clean.max()
    slow = np.sin(2.0 * np.pi * 1e-9 * stamp / 60.0 + generator.uniform(0.0, 2.0 * np.pi))
    force = clean + largest * (noise * generator.standard_normal(len(clean)) + drift * slow)
    return Plant(subject, onset, intensity, stamp, clean, force)


def simulated(kind, seed, seconds=90.0):
    """Return the plant of Sec. 3.3.3."""
    return plant(simulation_subject(), seconds, kind, seed)


def in_silico(name, take, seconds=90.0):
    """Return a session like those of Sec. 3.3.4, with all that the model leaves out."""
    u_thr, u_sat, alpha_sat = TABLE_6[name][0]
    time_constant, latency, largest = PEOPLE[name[:2]]
    shape = IntensityRecruitment(u_thr, u_sat, threshold_slope=5.0, saturation_slope=alpha_sat)
    subject = Subject(time_constant, latency, 3, shape.normalised(), maximum_force=largest)
    seed = 10 * sorted(TABLE_6).index(name) + take
    return plant(subject, seconds, 'sinusoid', seed, noise=0.005, drift=0.01, jitter=0.7e-3)


def run(estimator, session):
    """Feed a session in steps of 0.2 s and note what the estimator knows."""
    estimator.add_pulses(session.onset_ns, session.intensity)
    time, theta, errors, predictions = [], [], [], []
    for start in range(0, len(session.stamp_ns), STEP):
        part = slice(start, start + STEP)
        every = np.ones(len(session.stamp_ns[part]), dtype=bool)
        predictions.append(estimator.update(session.stamp_ns[part], session.force[part], every))
        estimate = estimator.estimate(int(session.stamp_ns[part][-1]), {})
        curve = estimate.curve_force if estimate.curve_known else np.zeros(len(session.curve))
        time.append(1e-9 * session.stamp_ns[part][-1])
        theta.append(np.array(estimator.parameters))
        errors.append(np.abs(curve - session.curve).max() / session.curve.max())
    return Path(
        np.array(time),
        np.array(theta),
        np.array(errors),
        np.concatenate(predictions),
        estimator.estimate(0, {}),
    )


def right_from(path, limit):
    """Return the time from which the curve stays within the limit [s], or nan."""
    above = np.flatnonzero(path.curve_error >= limit)
    if not len(above):
        return float(path.time[0])
    return float(path.time[above[-1] + 1]) if above[-1] + 1 < len(path.time) else float('nan')


def output_error(path, session, first):
    """Return the relative a-priori output error from a time on [s], L2."""
    late = slice(int(1000 * first), None)
    error = np.linalg.norm(path.prediction[late] - session.force[late])
    return float(error / np.linalg.norm(session.force[late]))


def steady_curve(parameters, gain):
    """Return gain times rho(u) (101,)."""
    return gain * identified_recruitment(RecruitmentParameters(*parameters), CURVE_INTENSITY)
