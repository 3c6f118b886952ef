# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of pulses, what their numbers show, other clocks, intensities that are no shares."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.quality.doubts import (
    CLOCKS_DIFFER,
    FORCE_WITHOUT_PULSES,
    Alignment,
    FaultCounter,
    stated_doubt,
)
from rpms_ros.identification.quality.verdict import reasons_of_data, verdict_of
from rpms_ros.identification.stream.arrivals import (
    PulseQueue,
    no_overlap,
    of_one_intensity,
    range_outside,
)
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, Pulse, PulseTrain

MILLISECOND = 1_000_000
MEMORY, LOOK_AHEAD = 350 * MILLISECOND, 100 * MILLISECOND


class Queue:
    """A queue, told and asked in milliseconds, and its counter."""

    def __init__(self) -> None:
        self.counter = FaultCounter()
        self.queue = PulseQueue(MEMORY, LOOK_AHEAD, self.counter)

    def add(self, *pulses: tuple[int, float, int]) -> None:
        train = [Pulse(onset * MILLISECOND, *others) for onset, *others in pulses]
        self.queue.add(PulseTrain.of(train))

    def onsets(self, until: int) -> list[int]:
        until_ns = until * MILLISECOND
        return (self.queue.settle(until_ns, until_ns)[0] // MILLISECOND).tolist()

    def unknown(self, *stamps: int) -> list[bool]:
        return self.queue.unknown(MILLISECOND * np.array(stamps, dtype=np.int64)).tolist()


@given(st.permutations(range(12)), st.integers(1, 5))
def test_the_order_of_arrival_does_not_matter(order, size):
    queue = Queue()
    for start in range(0, 12, size):
        queue.add(*((50 * index, index / 12, index) for index in order[start : start + size]))
    onset, intensity = queue.queue.settle(1000 * MILLISECOND, 1000 * MILLISECOND)
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


def test_a_number_that_comes_again_with_another_stamp_is_no_pulse_of_its_own():
    """As of a relay that stamps anew: which of the two was given is not known."""
    queue = Queue()
    queue.add((0, 0.5, 7), (50, 0.5, 8), (70, 0.5, 8), (100, 0.5, 9), (120, 0.5, 9))
    assert queue.onsets(1000) == [0, 50, 100]
    assert queue.counter.counts() == {'pulse_duplicate': 2}
    assert queue.unknown(50, 51, 370, 371, 420, 421)[1:5] == [True] * 4


def test_a_driver_that_does_not_count_after_one_that_did_is_heard():
    queue = Queue()
    numbers = [5, 6, 7, 0, 0, 0, 0]
    queue.add(*((50 * place, 0.5, number) for place, number in enumerate(numbers)))
    assert len(queue.onsets(1000)) == 7
    assert queue.counter.counts() == {'pulse_sequence_restart': 1, 'pulse_sequence_stuck': 3}


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
    queue.add((0, 0.5, 7), (450, 0.5, 0), (500, 0.5, 1), (550, 0.5, 0), (600, 0.5, 1))
    assert queue.onsets(700) == [0, 450, 500, 550, 600]
    assert queue.counter.counts() == {'pulse_sequence_restart': 2}
    assert queue.unknown(500, 501, 900, 901) == [False, True, True, False]


def test_pulses_lost_while_the_driver_was_started_again_are_not_learnt_from():
    queue = Queue()
    queue.add((0, 0.5, 40), (1000, 0.5, 15), (1050, 0.5, 16))
    assert queue.onsets(2000) == [0, 1000, 1050]
    assert queue.counter.counts() == {'pulse_sequence_restart': 1}
    assert queue.unknown(900, 901, 1350, 1351) == [False, True, True, False]


def test_far_pulses_wait_for_the_force_and_are_given_up_when_it_does_not_come():
    queue = Queue()
    minute = [Pulse(60_000 * MILLISECOND, 0.5, 1), Pulse(10**18, 0.5, 2)]
    queue.queue.add(PulseTrain.of(minute), newest_ns=0)
    assert queue.onsets(9_000) == []
    assert queue.counter.counts() == {}
    assert queue.onsets(60_000) == [60_000]
    assert queue.counter.counts() == {'pulse_far_ahead': 1}


def flood(start_ns, count, step_ns) -> PulseTrain:
    return PulseTrain.numbered(start_ns + step_ns * np.arange(count, dtype=np.int64), 0.5)


def test_a_flood_of_far_pulses_is_bounded():
    queue = Queue()
    for start_ns in (10**18, 10**17, 10**16):
        queue.queue.add(flood(start_ns, 60_000, 50 * MILLISECOND), newest_ns=0)
    queue.queue.add(PulseTrain.of([Pulse(50 * MILLISECOND, 0.5, 0)]), newest_ns=0)
    assert len(queue.queue._far._kept) == 100_000
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
    assert vars(queue.queue._room) == {'_most': 10_000, '_taken': {}, '_refused': {}}


@pytest.mark.parametrize(('sequence', 'excludes'), [(7, True), (0, False), (2**32, False)])
def test_a_first_pulse_that_is_not_number_0_excludes_what_those_before_it_could_touch(
    sequence, excludes
):
    queue = Queue()
    queue.add((50, 0.5, sequence), (100, 0.5, sequence + 1))
    assert queue.onsets(200) == [50, 100]
    assert queue.unknown(0, 1, 51, 400, 401) == [excludes] * 4 + [False]
    assert queue.counter.counts() == {}
    assert queue.queue.began_amid is excludes


def test_only_known_faults_are_counted():
    with pytest.raises(KeyError, match=r'expected a fault of force_not_finite, .* got rain'):
        FaultCounter().add('rain')


SELDOM = StreamSettings(estimate_period=2.0)
HOUR_NS = 3_600_000_000_000
STAMPS = 10**18 + 1_000_000 * np.arange(10_000)
FORCES = ForceTrace(STAMPS, np.sin(0.01 * np.arange(10_000)))
RANDOM = np.random.default_rng(1).uniform(0.0, 1.0, 200)


def pulses_of(intensity, late_ns=0) -> PulseTrain:
    return PulseTrain.regular(intensity, 20.0, 10**18 + late_ns)


def reasons_of(pulses, forces=FORCES) -> list[tuple[str, str]]:
    return list(reasons_of_data(pulses, forces, 200.0))


@pytest.mark.parametrize(
    ('late_ns', 'spans'),
    [
        (HOUR_NS, 'from 3600.0 s to 3609.9 s, force from 0.0 s to 10.0 s'),
        (-HOUR_NS, 'from 0.0 s to 9.9 s, force from 3600.0 s to 3610.0 s'),
    ],
)
def test_pulses_on_another_clock_are_told_with_both_times(late_ns, spans):
    text = f'pulses are {spans}: they do not overlap'
    assert reasons_of(pulses_of(RANDOM, late_ns)) == [('no', f'{CLOCKS_DIFFER}: {text}')]


def test_pulses_that_begin_before_the_force_overlap_with_it():
    assert no_overlap(pulses_of(RANDOM, -5_000_000_000).onset_ns, STAMPS) is None
    assert no_overlap(np.empty(0, np.int64), STAMPS) is None
    assert reasons_of(pulses_of(RANDOM)) == []


@pytest.mark.parametrize(
    ('intensity', 'text'),
    [
        (100.0 * np.linspace(0.0, 0.989, 200), 'up to 98.9: percent?'),
        (np.array([0.5, 99.8]), 'up to 99.8: percent?'),
        (np.array([0.5, -0.1, 1.1]), 'from -0.1 to 1.1'),
        (np.array([0.5, 1.5]), '1.5'),
        (np.array([0.5, 300.0, 800.0]), 'from 300 to 800'),
        (np.array([0.5, np.nan]), 'not finite'),
    ],
)
def test_the_range_of_wrong_intensities_has_a_guess_at_their_unit(intensity, text):
    assert range_outside(intensity) == text


def test_intensities_that_are_mostly_no_shares_are_the_reason_of_a_no():
    percent = np.linspace(0.0, 99.8, 200)
    count = np.count_nonzero(percent > 1.0)
    named = f'pulse_intensity_invalid: the intensity of {count} of 200 pulses is outside 0 to 1'
    assert reasons_of(pulses_of(percent)) == [('no', f'{named} (up to 99.8: percent?)')]
    ((grade, text),) = reasons_of(pulses_of(-RANDOM))
    assert grade == 'no'
    assert text.startswith('pulse_intensity_invalid: the intensity of 200 of 200 pulses')
    assert reasons_of(pulses_of(np.zeros(200))) == [('no', 'there is no pulse above intensity 0')]


def test_a_force_that_no_sensor_resolves_may_be_in_kilonewtons():
    small = replace(FORCES, force=1e-3 * FORCES.force)
    ((grade, text),) = reasons_of(pulses_of(RANDOM), small)
    assert grade == 'doubtful'
    assert text == (
        'the force spans 0.002 N, less than the 0.05 N that a sensor for people resolves: '
        'is the force in kN?'
    )
    assert not list(reasons_of_data(pulses_of(RANDOM), small, 200.0, 'N m'))


@pytest.mark.parametrize(
    ('pulses', 'one'),
    [
        (pulses_of(np.full(200, 0.7)), True),
        (pulses_of(np.append(RANDOM[:0], 0.7)), True),
        (pulses_of(np.tile([0.0, 0.7], 100)), True),
        (pulses_of(RANDOM), False),
        (pulses_of(RANDOM, HOUR_NS), False),
        (pulses_of(-RANDOM), False),
        (pulses_of(np.zeros(200)), False),
        # those outside 0 to 1 are not used
        (pulses_of(np.tile([70.0, 0.7], 100)), True),
    ],
)
def test_one_intensity_is_that_of_the_pulses_that_were_used(pulses, one):
    assert of_one_intensity(pulses, STAMPS) is one


def answered(intensity, seconds, rate=20.0) -> tuple[PulseTrain, ForceTrace]:
    """Pulses from 1 s on, and the noisy force that a muscle answers with."""
    pulses = PulseTrain.regular(intensity, rate, NANOSECONDS_PER_SECOND)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(round(1000 * seconds), dtype=np.int64) * 1_000_000
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(stamps))
    return pulses, ForceTrace(stamps, muscle.force(stamps) + noise)


