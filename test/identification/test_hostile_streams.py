# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Streams that are not what they seem: a right curve, or an estimate that says it is in doubt."""

from collections.abc import Callable

import numpy as np
import pytest

from rpms_ros.identification import Estimate
from rpms_ros.identification import estimator_by_name
from rpms_ros.identification import identify
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

MILLISECOND = 1_000_000
SECONDS = 25
Stream = tuple[PulseTrain, ForceTrace] | tuple[PulseTrain, ForceTrace, IntArray]
"""Pulses, force, and how many samples came before each pulse if that is not as it should be."""
Spoil = Callable[[Stream, Stream], Stream]


def merged(first: ForceTrace, second: ForceTrace) -> ForceTrace:
    """Both traces in the order of their stamps, the first before the second of equal ones."""
    stamps = np.concatenate((first.stamp_ns, second.stamp_ns))
    order = np.argsort(stamps, kind='stable')
    return ForceTrace(stamps[order], np.concatenate((first.force, second.force))[order])


def at_once(own: Stream, other: Stream) -> Stream:
    return own[0], merged(own[1], other[1])


def in_between(own: Stream, other: Stream) -> Stream:
    later = ForceTrace(other[1].stamp_ns + 300_000, other[1].force)
    return own[0], merged(own[1], later)


def beside_a_dead_one(own: Stream, _: Stream) -> Stream:
    dead = ForceTrace(own[1].stamp_ns + 300_000, np.zeros(len(own[1])))
    return own[0], merged(own[1], dead)


def beside_a_slow_one(own: Stream, other: Stream) -> Stream:
    slow = slice(None, None, 7)
    later = ForceTrace(other[1].stamp_ns[slow] + 300_000, other[1].force[slow])
    return own[0], merged(own[1], later)


def in_bursts(own: Stream, other: Stream) -> Stream:
    """Each of two sensors sends twenty samples at a time."""
    stamps = np.stack([trace.stamp_ns.reshape(-1, 20) for _, trace in (own, other)], axis=1)
    forces = np.stack([trace.force.reshape(-1, 20) for _, trace in (own, other)], axis=1)
    return own[0], ForceTrace(stamps.ravel(), forces.ravel())


def spike(value: float) -> Spoil:
    def spoil(own: Stream, _: Stream) -> Stream:
        own[1].force[15_030] = value
        return own

    return spoil


def every_half_second(own: Stream, _: Stream) -> Stream:
    own[1].force[30::500] = 500.0
    return own


def knocked(own: Stream, _: Stream) -> Stream:
    own[1].force[15_000:15_100] += 300.0
    return own


def clipped(own: Stream, _: Stream) -> Stream:
    np.minimum(own[1].force, 0.6 * own[1].force.max(), out=own[1].force)
    return own


def frozen(own: Stream, _: Stream) -> Stream:
    own[1].force[10_000:18_000] = own[1].force[10_000]
    return own


def dead(own: Stream, _: Stream) -> Stream:
    own[1].force[:] = 0.0
    return own


def two_drivers(own: Stream, other: Stream) -> Stream:
    onset = other[0].onset_ns + 23 * MILLISECOND
    forged = PulseTrain(onset, other[0].intensity, other[0].sequence + 5000, other[0].width)
    both = PulseTrain.joined([own[0], forged])
    return both[np.argsort(both.onset_ns)], own[1]


def forged_far_ahead(own: Stream, other: Stream) -> Stream:
    far = other[0].onset_ns + 10**18
    forged = PulseTrain(far, other[0].intensity, other[0].sequence, other[0].width)
    before = np.tile(50 * np.arange(len(own[0]), dtype=np.int64), 2)
    return PulseTrain.joined([own[0], forged]), own[1], before


# What each stream is spoilt by, and a fault that has to be named.
STREAMS: dict[str, tuple[Spoil, str]] = {
    'two sensors with the same stamps': (at_once, 'force_conflict'),
    'two sensors in turn': (in_between, 'force_alternating'),
    'a dead sensor beside': (beside_a_dead_one, 'force_alternating'),
    'a slow sensor beside': (beside_a_slow_one, 'force_spike'),
    'two sensors in bursts': (in_bursts, 'force_stamp_not_after_last'),
    'a sample of 1e6 N': (spike(1e6), 'force_out_of_bounds'),
    'a sample of 1e300 N': (spike(1e300), 'force_out_of_bounds'),
    'a sample of -900 N': (spike(-900.0), 'force_spike'),
    'a spike every half second': (every_half_second, 'force_spike'),
    'a knock': (knocked, 'force_unexplained'),
    'a clipped sensor': (clipped, 'force_clipped'),
    'a frozen sensor': (frozen, 'force_frozen'),
    'a dead sensor': (dead, 'force_constant'),
    'two drivers': (two_drivers, 'pulse_sequence_restart'),
    'pulses far ahead': (forged_far_ahead, 'pulse_far_ahead'),
}


def noisy(record, seed: int, share: float = 1.0) -> Stream:
    random = np.random.default_rng(seed)
    pulses, forces = record(random.uniform(size=20 * SECONDS))
    noise = 0.02 * random.standard_normal(len(forces))
    return pulses, ForceTrace(forces.stamp_ns, share * forces.force + noise)


def distance(found: Estimate, truth: FloatArray) -> float:
    """Largest distance of the curve from the truth, as a share of its maximum."""
    if not found.curve_known:
        return 0.0
    return float(np.abs(found.curve_force - truth).max() / truth.max())


@pytest.fixture(scope='module')
def truths(record) -> dict[str, FloatArray]:
    """The curve that each estimator finds in the clean stream."""
    found = {}
    for name in ('recursive', 'horizon', 'batch'):
        session = identify(estimator_by_name(name), *noisy(record, 3))
        assert session.last.faults == {}
        assert session.last.doubts == ()
        found[name] = session.last.curve_force
    return found


@pytest.mark.parametrize('name', ['recursive', 'horizon', 'batch'])
@pytest.mark.parametrize('stream', STREAMS)
def test_a_curve_is_right_or_in_doubt(record, truths, name: str, stream: str) -> None:
    spoil, fault = STREAMS[stream]
    pulses, forces, *before = spoil(noisy(record, 3), noisy(record, 4, 0.5))
    arrival = before[0] if before else None
    session = identify(estimator_by_name(name), pulses, forces, samples_before_pulse=arrival)
    assert session.last.faults.get(fault, 0) > 0
    for estimate in session.estimates:
        # While the session is young the recursion wanders by itself.
        if name == 'recursive' and estimate.stamp_ns < 15e9:
            continue
        if not estimate.doubts and estimate.curve_known and estimate.stamp_ns > 5e9:
            # 3 % is what the clean streams of other seeds differ by; the recursion follows its
            # last samples and differs by 20 %.
            limit = 0.2 if name == 'recursive' else 0.03
            assert distance(estimate, truths[name]) < limit, estimate.stamp_ns
