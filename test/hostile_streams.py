# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Streams that are not what they seem, for the tests and `bench/hostile_streams.py`.

Each kind spoils the session of one muscle, some with the help of another one's.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rpms_ros.identification import Estimate
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import FloatArray, ForceTrace, IntArray, PulseTrain

MILLISECOND = 1_000_000
SECOND = 1000 * MILLISECOND
RATE_HZ = 20.0
SAMPLES_A_PULSE = 50
NOISE = 0.02
# Of the height of the curve: what is nearer to the truth is not wrong.
WRONG = 0.05


class Stream(NamedTuple):
    """Pulses, force, and how many samples came before each pulse if that is not as it should."""

    pulses: PulseTrain
    forces: ForceTrace
    before: IntArray | None = None


Spoil = Callable[[Stream, Stream], Stream]
# That of the simulations answers at once, which is a misfit of its own.
SUBJECT = replace(simulation_subject(), latency=9e-3)


class Kind(NamedTuple):
    """How a stream is spoilt, and a fault that has to be named."""

    spoil: Spoil
    fault: str


def session(seed: int, seconds: int, share: float = 1.0) -> Stream:
    """Random pulses at 20 Hz into the simulated subject, and its force with noise at 1 kHz."""
    random = np.random.default_rng(seed)
    pulses = PulseTrain.regular(random.uniform(size=int(RATE_HZ) * seconds), RATE_HZ, 0)
    muscle = Contraction(SUBJECT)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = MILLISECOND * np.arange(SAMPLES_A_PULSE * len(pulses), dtype=np.int64)
    noise = NOISE * random.standard_normal(len(stamps))
    return Stream(pulses, ForceTrace(stamps, share * muscle.force(stamps) + noise))


def true_curve(intensity: FloatArray) -> FloatArray:
    """Steady force [N] of the subject at intensities (intensities,)."""
    return Contraction(SUBJECT).steady_force(0, intensity, RATE_HZ)


def wrong_by(found: Estimate, truth: FloatArray) -> float:
    """Return how far the curve is from the truth where its interval excludes it.

    A share of the height of the true curve; 0 where the interval has the truth, or no curve is
    stated.
    """
    if not found.curve_known:
        return 0.0
    away = np.abs(found.curve_force - truth)
    if len(found.curve_lower):
        away = away[(truth < found.curve_lower) | (truth > found.curve_upper)]
    return float(away.max(initial=0.0) / truth.max())


def merged(first: ForceTrace, second: ForceTrace) -> ForceTrace:
    """Both traces in the order of their stamps, the first before the second of equal ones."""
    stamps = np.concatenate((first.stamp_ns, second.stamp_ns))
    order = np.argsort(stamps, kind='stable')
    return ForceTrace(stamps[order], np.concatenate((first.force, second.force))[order])


def beside(late_ns: int, share: float = 1.0, step: int = 1) -> Spoil:
    """A share of every so many samples of the other sensor, so much later."""

    def spoil(own: Stream, other: Stream) -> Stream:
        stamps, force = other.forces.stamp_ns[::step], other.forces.force[::step]
        return own._replace(forces=merged(own.forces, ForceTrace(stamps + late_ns, share * force)))

    return spoil


def in_bursts(own: Stream, other: Stream) -> Stream:
    """Each of two sensors sends twenty samples at a time."""
    both = (own.forces, other.forces)
    stamps = np.stack([trace.stamp_ns.reshape(-1, 20) for trace in both], axis=1)
    forces = np.stack([trace.force.reshape(-1, 20) for trace in both], axis=1)
    return own._replace(forces=ForceTrace(stamps.ravel(), forces.ravel()))


def put(place: int | slice, value: float) -> Spoil:
    def spoil(own: Stream, _: Stream) -> Stream:
        own.forces.force[place] = value
        return own

    return spoil


def knocked(own: Stream, _: Stream) -> Stream:
    own.forces.force[15_000:15_100] += 300.0
    return own


def clipped(own: Stream, _: Stream) -> Stream:
    np.minimum(own.forces.force, 0.6 * own.forces.force.max(), out=own.forces.force)
    return own


def clipped_from_the_start(own: Stream, _: Stream) -> Stream:
    """The recording begins while the force is at the end of the range."""
    most = 0.6 * own.forces.force.max()
    force = np.minimum(own.forces.force, most)
    after = np.flatnonzero(own.pulses.intensity > 0.9) * SAMPLES_A_PULSE
    begin = next(place + 40 for place in after.tolist() if force[place + 40] == most)
    kept = own.pulses.onset_ns >= begin * MILLISECOND
    return Stream(own.pulses[kept], ForceTrace(own.forces.stamp_ns[begin:], force[begin:]))


def clipped_below(own: Stream, other: Stream) -> Stream:
    """A sensor mounted the other way round, at the lower end of its range."""
    np.negative(clipped(own, other).forces.force, out=own.forces.force)
    return own


def frozen(own: Stream, _: Stream) -> Stream:
    own.forces.force[10_000:18_000] = own.forces.force[10_000]
    return own