def shifted(forces, seconds) -> ForceTrace:
    return replace(forces, stamp_ns=forces.stamp_ns + round(seconds * NANOSECONDS_PER_SECOND))


@pytest.fixture(scope='module')
def random_session() -> tuple[PulseTrain, ForceTrace]:
    return answered(np.random.default_rng(1).uniform(0.0, 1.0, 290), 17.0)


@pytest.mark.parametrize(
    ('ahead', 'said'),
    [
        (5.0, 'pulses are stamped 5.* s before the force'),
        (0.3, r'pulses are stamped 0\.3\d* s before the force'),
        (0.1, r'pulses are stamped 0\.1\d* s before the force'),
        (-0.05, r'the force answers 0\.04\d* s before the pulses'),
        (-0.1, r'the force answers 0\.09\d* s before the pulses'),
        (-5.0, r'the force answers (4\.99|5)\d* s before the pulses'),
        (0.06, r'the force answers 0\.06\d* s after the pulses'),
        (-1e5, 'pulses are stamped 1e.05 s after the force'),
    ],
)
def test_a_sensor_of_another_clock_is_said_with_the_distance(random_session, ahead, said):
    pulses, forces = random_session
    # the order of arrival is that of the events, whatever the stamps say
    before = np.searchsorted(forces.stamp_ns, pulses.onset_ns) + 5
    moved = shifted(forces, ahead)
    recursive = estimator_by_name('recursive')
    found = identify(recursive, pulses, moved, SELDOM, samples_before_pulse=before)
    assert CLOCKS_DIFFER in found.last.doubts
    assert re.search(said, stated_doubt(found.last, CLOCKS_DIFFER))
    verdict = verdict_of(found, pulses, moved)
    assert verdict.grade == 'no'
    assert CLOCKS_DIFFER in verdict.line


