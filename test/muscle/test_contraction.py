# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stream of Eq. (11) against the direct sum over all pulses; a muscle that changes."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import Contraction, Subject, average_subject, simulation_subject, twitch
from rpms_ros.muscle.time_varying import Change, Fatigue, LivingSettings, Potentiation
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, PulseTrain

MILLISECOND = 1_000_000

subjects = st.builds(
    Subject,
    time_constant=st.floats(5e-3, 0.1),
    latency=st.floats(0.0, 0.03),
    order=st.integers(1, 6),
    maximum_force=st.floats(1.0, 100.0),
)
onsets = st.lists(st.integers(0, 3 * NANOSECONDS_PER_SECOND), min_size=1, max_size=30, unique=True)
stamps = st.lists(st.integers(0, 4 * NANOSECONDS_PER_SECOND), min_size=1, max_size=30)


def intensities_of(onset_ns):
    """Return some intensity for each onset, the same one in every call."""
    return np.asarray(onset_ns % 1009 / 1009)


def superposition(subject, onset_ns, intensity, stamp_ns, rate_hz):
    """Return Eq. (11) as it stands: a sum of twitches over every pulse there has been."""
    rates = np.full(len(onset_ns), rate_hz)
    if rate_hz is None:
        interval = np.diff(onset_ns) / NANOSECONDS_PER_SECOND
        rates = np.concatenate(([0.0], 1.0 / np.maximum(interval, 1e-3)))
    weights = subject.pulse_weight(intensity, rates)
    latency_ns = round(subject.latency * NANOSECONDS_PER_SECOND)
    total = np.zeros(len(stamp_ns))
    for onset, weight in zip(onset_ns, weights, strict=True):
        lag = (stamp_ns - onset - latency_ns) / NANOSECONDS_PER_SECOND
        total += weight * twitch(lag, subject.time_constant, subject.order)
    return total


@given(subjects, onsets, stamps, st.sampled_from([None, 12.0, 20.0, 35.0]))
def test_force_is_the_sum_of_all_twitches(subject, onset, stamp, rate_hz):
    onset_ns = np.sort(np.array(onset))
    intensity = intensities_of(onset_ns)
    contraction = Contraction(subject, rate_hz)
    contraction.add_pulses(onset_ns, intensity)
    stamp_ns = np.sort(stamp)
    expected = superposition(subject, onset_ns, intensity, stamp_ns, rate_hz)
    # Every term is positive, so rounding is relative: 400 moves of a few ulp each, at most.
    np.testing.assert_allclose(contraction.force(stamp_ns), expected, rtol=1e-11, atol=1e-11)


@given(onsets, st.lists(st.integers(0, 2900 * MILLISECOND), min_size=30, max_size=30))
def test_a_late_pulse_acts_from_its_own_time(onset, delays):
    onset_ns = np.array(onset)
    arrival_ns = onset_ns + np.array(delays[: len(onset)])
    intensity = intensities_of(onset_ns)
    stream = Contraction(average_subject(), fixed_rate_hz=20.0)
    for now_ns in range(0, 6000 * MILLISECOND, 10 * MILLISECOND):
        arrived = (arrival_ns <= now_ns) & (arrival_ns > now_ns - 10 * MILLISECOND)
        stream.add_pulses(onset_ns[arrived], intensity[arrived])
        force = stream.force(now_ns)
        known = arrival_ns <= now_ns
        expected = superposition(
            average_subject(), onset_ns[known], intensity[known], np.array([now_ns]), 20.0
        )
        # As above.
        np.testing.assert_allclose(force, expected, rtol=1e-11, atol=1e-11)


def test_a_pulse_before_the_first_sample_has_its_rate():
    stream = Contraction(average_subject())
    stream.force(1000 * MILLISECOND)
    onset_ns = np.array([960, 1010]) * MILLISECOND
    stream.add_pulses(onset_ns, [0.8, 0.9])
    stamp_ns = np.arange(1001, 1200) * MILLISECOND
    expected = superposition(average_subject(), onset_ns, np.array([0.8, 0.9]), stamp_ns, None)
    # As above; the second pulse has its rate of 20 Hz only if the first one is still known.
    np.testing.assert_allclose(stream.force(stamp_ns), expected, rtol=1e-11, atol=1e-11)


def test_a_pulse_of_a_clock_that_was_never_set_does_nothing():
    stream = Contraction(average_subject())
    stream.add_pulses(0, 1.0)
    assert stream.force(EPOCH_NS) == 0.0


