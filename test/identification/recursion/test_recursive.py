# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recursion for people: convergence, intervals, changes, and laws that hold always."""

import math

import numpy as np
import pytest

import rpms_ros
from rpms_ros.identification import (
    CONVERGED,
    NOT_INFORMED,
    FixedSizeRecursion,
    ModifiedRecursiveLM,
    StreamSettings,
    identify,
)
from rpms_ros.identification.quality.doubts import CHANGED_LATELY, INTERVALS_VARY
from rpms_ros.identification.recursion.recursive import ChangeTest
from rpms_ros.muscle import average_subject, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain

CHANGED_S = 40
BOTH = (FixedSizeRecursion, ModifiedRecursiveLM)


def test_random_intensities_show_the_curve_within_ten_seconds(session):
    found = session(seed=1)
    estimator = FixedSizeRecursion()
    estimate = found.fit(estimator, 10.0)
    # bench/recursion_people.py: worst of 20 seeds below 0.5 %.
    assert found.curve_error(estimate) < 0.01
    assert estimate.confidence == 0.95
    names = dict(zip(estimate.physiology_names, estimate.physiology, strict=True))
    # The twitch of so much data is read to about 1.5 ms.
    subject = average_subject()
    time_constant, latency = names['twitch_time_constant_s'], names['latency_s']
    assert time_constant == pytest.approx(subject.time_constant, abs=3e-3)
    assert latency == pytest.approx(subject.latency, abs=3e-3)
    found.feed(estimator, 10.0, 20.0)
    estimate = estimator.estimate(0, {})
    assert (estimate.nonlinear_identifiability[:2] == CONVERGED).all()
    assert estimate.changes == 0
    assert estimate.faults == {}


def test_a_muscle_without_a_latency_costs_little(session):
    found = session(seed=12, subject=simulation_subject())
    # As the page says: functions that begin 8 ms late bend the curve by 0.4 %.
    assert found.curve_error(found.fit(FixedSizeRecursion(), 20.0)) < 0.01


def test_doublets_on_a_muscle_that_adds_its_pulses_are_doubted(league):
    """Eq. (10) weighs the second of two pulses 8 ms apart otherwise: wrong by half."""
    arrays, truth = league.session('doublets', 'random', 0)
    found = rpms_ros.from_arrays(*arrays).identify('recursive')
    assert np.abs(found.estimates.last.curve_force - truth).max() > 0.3 * truth.max()
    assert found.estimates.last.doubts == (INTERVALS_VARY,)
    assert found.verdict.grade == 'doubtful'


@pytest.mark.parametrize(
    ('muscle', 'excitation', 'seed', 'most'),
    [
        ('boltzmann', 'random', 0, 0.2),
        ('gauss', 'random', 1, 0.4),
        ('unsaturated', 'sinusoid', 0, 0.4),
        ('pools', 'sinusoid', 0, 1.0),
    ],
)
def test_recruitment_of_any_shape(league, muscle, excitation, seed, most):
    """Arctangents alone leave 0.5, 0.7, 6 and 38 % of the maximum."""
    arrays, truth = league.session(muscle, excitation, seed)
    last = rpms_ros.from_arrays(*arrays).identify('recursive').estimates.last
    error = 100.0 * np.abs(last.curve_force - truth) / truth.max()
    assert error.max() < most
    inside = (last.curve_lower <= truth) & (truth <= last.curve_upper)
    assert inside[5:].mean() > 0.8


@pytest.mark.parametrize('seed', range(3))
def test_a_muscle_that_answers_later_than_the_functions_is_inside_the_interval(league, seed):
    """Under a slow sinusoid another course explains as much: off by 9 to 22 %, 4 to 12 stated."""
    one = league.person(np.random.default_rng(seed)) | {'latency': 14e-3}
    generator = np.random.default_rng(seed)
    arrays, _ = league.simulated(['arctan'], 'sinusoid', one, generator)
    last = rpms_ros.from_arrays(*arrays).identify('recursive').estimates.last
    grid = last.response_time
    force, top = league.contraction(['arctan'], grid, np.zeros(1), np.ones(1), one, generator)
    truth = 10.0 / top.max() * force
    inside = (last.response_lower <= truth) & (truth <= last.response_upper)
    assert inside.mean() > 0.95
    # what it costs where they begin in time
    one['latency'] = 9e-3
    arrays, _ = league.simulated(['arctan'], 'sinusoid', one, generator)
    last = rpms_ros.from_arrays(*arrays).identify('recursive').estimates.last
    assert (last.response_upper - last.response_lower).max() < 0.25 * truth.max()


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_pulses_that_were_not_heard_bend_no_curve(league, excitation):
    """One in a hundred: at full weight they bend it by 13 to 61 % of the maximum."""
    arrays, truth = league.session('lost', excitation, 1)
    last = rpms_ros.from_arrays(*arrays).identify('recursive').estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.01 * truth.max()