@pytest.mark.parametrize('ahead', [pytest.param(5.0, marks=pytest.mark.long), -0.1])
def test_without_an_order_of_arrival_the_force_tells_the_clock(random_session, ahead):
    pulses, forces = random_session
    found = identify(estimator_by_name('batch'), pulses, shifted(forces, ahead))
    assert CLOCKS_DIFFER in found.last.doubts


def test_pulses_that_are_held_up_once_are_of_no_other_clock(random_session):
    pulses, forces = random_session
    before = np.searchsorted(forces.stamp_ns, pulses.onset_ns) + 5
    before[100:120] = before[120]
    found = identify(estimator_by_name('recursive'), pulses, forces, samples_before_pulse=before)
    assert all(CLOCKS_DIFFER not in one.doubts for one in found.estimates)
    assert found.last.faults['pulse_late'] > 10


@pytest.mark.parametrize('seconds', [4.0, 8.0, 17.0])
def test_noise_is_of_no_other_clock(random_session, seconds):
    pulses, forces = random_session
    count = round(1000 * seconds)
    for seed in range(2):
        noise = np.random.default_rng(seed).standard_normal(count)
        trace = ForceTrace(forces.stamp_ns[:count], noise)
        found = identify(estimator_by_name('recursive'), pulses, trace, SELDOM)
        assert not {CLOCKS_DIFFER, FORCE_WITHOUT_PULSES} & set(found.last.doubts)


