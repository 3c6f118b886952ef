# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of pulses and what their sequence numbers show."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification.quality.doubts import FaultCounter
from rpms_ros.identification.stream.pulse_queue import PulseQueue
from rpms_ros.pulses import Pulse, PulseTrain

MILLISECOND = 1_000_000
MEMORY, LOOK_AHEAD = 350 * MILLISECOND, 100 * MILLISECOND


class Queue:
    """A queue, told and asked in milliseconds, and its counter."""

    def __init__(self) -> None:
        self.counter = FaultCounter()
        self.queue = PulseQueue(MEMORY, LOOK_AHEAD, self.counter)

    def rest(self) -> None:
        """Let the force be heard long before the first pulse."""
        self.queue.begin(-10_000 * MILLISECOND)

    def add(self, *pulses: tuple[int, float, int]) -> None:
        train = [Pulse(onset * MILLISECOND, *others) for onset, *others in pulses]
        self.queue.add(PulseTrain.of(train))

    def onsets(self, until: int) -> list[int]:
        return (self.queue.settle(until * MILLISECOND)[0] // MILLISECOND).tolist()

    def unknown(self, *stamps: int) -> list[bool]:
        return self.queue.unknown(MILLISECOND * np.array(stamps, dtype=np.int64)).tolist()


@given(st.permutations(range(12)), st.integers(1, 5))
def test_the_order_of_arrival_does_not_matter(order, size):
    queue = Queue()
    for start in range(0, 12, size):
        queue.add(*((50 * index, index / 12, index) for index in order[start : start + size]))
    onset, intensity = queue.queue.settle(1000 * MILLISECOND)
    assert (onset // MILLISECOND).tolist() == list(range(0, 600, 50))
    assert intensity.tolist() == [index / 12 for index in range(12)]
    assert queue.counter.counts() == {}


def test_a_lost_pulse_excludes_what_it_could_touch():
    queue = Queue()
    queue.add((0, 0.5, 0), (150, 0.5, 3))
    assert queue.onsets(200) == [0, 150]
    assert queue.counter.counts() == {'pulse_lost': 2}
    # the gap begins later than the look-ahead allows to know: 150 - 100
    assert queue.unknown(0, 50, 51, 150, 500, 501) == [False, False, True, True, True, False]


@pytest.mark.parametrize(
    ('sequences', 'counts'),
    [
        ([2**32 - 2, 2**32 - 1, 0, 1], {}),
        ([2**32 - 1, 1], {'pulse_lost': 1}),
        ([7, 8, 0, 1], {'pulse_sequence_restart': 1}),
        ([0, 0, 0], {'pulse_sequence_stuck': 2}),
    ],
)
def test_what_sequences_show(sequences, counts):
    queue = Queue()
    queue.add(*((50 * place, 0.5, sequence) for place, sequence in enumerate(sequences)))
    assert len(queue.onsets(1000)) == len(sequences)
    assert queue.counter.counts() == counts


@pytest.mark.parametrize('intensity', [-1e-9, 1.0000001, math.nan, math.inf])
def test_an_impossible_intensity_counts_as_lost(intensity):
    queue = Queue()
    queue.add((0, 0.5, 0), (50, intensity, 1), (100, 0.0, 2), (150, 1.0, 3))
    assert queue.onsets(200) == [0, 100, 150]
    assert queue.counter.counts() == {'pulse_intensity_invalid': 1}
    assert queue.unknown(50, 51, 400, 401) == [False, True, True, False]


@pytest.mark.parametrize('sequence', [1, 2])
def test_two_pulses_at_nearly_one_time_are_no_pulses_of_one_stimulator(sequence):
    queue = Queue()
    train = [Pulse(0, 0.5, 0), Pulse(100_000, 0.5, sequence), Pulse(50_000_000, 0.5, 1)]
    queue.queue.add(PulseTrain.of(train))
    assert queue.onsets(200) == [0, 50]
    assert queue.counter.counts() == {'pulse_too_close': 1}
    assert queue.unknown(0, 1, 350, 351) == [False, True, True, False]


def test_a_sequence_that_restarts_twice_is_not_learnt_from():
    queue = Queue()
    queue.rest()
    queue.add((0, 0.5, 7), (50, 0.5, 0), (100, 0.5, 1), (150, 0.5, 0), (200, 0.5, 1))
    assert queue.onsets(300) == [0, 50, 100, 150, 200]
    assert queue.counter.counts() == {'pulse_sequence_restart': 2}
    assert queue.unknown(100, 101, 500, 501) == [False, True, True, False]


def test_far_pulses_wait_for_the_force_and_are_given_up_when_it_does_not_come():
    queue = Queue()
    minute = [Pulse(60_000 * MILLISECOND, 0.5, 1), Pulse(10**18, 0.5, 2)]
    queue.queue.add(PulseTrain.of(minute), newest_ns=0)
    assert queue.onsets(9_000) == []
    assert queue.counter.counts() == {}
    assert queue.onsets(60_000) == [60_000]
    assert queue.counter.counts() == {'pulse_far_ahead': 1}


def flood(start_ns, count, step_ns) -> PulseTrain:
    onsets = start_ns + step_ns * np.arange(count, dtype=np.int64)
    sequence = np.arange(count, dtype=np.int64)
    return PulseTrain(onsets, np.full(count, 0.5), sequence, np.full(count, 1e-4))


def test_a_flood_of_far_pulses_is_bounded():
    queue = Queue()
    for start_ns in (10**18, 10**17, 10**16):
        queue.queue.add(flood(start_ns, 60_000, 50 * MILLISECOND), newest_ns=0)
    queue.queue.add(PulseTrain.of([Pulse(50 * MILLISECOND, 0.5, 0)]), newest_ns=0)
    assert queue.queue._far._count == 100_000
    assert queue.onsets(100) == [50]
    # said when the second of the force in which they came is over
    assert queue.counter.counts() == {}
    assert queue.onsets(1000) == []
    assert queue.counter.counts() == {'pulse_far_ahead': 80_000}


def test_a_flood_of_near_pulses_is_bounded():
    queue = Queue()
    for _ in range(100):
        queue.queue.add(flood(0, 1000, 1000), newest_ns=0)
    assert sum(map(len, queue.queue._arrived)) == 10_000
    queue.onsets(1000)
    assert queue.counter.counts()['pulse_too_close'] >= 90_000
    assert queue.queue._room.state() == {'_taken': [], '_refused': []}


def test_a_first_pulse_that_is_not_number_0_excludes_what_those_before_it_could_touch():
    queue = Queue()
    queue.queue.begin(0)
    queue.add((50, 0.5, 7), (100, 0.5, 8))
    assert queue.onsets(200) == [50, 100]
    assert queue.unknown(0, 1, 400, 401) == [True, True, True, False]
    assert queue.counter.counts() == {}


@pytest.mark.parametrize(('rest', 'sequence'), [(False, 0), (False, 2**32), (True, 7)])
def test_a_first_pulse_of_a_session_excludes_nothing(rest, sequence):
    queue = Queue()
    queue.queue.begin(0)
    if rest:
        queue.rest()
    queue.add((50, 0.5, sequence))
    assert queue.onsets(200) == [50]
    assert not any(queue.unknown(0, 1, 51, 400))


def test_only_known_faults_are_counted():
    with pytest.raises(KeyError, match=r'expected a fault of force_not_finite, .* got rain'):
        FaultCounter().add('rain')