def test_single_pulses_among_slow_ones_are_of_one_clock(league):
    """The echo of each in what the pulse before foretells was taken for an answer ahead."""
    kinds, excitation, one, generator = league.drawn(377, league.MUSCLES)
    assert (kinds, excitation) == (['arctan'], 'catch')
    arrays, _ = league.simulated(kinds, excitation, one, generator)
    found = rpms_ros.from_arrays(*arrays).identify('recursive', rate_hz=one['rate'])
    assert found.verdict.grade == 'good'


def test_below_the_lowest_intensity_the_interval_begins_at_no_force(league):
    """No pulse was below 0.3; that the force begins with a corner there, none of them tells."""
    kinds, excitation, one, generator = league.drawn(325, league.MUSCLES)
    assert (kinds, excitation) == (['weibull'], 'upper')
    arrays, truth = league.simulated(kinds, excitation, one, generator)
    found = rpms_ros.from_arrays(*arrays).identify('recursive', rate_hz=one['rate'])
    last = found.estimates.last
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).all()
    assert last.curve_lower[:30].max() <= 0.0
    assert found.verdict.grade == 'good'  # of the intensities that were given


@pytest.mark.parametrize('number', [26, 77, 79])
def test_the_weight_of_the_first_pulse_is_not_known(league, number):
    """By Eq. (10) it is 5 to 21 % above the others, in this muscle it is not: 2 to 3 % off."""
    kinds, excitation, one, generator = league.drawn(number, ['arctan'])
    assert (kinds, excitation) == (['arctan'], 'upper')
    arrays, truth = league.simulated(kinds, excitation, one, generator)
    last = rpms_ros.from_arrays(*arrays).identify('recursive', rate_hz=one['rate']).estimates.last
    assert np.abs(last.curve_force - truth)[30:].max() < 0.005 * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).all()


@pytest.mark.parametrize('number', [47, 69, 78, 82, 115, 120, 131, 172, 184])
def test_unheard_pulses_irregular_intervals_and_glitches_are_no_change(league, number):
    """Some were taken for a change (40 to 51 % off), some bent the curve from the first second on.

    By 7 to 19 %, while what is missing had the weight of all else.
    """
    *_, one, arrays, truth = league.steady(number, 30.0)
    last = rpms_ros.from_arrays(*arrays).identify('recursive', rate_hz=one['rate']).estimates.last
    assert last.changes == 0
    assert np.abs(last.curve_force - truth).max() < 0.02 * truth.max()


def test_another_start_is_compared_with_a_fit_that_follows_its_prior(league):
    """A deviation far outside its new prior cost so much that a wrong start was taken: 1 N off."""
    *_, one, (time, force, onset, intensity), _ = league.steady(145)
    early, heard = time < 27.0, onset < 27.0
    recording = rpms_ros.from_arrays(time[early], force[early], onset[heard], intensity[heard])
    found = recording.identify('recursive', rate_hz=one['rate'])
    # noise of 0.05 N
    assert np.abs(force[early] - found.estimates.prediction)[20_000:].max() < 0.5


def test_the_origin_of_the_clock_changes_nothing(league):
    """Stamps near zero were taken for those after a gap."""
    (time, force, onset, intensity), _ = league.session('arctan', 'random', 0, 5.0)
    stamp_ns, onset_ns = (np.round(1e9 * at).astype(np.int64) for at in (time, onset))
    curves = []
    for origin_ns in (0, 1_700_000_000_000_000_000):
        estimator = FixedSizeRecursion()
        estimator.add_pulses(onset_ns + origin_ns, intensity)
        estimator.update(stamp_ns + origin_ns, force, np.ones(len(force), dtype=np.bool_))
        curves.append(estimator.estimate(0, {}).curve_force)
    assert curves[0].tobytes() == curves[1].tobytes()