@pytest.mark.parametrize(('period', 'seconds'), [(106, 39.0), (106, 60.0), (180, 60.0)])
def test_a_sensor_that_takes_the_ripple_away_is_of_no_other_clock(period, seconds):
    """A mean over the interval of the pulses: the force was to answer 0.8 to 5 s before them."""
    count = round(20 * (seconds - 2.0))
    intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / period)
    pulses, forces = answered(intensity, seconds)
    sums = np.concatenate((np.zeros(50), np.cumsum(forces.force)))
    forces = replace(forces, force=(sums[50:] - sums[:-50]) / 50.0)
    found = identify(estimator_by_name('batch'), pulses, forces)
    assert CLOCKS_DIFFER not in found.last.doubts


@pytest.mark.parametrize('seed', range(4))
def test_slow_pulses_of_random_intensity_are_of_another_clock_only_if_they_are(seed):
    """Six of fifteen sessions of 20 pulses were: by chance, by some of their periods."""
    intensity = np.random.default_rng(seed).uniform(0.0, 1.0, 20)
    pulses, forces = answered(intensity, 21.0, rate=1.0)
    for ahead, said in ((0.0, False), (0.3, True)):
        found = identify(estimator_by_name('recursive'), pulses, shifted(forces, ahead), SELDOM)
        assert (CLOCKS_DIFFER in found.last.doubts) is said


@pytest.mark.parametrize('levels', [[0.8], [0.45, 0.55, 0.65, 0.75, 0.85, 1.0]])
@pytest.mark.parametrize(
    ('count', 'rate', 'rest'),
    [(4, 20.0, 2.0), (7, 30.0, 2.0), (10, 30.0, 2.0), (20, 40.0, 2.0), (10, 100.0, 5.0)],
)
def test_trains_are_of_another_clock_only_if_they_are(count, rate, rest, levels):
    """As a whole a train answers ahead of its later pulses: of 264 designs 60 were."""
    begin = np.arange(1.0, 32.0, (count - 1) / rate + rest)
    onset = (begin[:, None] + np.arange(count) / rate).ravel()
    intensity = np.repeat(np.resize(levels, len(begin)), count)
    assert judged_clock(onset, intensity) == []
    assert judged_clock(onset, intensity, 0.3) == [CLOCKS_DIFFER]