@pytest.mark.parametrize('intensity', [-0.01, 1.01, float('nan'), float('inf')])
def test_a_bad_intensity_adds_nothing(intensity):
    contraction = Contraction(average_subject())
    with pytest.raises(MuscleError, match='expected intensities from 0 to 1, got'):
        contraction.add_pulses([0, 1], [1.0, intensity])
    np.testing.assert_array_equal(contraction.force(50 * MILLISECOND), 0.0)


@pytest.mark.parametrize(
    ('stamps', 'fault'),
    [
        ([1], 'expected times from .* ns on, got 1 ns'),
        ([2**40, 2**39], 'expected ascending times'),
    ],
)
def test_force_is_read_forwards(stamps, fault):
    contraction = Contraction(average_subject())
    contraction.force(NANOSECONDS_PER_SECOND)
    with pytest.raises(MuscleError, match=fault):
        contraction.force(stamps)


EPOCH_NS = 1_700_000_000 * NANOSECONDS_PER_SECOND
TIRING = LivingSettings(Fatigue(force_loss=0.2, slowing=0.1, recovery=20.0))
EVERYTHING = LivingSettings(
    Fatigue(force_loss=0.05, slowing=0.02, recovery=10.0),
    Potentiation(largest=0.3, per_pulse=0.05, decay=5.0),
    (Change(0.7, 0.5, gain=0.6, latency=15e-3), Change(1.5, threshold=0.55, time_constant=0.05)),
)


RANDOM = np.random.default_rng(3).uniform(0.3, 1.0, 80)


def epoch_grid(seconds):
    return EPOCH_NS + MILLISECOND * np.arange(round(1000 * seconds), dtype=np.int64)


def living(changing, rate_hz=None, intensity=RANDOM[:60], subject=None):
    """Return a muscle that changes, with pulses at 20 Hz."""
    muscle = Contraction(subject or average_subject(), rate_hz, changing)
    muscle.begin(EPOCH_NS)
    muscle.add_pulses(PulseTrain.regular(intensity, 20.0, EPOCH_NS).onset_ns, intensity)
    return muscle


@settings(max_examples=30)
@given(st.lists(st.integers(0, 2500), max_size=5))
def test_blocks_of_a_muscle_that_changes_change_no_bit(cuts):
    stamps = epoch_grid(2.5)
    whole = living(EVERYTHING).force(stamps)
    muscle = living(EVERYTHING)
    edges = [0, *sorted(cuts), len(stamps)]
    blocks = [muscle.force(stamps[low:high]) for low, high in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(blocks), whole)


def chain(subject, pulses, fatigue, seconds):
    """Return force, fatigue and slowing at the end of a chain of three poles with fatigue."""
    state = np.array([0.0, 0.0, 0.0, 1.0, 1.0])
    peak = (np.e / 2) ** 2

    def rates(_time, x):
        slow = subject.time_constant * x[4]
        use = peak * x[2] / subject.maximum_force
        return np.array(
            [
                -x[0] / slow,
                (x[0] - x[1]) / slow,
                (2 * x[1] - x[2]) / slow,
                -(x[3] - 1) / fatigue.recovery - fatigue.force_loss * use,
                -(x[4] - 1) / fatigue.recovery + fatigue.slowing * use,
            ]
        )

    time = 0.0
    weights = subject.pulse_weight(pulses.intensity, 20.0)
    onsets = (pulses.onset_ns - EPOCH_NS) / NANOSECONDS_PER_SECOND + subject.latency
    for onset, weight in zip(onsets, weights, strict=True):
        state = solve_ivp(rates, (time, onset), state, rtol=1e-9, atol=1e-12).y[:, -1]
        state[0] += weight * state[3] / state[4]
        time = onset
    final: FloatArray = solve_ivp(rates, (time, seconds), state, rtol=1e-9, atol=1e-12).y[:, -1]
    return np.array([peak * final[2], final[3], final[4]])


def test_fatigue_follows_its_differential_equations():
    muscle, pulses = living(TIRING, 20.0, RANDOM), PulseTrain.regular(RANDOM, 20.0, EPOCH_NS)
    force = muscle.force(epoch_grid(4.0) + MILLISECOND)[-1]
    state = muscle.state(EPOCH_NS)
    slow = state.time_constant / average_subject().time_constant
    expected = chain(average_subject(), pulses, TIRING.fatigue, 4.0)
    assert expected[1] < 0.75
    assert expected[2] > 1.1
    # fatigue moves in cells of 10 ms with the force at their end: an error of the order of the
    # change within one cell, 0.2/s times 10 ms
    np.testing.assert_allclose([force, state.fatigue, slow], expected, rtol=2e-3)