@pytest.mark.parametrize('number', [56, 188])
def test_a_new_intensity_and_pulses_unheard_one_after_the_other_are_no_change(league, number):
    *_, one, (time, force, onset, intensity), _ = league.steady(number)
    last = 20.0 if number == 56 else 230.0
    early, heard = time < last, onset < last
    recording = rpms_ros.from_arrays(time[early], force[early], onset[heard], intensity[heard])
    assert recording.identify('recursive', rate_hz=one['rate']).estimates.last.changes == 0


@pytest.mark.parametrize(('number', 'situation'), [(152, 'effort'), (659, 'filter')])
def test_an_effort_and_a_filter_where_no_intensity_is_low_are_doubted_by_name(
    league, number, situation
):
    """Errors of 5 and 7 %, outside the interval."""
    kinds, excitation, one, generator = league.drawn(number, league.MUSCLES)
    assert kinds[1:] == [situation]
    arrays, _ = league.simulated(kinds, excitation, one, generator)
    found = rpms_ros.from_arrays(*arrays).identify('recursive', rate_hz=one['rate'])
    assert found.verdict.grade != 'good'
    assert 'residuals_alike' in found.estimates.last.doubts


@pytest.mark.parametrize('estimator', ['recursive', 'batch'])
def test_the_arctangents_alone_are_the_paper_s(league, estimator):
    arrays, truth = league.session('boltzmann', 'random', 0)
    found = rpms_ros.from_arrays(*arrays).identify(estimator, preset='arctan')
    # what the family of the paper leaves of this muscle
    error = np.abs(found.estimates.last.curve_force - truth).max() / truth.max()
    assert 0.003 < error < 0.006


def test_a_slow_sinusoid_shows_the_curve_after_two_periods(session):
    found = session(seed=2, period=18.0, seconds=40.0)
    # bench/recursion_people.py: worst of 20 seeds below 0.5 %.
    assert found.curve_error(found.fit(FixedSizeRecursion(), 36.0)) < 0.02


@pytest.mark.long
def test_intervals_hold_the_truth(session):
    held, width = [], []
    for seed in range(6):
        found = session(seed=seed, period=(None, 9.0)[seed % 2], seconds=15.0)
        estimator = FixedSizeRecursion()
        estimate = found.fit(estimator, 15.0)
        inside = (estimate.curve_lower <= found.curve) & (found.curve <= estimate.curve_upper)
        held.append(inside[5:].mean())
        width.append((estimate.curve_upper - estimate.curve_lower).max() / found.curve.max())
    # Six sessions, points of a curve that go together; 50 and more stand in the benchmark.
    assert np.mean(held) > 0.8
    # Not by being wide: 2 % of the curve at the most.
    assert max(width) < 0.04


@pytest.mark.long
@pytest.mark.parametrize('kind', ['gain step', 'coil moved', 'slower', 'baseline'])
def test_a_change_is_found_and_learnt_anew(living_sessions, kind):
    what = living_sessions.session('steady' if kind == 'baseline' else kind, 'random', 0, 50.0)
    if kind == 'baseline':
        what = what._replace(force=what.force + 1.0 * (what.stamp_ns >= CHANGED_S * 1e9))
    estimator = FixedSizeRecursion()
    what.feed(estimator, 0.0, 40.0)
    assert estimator.estimate(40_000_000_000, {}).changes == 0
    what.feed(estimator, 40.0, 42.5)
    estimate = estimator.estimate(42_500_000_000, {})
    assert (estimate.changes, estimate.change_kinds) == (1, ('unknown',))
    # Within a block or two of the first pulse that the changed muscle answers.
    assert estimate.change_ago[-1] == pytest.approx(2.5, abs=0.25)
    assert CHANGED_LATELY in estimate.doubts
    what.feed(estimator, 42.5, 50.0)
    # A muscle that is learnt anew needs 5 s and more for it.
    estimate = estimator.estimate(0, {})
    assert what.curve_error(estimate) < 0.01
    assert CHANGED_LATELY not in estimate.doubts


@pytest.mark.long
@pytest.mark.parametrize(('excitation', 'seconds'), [('random', 5.0), ('sinusoid', 20.0)])
def test_a_change_is_lately_for_longer_on_a_slow_course(living_sessions, excitation, seconds):
    what = living_sessions.session('coil moved', excitation, 0, 66.0)
    pulses = PulseTrain.regular(what.intensity, 20.0, 1_000)
    settings = StreamSettings(estimate_period=0.5)
    found = identify(FixedSizeRecursion(), pulses, ForceTrace(what.stamp_ns, what.force), settings)
    ago = [one.change_ago[-1] for one in found.estimates if CHANGED_LATELY in one.doubts]
    assert [one.changes for one in found.estimates][-1] == 1
    assert seconds - 0.5 <= max(ago) < seconds + 2.5


