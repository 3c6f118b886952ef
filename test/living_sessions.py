# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions of a muscle, and of one that changes with the truth at every half second."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import Contraction, Subject, simulation_subject
from rpms_ros.muscle.scenario import Scenario, Tremor, VoluntaryEffort
from rpms_ros.muscle.sensor import Disturbances
from rpms_ros.muscle.simulation import Surroundings
from rpms_ros.muscle.time_varying import Change, LivingSettings
from rpms_ros.pulses import PulseTrain

RATE = 20.0
NOTED_S = 0.5
MAXIMUM = 10.0
NOISE = 0.005 * MAXIMUM
SUBJECT = replace(simulation_subject(), latency=9e-3)
MOVED_AT = 40.0


def feed(what, estimator, first_s=-np.inf, last_s=np.inf, cuts=()):
    """Hand a part to an estimator, in blocks cut at these samples; return its predictions."""
    pulses = (what.onset_ns >= 1e9 * first_s) & (what.onset_ns < 1e9 * last_s)
    estimator.add_pulses(what.onset_ns[pulses], what.intensity[pulses])
    first, last = (int(np.clip(1000 * at, 0, len(what.force))) for at in (first_s, last_s))
    usable = np.ones(len(what.force), dtype=np.bool_)
    parts = [
        estimator.update(what.stamp_ns[a:b], what.force[a:b], usable[a:b])
        for a, b in pairwise([first, *cuts, last])
    ]
    return np.concatenate(parts)


def fit(what, estimator, last_s=np.inf):
    """Return the estimate after the first seconds."""
    feed(what, estimator, last_s=last_s)
    return estimator.estimate(int(what.stamp_ns[-1]), {})


def curve_error(what, estimate):
    """Worst error of the curve at the end, relative to its maximum."""
    true = np.atleast_2d(what.curve)[-1]
    return float(np.abs(estimate.curve_force - true).max() / true.max())


class Take(NamedTuple):
    """Pulses and force samples of a muscle."""

    subject: Subject
    onset_ns: np.ndarray
    intensity: np.ndarray
    stamp_ns: np.ndarray
    force: np.ndarray

    feed = feed
    fit = fit
    curve_error = curve_error

    @property
    def curve(self):
        """True steady force [N] (101,)."""
        curve = self.subject.steady_force(CURVE_INTENSITY, RATE)
        return curve - curve[0]


def recorded(seconds, intensity=None, noise=0.0, seed=0, subject=None, silence=0.0):
    """Record a muscle at 1 kHz under random or given intensities, with noise and a rest after."""
    generator = np.random.default_rng(seed)
    drawn = generator.uniform(0.0, 1.0, int(seconds * RATE))
    train = PulseTrain.regular(drawn if intensity is None else intensity, RATE, 1_000)
    muscle = Contraction(subject or simulation_subject())
    muscle.add_pulses(train.onset_ns, train.intensity)
    stamp = np.arange(int((seconds + silence) * 1000), dtype=np.int64) * 1_000_000
    force = muscle.force(stamp)
    force += noise * np.abs(force).max() * generator.standard_normal(len(force))
    return Take(muscle.subject, train.onset_ns, train.intensity, stamp, force)


class Session(NamedTuple):
    """A recording, and the truth at `noted_s` (times,)."""

    onset_ns: np.ndarray
    intensity: np.ndarray
    stamp_ns: np.ndarray
    force: np.ndarray
    noted_s: np.ndarray
    curve: np.ndarray
    gain: np.ndarray
    time_constant: np.ndarray

    feed = feed
    fit = fit
    curve_error = curve_error


def tiring(subject, seconds=90.0):
    """Gain falls towards a half with 60 s, the twitch slows towards 30 % with it."""
    times = np.arange(2.5, seconds + 2.5, 2.5)
    share = 1.0 - np.exp(-times / 60.0)
    return tuple(
        Change(
            at=time - 2.5,
            over=2.5,
            gain=1.0 - 0.5 * part,
            time_constant=subject.time_constant * (1.0 + 0.3 * part),
        )
        for time, part in zip(times, share, strict=True)
    )


def scenario(kind, subject=SUBJECT):
    """Return what happens in a session of a kind."""
    changes = {
        'fatigue': tiring(subject),
        'coil moved': (Change(at=MOVED_AT, threshold=0.56, saturation=1.06, gain=0.8),),
        'gain step': (Change(at=MOVED_AT, gain=0.8),),
        'slower': (Change(at=MOVED_AT, time_constant=1.3 * subject.time_constant),),
    }
    efforts = {
        'bursts': (VoluntaryEffort(at=6.0, peak=2.0, duration=1.5, every=12.0),),
        'tremor': (Tremor(amplitude=0.03 * MAXIMUM, frequency=8.0),),
    }
    return Scenario(
        name=kind,
        living=LivingSettings(changes=changes.get(kind, ())),
        efforts=efforts.get(kind, ()),
        disturbances=Disturbances(noise=NOISE),
    )


def intensities(kind, count, seed):
    """Return random or sinusoidal (period 9 s, random phase) intensities."""
    generator = np.random.default_rng(seed)
    if kind == 'random':
        return generator.uniform(0.0, 1.0, count)
    phase = 0.0 if seed == 0 else generator.uniform(0.0, 2.0 * np.pi)
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / RATE / 9.0 + phase)


@cache
def session(kind, excitation='random', seed=0, seconds=90.0, subject=SUBJECT, rate=1000):
    """Return a session at 20 Hz with 0.5 % noise."""
    what = scenario(kind, subject)
    count = int(seconds * RATE)
    intensity = intensities(excitation, count, seed)
    pulses = PulseTrain.regular(intensity, RATE, 1_000)
    onset = pulses.onset_ns
    muscle = Contraction(subject, settings=what.living)
    surroundings = Surroundings(what, seed)
    stamp = np.arange(int(seconds * rate), dtype=np.int64) * (1_000_000_000 // rate)
    muscle.begin(0)
    surroundings.begin(0)
    done = 0
    forces, truth = [], []
    step = int(NOTED_S * rate)
    for first in range(0, len(stamp), step):
        part = stamp[first : first + step]
        due = int(np.searchsorted(onset, part[-1], side='right'))
        muscle.add_pulses(onset[done:due], intensity[done:due])
        recent = pulses[max(0, done - 1) : due]
        forces.append(surroundings.measured(part, muscle.force(part), recent).force)
        done = due
        last = int(part[-1])
        state, curve = muscle.state(last), muscle.steady_force(last, CURVE_INTENSITY, RATE)
        noted_s = 1e-9 * (last + 1_000_000_000 // rate)
        truth.append((noted_s, curve - curve[0], state.gain, state.time_constant))
    truths = map(np.array, zip(*truth, strict=True))
    return Session(onset, intensity, stamp, np.concatenate(forces), *truths)