@pytest.mark.parametrize('least', [0.1, 0.4])
@pytest.mark.parametrize('on_off', [(1.0, 1.0), (2.0, 2.0)])
def test_trains_that_ramp_up_are_of_no_other_clock(least, on_off):
    """The first pulse of each is the weakest one: the force answers those that follow."""
    onset = np.arange(1.0, 33.0, 0.05)
    since = onset % sum(on_off)
    onset, since = onset[since < on_off[0]], since[since < on_off[0]]
    intensity = least + (1.0 - least) * since / on_off[0]
    assert judged_clock(onset, intensity) == []


@pytest.mark.parametrize('ahead_s', [0.0, 0.3, -0.3])
def test_doublets_of_random_levels_tell_the_clock(ahead_s):
    begin = np.arange(1.0, 33.0, 0.5)
    level = np.random.default_rng(0).uniform(0.2, 1.0, len(begin))
    onset = (begin[:, None] + 0.01 * np.arange(2)).ravel()
    assert judged_clock(onset, np.repeat(level, 2), ahead_s) == [CLOCKS_DIFFER] * bool(ahead_s)


def judged_clock(onset, intensity, ahead_s=0.0) -> list[str]:
    """Doubts of force that a muscle answers with, stamped so much later [s]."""
    pulses = PulseTrain.numbered((1e9 * onset).astype(np.int64), intensity)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(34_000, dtype=np.int64) * 1_000_000
    force = muscle.force(stamps) + 0.05 * np.random.default_rng(2).standard_normal(len(stamps))
    judged = Alignment(lasting=False)
    later_ns = round(ahead_s * NANOSECONDS_PER_SECOND)
    judged.add(stamps + later_ns, force, pulses.onset_ns, pulses.intensity)
    judged.judge(int(stamps[-1]))
    return list(judged.found)


def test_what_acts_from_before_the_last_half_minute_is_no_force_without_pulses():
    """The rest that the half minute begins with counted whole, as if nothing had acted there."""
    begin = np.arange(1.0, 32.0, 0.75)
    onset = (begin[:, None] + np.arange(4) / 20.0).ravel()
    pulses = PulseTrain.numbered((1e9 * onset).astype(np.int64), np.full(len(onset), 0.8))
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(34_000, dtype=np.int64) * 1_000_000
    judged = Alignment(lasting=False)
    judged.add(stamps, muscle.force(stamps), pulses.onset_ns, pulses.intensity)
    judged.judge(int(stamps[-1]))
    assert judged.found == {}


@pytest.mark.parametrize('known', [slice(30), slice(60, 100)])
def test_pulses_missing_at_an_end_are_said(known):
    pulses, forces = answered(np.full(100, 0.8), 8.0)
    for name in ('batch', 'recursive'):
        found = identify(estimator_by_name(name), pulses[known], forces)
        assert FORCE_WITHOUT_PULSES in found.last.doubts
        verdict = verdict_of(found, pulses[known], forces)
        assert verdict.grade != 'good'
        assert 'without a pulse the force goes on at the rate of the pulses' in verdict.line
    whole = identify(estimator_by_name('batch'), pulses, forces)
    assert FORCE_WITHOUT_PULSES not in whole.last.doubts


@pytest.mark.parametrize('known', [slice(120), slice(60, 200)])
def test_pulses_of_random_intensity_missing_at_an_end_are_said(random_session, known):
    pulses, forces = random_session
    part = ForceTrace(forces.stamp_ns[:10_000], forces.force[:10_000])
    found = identify(estimator_by_name('batch'), pulses[known], part)
    verdict = verdict_of(found, pulses[known], part)
    assert 'without a pulse the force moves as with pulses' in verdict.line