@pytest.mark.long
def test_a_coil_that_slips_under_a_staircase_is_in_doubt_after_a_change(league):
    kinds, excitation, one, generator = league.drawn(51, league.MUSCLES)
    arrays, _ = league.simulated(kinds, excitation, one, generator)
    assert (kinds, excitation) == (['arctan', 'slip'], 'staircase')
    found = rpms_ros.from_arrays(*arrays).identify('recursive', most_estimates=1)
    assert CHANGED_LATELY in found.estimates.last.doubts


def test_blocks_change_no_bit_where_the_muscle_changes(living_sessions, images):
    what = living_sessions.session('coil moved', 'random', 0, 50.0)
    whole, cut = FixedSizeRecursion(), FixedSizeRecursion()
    expected = what.feed(whole, 0.0, 43.0)
    # Before the change is certain.
    cuts = (40_111, 40_333, 40_777)
    assert what.feed(cut, 0.0, 43.0, cuts).tobytes() == expected.tobytes()
    estimates = [one.estimate(43_000_000_000, {}) for one in (whole, cut)]
    assert images(estimates[:1]) == images(estimates[1:])


@pytest.mark.parametrize('build', BOTH)
def test_a_prediction_knows_nothing_of_its_own_or_later_samples(session, build):
    found = session(seed=5, seconds=4.0)
    expected = found.feed(build())
    force = found.force.copy()
    force[2000:] = 99.0
    prediction = found._replace(force=force).feed(build())
    np.testing.assert_array_equal(prediction[:2001], expected[:2001])
    assert prediction[2300] != expected[2300]


def test_silence_and_pulses_of_nothing_forget_nothing(session):
    found = session(seed=7, seconds=72.0, rest_from=12.0)
    estimator = FixedSizeRecursion()
    before = found.fit(estimator, 12.0)
    found.feed(estimator, 12.0, 72.0)
    after = estimator.estimate(0, {})
    distance = np.abs(after.curve_force - before.curve_force).max() / before.curve_force.max()
    # The tail of the last pulses still says a little.
    assert distance < 0.005
    assert after.changes == 0


@pytest.mark.parametrize('build', BOTH)
@pytest.mark.parametrize('others', [0.8, 0.0])
def test_one_intensity_gives_no_curve(recorded, build, others):
    intensity = np.full(100, 0.8)
    intensity[::4] = others
    found = recorded(5.0, intensity).fit(build())
    assert not found.curve_known
    assert len(found.curve_force) == 0
    assert found.response_force.max() > 0.0


def test_intensities_below_the_threshold_do_not_inform(session):
    found = session(seed=9, seconds=10.0)
    low = found._replace(
        intensity=0.1 * found.intensity,
        force=0.05 * np.random.default_rng(2).standard_normal(len(found.force)),
    )
    estimator = FixedSizeRecursion()
    low.feed(estimator, 0.0, 10.0)
    flags = estimator.estimate(0, {}).nonlinear_identifiability
    assert (flags[1:] == NOT_INFORMED).all()


def test_a_jump_of_the_clock_costs_the_pulses_that_act_alone(session):
    found = session(seed=10, seconds=20.0)
    estimator = FixedSizeRecursion()
    found.feed(estimator, 0.0, 10.0)
    # a time before the jump is none after it
    estimator._test.changes, estimator._test.changed_ns = 1, 9_000_000_000
    assert estimator.estimate(10_000_000_000, {}).change_ago == [1.0]
    estimator.forget_pulses()
    after = estimator.estimate(0, {})
    assert (after.changes, after.change_kinds, len(after.change_ago)) == (1, (), 0)
    back = found._replace(
        onset_ns=found.onset_ns - 3_600_000_000_000, stamp_ns=found.stamp_ns - 3_600_000_000_000
    )
    later = slice(11_000, 20_000)
    pulses = back.onset_ns >= back.stamp_ns[10_200]
    estimator.add_pulses(back.onset_ns[pulses], back.intensity[pulses])
    estimator.update(back.stamp_ns[later], back.force[later], np.ones(9000, dtype=np.bool_))
    estimate = estimator.estimate(0, {})
    assert math.isfinite(estimate.output_error)
    assert found.curve_error(estimate) < 0.01