def test_a_tired_muscle_recovers_with_its_time_constant():
    muscle = living(TIRING)
    muscle.force(epoch_grid(3.5))
    tired = muscle.state(EPOCH_NS).fatigue
    assert tired < 0.8
    muscle.force(epoch_grid(23.5)[-1:])
    left = (1 - muscle.state(EPOCH_NS).fatigue) / (1 - tired)
    # 20 s of one recovery time constant; the last twitches still tire the muscle a little
    assert left == pytest.approx(np.exp(-1.0), rel=0.02)


def test_force_never_falls_below_the_lowest_gain():
    muscle = living(LivingSettings(Fatigue(force_loss=50.0, lowest_gain=0.2)))
    force = muscle.force(epoch_grid(3.0))
    assert muscle.state(EPOCH_NS).fatigue == pytest.approx(0.2, abs=0.01)
    assert (force >= 0.0).all()


def test_potentiation_grows_towards_its_largest_value_and_fades():
    growing = LivingSettings(potentiation=Potentiation(0.5, 0.2, 30.0))
    muscle = living(growing, intensity=np.ones(60))
    muscle.force(epoch_grid(3.0))
    grown = muscle.state(EPOCH_NS).potentiation
    assert 0.45 < grown < 0.5
    muscle.force(epoch_grid(33.0)[-1:])
    # one decay time constant later
    assert muscle.state(EPOCH_NS).potentiation == pytest.approx(grown * np.exp(-1.0), rel=0.01)


def test_a_moved_coil_shifts_the_curve():
    subject = simulation_subject()
    move = Change(1.0, threshold=0.56, saturation=1.06, gain=0.8)
    muscle = Contraction(subject, None, LivingSettings(changes=(move,)))
    muscle.begin(EPOCH_NS)
    u = np.linspace(0.0, 1.0, 11)
    before = muscle.steady_force(EPOCH_NS, u, 20.0)
    after = muscle.steady_force(EPOCH_NS + 2 * NANOSECONDS_PER_SECOND, u, 20.0)
    np.testing.assert_allclose(before, subject.steady_force(u, 20.0), rtol=1e-12)
    assert after[0] == pytest.approx(0.0, abs=1e-12)
    # what was reached at 0.7 now takes 0.08 more, but for the force at rest that moves as well
    moved = subject.recruitment(0.7 - 0.08) - subject.recruitment(-0.08)
    assert after[7] == pytest.approx(0.8 * subject.maximum_force * moved, rel=1e-9)


@pytest.mark.parametrize(
    'change',
    [Change(0.0, time_constant=0.05766), Change(0.0, threshold=0.56, saturation=1.06, gain=0.8)],
    ids=['slower', 'moved'],
)
@pytest.mark.parametrize('intensity', [0.8, 1.0])
def test_the_true_curve_is_the_force_of_a_train(change, intensity):
    subject = simulation_subject()
    changing = LivingSettings(changes=(change,))
    muscle = living(changing, 20.0, np.full(100, intensity), subject)
    mean = muscle.force(epoch_grid(5.0))[4000:].mean()
    truth = muscle.steady_force(EPOCH_NS, np.array([intensity]), 20.0)[0]
    # the mean over whole periods, sampled every millisecond
    assert mean == pytest.approx(truth, rel=1e-4)
    if change.gain is None:
        assert truth == pytest.approx(subject.steady_force(intensity, 20.0))


HIGHER = Change(0.0, threshold=0.9)


@pytest.mark.parametrize(
    ('changes', 'found'),
    [
        # the subject has 0.48 and 0.98
        ((Change(2.0, threshold=0.95),), '0.98 and 0.95 at 2 s'),
        ((Change(1.0, threshold=0.8), Change(3.0, saturation=0.82)), '0.82 and 0.8 at 3 s'),
        # a saturation that falls faster than a threshold meets it on the way
        (
            (HIGHER, Change(1.0, 1.0, saturation=0.4), Change(2.0, threshold=0.3)),
            '0.4 and 0.9 at 2 s',
        ),
    ],
)
def test_threshold_and_saturation_stay_apart(changes, found):
    message = f'expected a saturation at least 0.05 above the threshold, got {found}'
    with pytest.raises(MuscleError, match=message):
        living(LivingSettings(changes=changes))