def pulses_of_two(
    own: Stream, other: Stream, late_ns: int, sequence: int, step: int
) -> PulseTrain:
    """Those of the session, and every so many of the other one, later and numbered otherwise."""
    train = other.pulses
    onset_ns, sequences = train.onset_ns + late_ns, train.sequence + sequence
    others = PulseTrain(onset_ns, train.intensity, sequences, train.width)
    return PulseTrain.joined([own.pulses, others[::step]])


def forged_far_ahead(own: Stream, other: Stream) -> Stream:
    before = np.tile(SAMPLES_A_PULSE * np.arange(len(own.pulses), dtype=np.int64), 2)
    return Stream(pulses_of_two(own, other, 10**18, 0, 1), own.forces, before)


def second_driver(sequence: int, step: int = 1) -> Spoil:
    """Somebody else's pulses, every so many of them, with numbers of their own."""

    def spoil(own: Stream, other: Stream) -> Stream:
        both = pulses_of_two(own, other, 23 * MILLISECOND, sequence, step)
        return own._replace(pulses=both[np.argsort(both.onset_ns)])

    return spoil


def pulses_lost(own: Stream, _: Stream) -> Stream:
    kept = np.random.default_rng(5).uniform(size=len(own.pulses)) > 0.3
    return own._replace(pulses=own.pulses[kept])


def intensity_out_of_range(own: Stream, _: Stream) -> Stream:
    own.pulses.intensity[::9] = 55.0
    return own


def rearranged(places_of: Callable[[IntArray], IntArray]) -> Spoil:
    """Samples of other places, out of those of all (samples,)."""

    def spoil(own: Stream, _: Stream) -> Stream:
        stamps, force = own.forces.stamp_ns, own.forces.force
        places = places_of(np.arange(len(stamps)))
        return own._replace(forces=ForceTrace(stamps[places], force[places]))

    return spoil


def without_five_seconds(places: IntArray) -> IntArray:
    return np.delete(places, slice(10_000, 15_000))


def doubled(places: IntArray) -> IntArray:
    return np.repeat(places, 2)


def out_of_order(places: IntArray) -> IntArray:
    """Blocks of ten samples change places."""
    return places.reshape(-1, 2, 10)[:, ::-1].ravel()


def clock_set(by_ns: int) -> Spoil:
    """Both clocks are set in the middle."""

    def spoil(own: Stream, _: Stream) -> Stream:
        middle = len(own.forces) // 2
        before = SAMPLES_A_PULSE * np.arange(len(own.pulses), dtype=np.int64)
        own.forces.stamp_ns[middle:] += by_ns
        own.pulses.onset_ns[before >= middle] += by_ns
        return own._replace(before=before)

    return spoil


KINDS: dict[str, Kind] = {
    'two sensors with the same stamps': Kind(beside(0), 'force_conflict'),
    'two sensors in turn': Kind(beside(300_000), 'force_alternating'),
    'a dead sensor beside': Kind(beside(300_000, 0.0), 'force_alternating'),
    'a slow sensor beside': Kind(beside(300_000, step=7), 'force_spike'),
    'two sensors in bursts': Kind(in_bursts, 'force_stamp_not_after_last'),
    'a sample of 1e6 N': Kind(put(15_030, 1e6), 'force_out_of_bounds'),
    'a sample of 1e300 N': Kind(put(15_030, 1e300), 'force_out_of_bounds'),
    'a sample of -900 N': Kind(put(15_030, -900.0), 'force_spike'),
    'a spike every half second': Kind(put(slice(30, None, 500), 500.0), 'force_spike'),
    'a knock': Kind(knocked, 'force_unexplained'),
    'a clipped sensor': Kind(clipped, 'force_clipped'),
    'a sensor clipped at the start': Kind(clipped_from_the_start, 'force_clipped'),
    'a sensor clipped below': Kind(clipped_below, 'force_clipped'),
    'a frozen sensor': Kind(frozen, 'force_frozen'),
    'a dead sensor': Kind(put(slice(None), 0.0), 'force_constant'),
    'every sample twice': Kind(rearranged(doubled), 'force_duplicate'),
    'samples out of order': Kind(rearranged(out_of_order), 'force_stamp_not_after_last'),
    'no numbers': Kind(put(slice(10_000, 14_000), np.nan), 'force_not_finite'),
    'a gap': Kind(rearranged(without_five_seconds), 'force_gap'),
    'a clock set back': Kind(clock_set(-8 * SECOND), 'clock_jump'),
    'a clock set ahead': Kind(clock_set(3600 * SECOND), 'force_gap'),
    'two drivers': Kind(second_driver(5000), 'pulse_sequence_restart'),
    'forged pulses': Kind(second_driver(10**6, int(RATE_HZ)), 'pulse_sequence_restart'),
    'pulses far ahead': Kind(forged_far_ahead, 'pulse_far_ahead'),
    'pulses lost': Kind(pulses_lost, 'pulse_lost'),
    'intensities beyond 1': Kind(intensity_out_of_range, 'pulse_intensity_invalid'),
}
"""What is done to a stream, by its name."""