def test_a_matrix_without_a_factor_is_counted(session):
    found = session(seed=11, seconds=4.0)
    estimator = FixedSizeRecursion()
    found.feed(estimator, 0.0, 2.0)
    before = estimator.estimate(0, {}).nonlinear
    # What overwritten memory would leave.
    estimator._memory.gram[:] = -1e6 * np.eye(len(estimator._memory.gram))
    found.feed(estimator, 2.0, 2.2)
    found = estimator.estimate(0, {})
    np.testing.assert_array_equal(found.nonlinear, before)
    assert found.faults['factorisation_failed'] > 0


def test_a_twitch_may_begin_at_the_stamp_of_the_only_sample_of_a_block(session):
    found = session(seed=14, seconds=4.0)
    estimator = FixedSizeRecursion()
    latency_ns = round(1e9 * estimator.settings.basis.latency)
    # a twitch that begins with the first sample, and one with the sample after a longest block
    onset = np.array([-latency_ns, 502_000_000 - latency_ns])
    estimator.add_pulses(onset, np.array([0.8, 0.8]))
    usable = np.ones(len(found.force), dtype=np.bool_)
    estimator.update(found.stamp_ns, found.force, usable)
    assert np.isfinite(estimator.estimate(0, {}).curve_force).all()


def test_samples_are_predicted_as_they_will_be_taken(session):
    found = session(seed=15, seconds=8.0)
    estimator = FixedSizeRecursion()
    assert (estimator.predict(found.stamp_ns[:10]) == 0.0).all()
    found.feed(estimator, 0.0, 6.0)
    # nothing is learnt any more: no parameter moves
    none = np.zeros(1000, dtype=np.bool_)
    for first in (6, 7):
        pulses = (found.onset_ns >= 1e9 * first) & (found.onset_ns < 1e9 * (first + 1))
        estimator.add_pulses(found.onset_ns[pulses], found.intensity[pulses])
        part = slice(1000 * first, 1000 * (first + 1))
        predicted = estimator.predict(found.stamp_ns[part])
        assert estimator.predict(found.stamp_ns[part]).tobytes() == predicted.tobytes()
        taken = estimator.update(found.stamp_ns[part], found.force[part], none)
    np.testing.assert_allclose(predicted, taken, atol=1e-9 * np.abs(found.force).max())


@pytest.mark.parametrize('scale', [1e-3, 1e3])
def test_the_unit_of_force_changes_no_time_of_a_change(scale):
    square = np.random.default_rng(0).chisquare(50, 400) / 50.0
    square[200:] *= 4.0

    def found(unit: float) -> list[int]:
        test = ChangeTest()
        return [
            at
            for at, one in enumerate(square)
            if test.take(at, 0.05, unit**2 * one, unit, 0.0, True)[1]
        ]

    assert found(1.0)[0] in range(205, 230)
    assert found(scale) == found(1.0)


def test_errors_after_a_change_have_a_deviation():
    """A mean that stood from before left rounding in its place, below zero in some."""
    for seed in range(5):
        square = np.random.default_rng(seed).chisquare(50, 300) / 5000.0
        square[200:] *= 30.0
        test = ChangeTest()
        for one in square:
            assert 0.0 < test.take(0, 0.05, one, 1.0, 0.0, True)[0] <= 1.0
        assert test.changes == 1


def test_errors_that_grow_with_the_force_are_no_change():
    """With a slow sinusoid those of the upper half follow each other for seconds."""
    generator = np.random.default_rng(0)
    force = 5.0 - 5.0 * np.cos(2.0 * np.pi * np.arange(2000) / 180.0)
    square = (0.01 + (0.05 * force) ** 2) * generator.chisquare(10, 2000) / 10.0
    test = ChangeTest()
    assert not any(
        test.take(0, 0.05, *one, 0.0, True)[1] for one in zip(square, force, strict=True)
    )


def test_a_glitch_between_the_pulses_weighs_little_and_a_lasting_shift_all():
    test = ChangeTest()
    for one in np.random.default_rng(0).chisquare(50, 200) / 50.0:
        test.take(0, 0.05, one, 1.0, 0.0, True)
    weights = [test.take(0, 0.5, one, 0.0, 0.0, False)[0] for one in (1.0, 100.0, 1.0, 1.0)]
    assert weights[1] < 0.03
    assert min(weights[0], *weights[2:]) == 1.0
    weights = [test.take(0, 0.5, 100.0, 0.0, 0.0, False)[0] for _ in range(3)]
    assert weights[0] < 0.03
    assert weights[2] == 1.0
    assert test.changes == 0
