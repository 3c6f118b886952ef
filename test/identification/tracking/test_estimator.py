# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tracking estimator on a muscle that changes, and on one that does not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import rpms_ros
from rpms_ros.identification import identify
from rpms_ros.identification.estimation import window_fit
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.estimate import CONVERGED
from rpms_ros.identification.quality.doubts import (
    BAND_WIDER_THAN_CURVE,
    CHANGED_LATELY,
    DISTURBANCE_FOLLOWS,
    DISTURBANCE_LIVELY,
    NOT_ISOMETRIC,
)
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain

pytestmark = pytest.mark.long

HALF_SECOND = 500


def run(session, estimator=None):
    """Return an estimator after a session, and the estimate after every half second."""
    estimator = TrackingEstimator() if estimator is None else estimator
    estimator.add_pulses(session.onset_ns, session.intensity)
    estimates = []
    for first in range(0, len(session.stamp_ns), HALF_SECOND):
        part = slice(first, first + HALF_SECOND)
        usable = np.ones(len(session.stamp_ns[part]), dtype=bool)
        estimator.update(session.stamp_ns[part], session.force[part], usable)
        estimates.append(estimator.estimate(int(session.stamp_ns[part][-1]), {}))
    return estimator, estimates


def errors(session, estimates):
    """Return the worst error of each curve, as a share of its maximum."""
    pairs = zip(estimates, session.curve, strict=True)
    return np.array(
        [
            np.abs(one.curve_force - curve).max() / curve.max() if one.curve_known else np.inf
            for one, curve in pairs
        ]
    )


def held(session, estimates):
    """Return which share of each curve lies within its band."""
    pairs = zip(estimates, session.curve, strict=True)
    return np.array(
        [
            np.mean((one.curve_lower[5:] <= curve[5:]) & (curve[5:] <= one.curve_upper[5:]))
            if one.curve_known
            else 0.0
            for one, curve in pairs
        ]
    )


def test_an_interval_that_is_wider_than_the_curve_is_doubted(living_sessions):
    _, estimates = run(living_sessions.session('steady', 'random', 0, 2.0))
    known = [one for one in estimates if one.curve_known and len(one.curve_upper)]
    wider = [np.ptp([e.curve_lower, e.curve_upper], 0).max() > e.curve_force.max() for e in known]
    doubted = [BAND_WIDER_THAN_CURVE in one.doubts for one in known]
    assert (wider[0], doubted[0]) == (True, True)
    assert (wider[-1], doubted[-1]) == (False, False)


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_steady_muscle(living_sessions, excitation):
    session = living_sessions.session('steady', excitation, 3, 20.0)
    _, estimates = run(session)
    late = session.noted_s > 15.0
    # 0.5 % noise, 300 pulses: 0.05 to 0.15 % by the covariance
    assert errors(session, estimates)[late].max() < 0.004
    assert held(session, estimates)[late].mean() > 0.85
    last = estimates[-1]
    assert last.changes == 0
    assert not last.reasons
    assert (last.nonlinear_identifiability == CONVERGED).all()
    assert last.rate_names[0] == 'force_percent'
    assert abs(last.rate[0]) < 1.0


def test_a_muscle_that_pushes_is_doubted(living_sessions):
    session = living_sessions.session('steady', 'random', 3, 6.0)
    _, estimates = run(session._replace(force=-session.force))
    assert estimates[-1].curve_known
    assert estimates[-1].curve_force[-1] < 0.0
    assert estimates[-1].doubts == ('curve_negative', 'response_negative')
    assert 'the curve is negative: a muscle does not push' in estimates[-1].reasons


def test_a_basis_can_be_adopted_while_a_change_is_looked_for(living_sessions, monkeypatch):
    """An estimate was made with a knot more than its covariance had, and failed."""
    session = living_sessions.session('steady', 'random', 3, 13.0)
    estimator = TrackingEstimator()
    estimator.add_pulses(session.onset_ns, session.intensity)

    def add(first, last):
        part = slice(first, last)
        usable = np.ones(last - first, dtype=bool)
        estimator.update(session.stamp_ns[part], session.force[part], usable)

    add(0, 12_000)
    before = len(estimator._window.point.gain)
    # no fit follows while it is not known what has changed
    monkeypatch.setattr(estimator, '_step', lambda: None)
    add(12_000, 12_900)
    basis = estimator._basis
    estimator._adopt(estimator._choice().explained(basis), basis)
    assert len(estimator._window.point.gain) == before + 1
    assert len(estimator.estimate(int(session.stamp_ns[12_899]), {}).rate) == 4


def test_a_muscle_that_tires(living_sessions):
    session = living_sessions.session('fatigue', 'random', 1, 40.0)
    _, estimates = run(session)
    late = session.noted_s > 15.0
    # half a percent is asked for
    assert errors(session, estimates)[late].max() < 0.005
    per_minute = 60.0 * np.gradient(session.gain, session.noted_s)[-5] / session.gain[-5]
    last = estimates[-1]
    # the rate is the mean over the last five seconds
    assert last.rate[0] == pytest.approx(100.0 * per_minute, rel=0.2)
    # no muscle tires evenly: 1.96 times 6 % of the rate at least (bench/rates.py)
    half = 0.5 * (last.rate_upper - last.rate_lower)
    assert half[0] > 0.11 * abs(last.rate[0])
    assert half[0] < 0.3 * abs(last.rate[0])
    assert last.changes == 0


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_moved_coil_is_found_named_and_followed(living_sessions, excitation):
    session = living_sessions.session('coil moved', excitation, 0, 48.0)
    _, estimates = run(session)
    changes = np.array([one.changes for one in estimates])
    assert changes[session.noted_s <= 40.0].max() == 0
    # a slow sinusoid shows it later: half a second of deliberation comes after
    assert changes[session.noted_s >= (41.0 if excitation == 'random' else 41.5)].min() == 1
    last = estimates[-1]
    assert last.change_kinds == ('thresholds',)
    assert last.change_ago[0] == pytest.approx(8.0, abs=0.5)
    assert errors(session, estimates)[-1] < 0.01
    assert last.nonlinear[0] == pytest.approx(0.56, abs=0.01)


def test_what_the_muscle_before_a_move_leaves_is_no_tremor(living_sessions):
    session = living_sessions.session('coil moved', 'random', 8, 48.0)
    _, estimates = run(session)
    # 5 s after the move: as asked for
    assert errors(session, estimates)[session.noted_s > 45.0].max() < 0.01
    assert not any('tremor' in reason for one in estimates for reason in one.reasons)


@pytest.mark.parametrize(
    ('excitation', 'seed', 'seconds'), [('random', 1, 46.0), ('sinusoid', 2, 50.0)]
)
def test_a_slower_twitch_is_named_dynamics(living_sessions, excitation, seed, seconds):
    """Under the sinusoid a drift of the thresholds, which begins with it, took it up: 5 %."""
    session = living_sessions.session('slower', excitation, seed, seconds)
    _, estimates = run(session)
    assert estimates[-1].change_kinds == ('dynamics',)
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.01


def test_a_change_that_is_named_wrongly_does_not_keep_the_muscle_wrong(living_sessions):
    """This slower twitch was taken for a moved coil, so the twitch was kept: 14 % after 8 s."""
    session = living_sessions.session('slower', 'sinusoid', 9, 50.0)
    _, estimates = run(session)
    # eight seconds after the change; 1 % is asked for after a move of the coil
    assert errors(session, estimates)[session.noted_s > 48.0].max() < 0.01


def test_voluntary_effort_is_not_the_muscle(living_sessions):
    session = living_sessions.session('bursts', 'random', 0, 33.0)
    _, estimates = run(session)
    late = session.noted_s > 15.0
    assert errors(session, estimates)[late].max() < 0.01
    assert estimates[-1].changes == 0
    # the patient tenses from 30 s to 31.5 s with 2 N in the middle; an estimate is up to a
    # quarter of a second behind, in which the force changes by half a newton near the top
    tensed = [one.disturbance for one in estimates[60:64]]
    assert max(tensed) == pytest.approx(2.0, abs=0.5)
    assert estimates[-1].disturbance == pytest.approx(0.0, abs=0.1)


def test_an_effort_under_a_sinusoid_does_not_mislead_the_basis(living_sessions):
    """An effort is not quite linear between its knots, and a wrong basis makes use of that."""
    session = living_sessions.session('bursts', 'sinusoid', 0, 36.0)
    _, estimates = run(session)
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.01
    inside = [
        np.mean((one.curve_lower <= curve) & (curve <= one.curve_upper))
        for one, curve in zip(estimates, session.curve, strict=True)
        if one.curve_known
    ]
    # 90 % are asked for, of many sessions
    assert np.mean(inside[30:]) > 0.9


def unheard(session, places):
    """Return a session some of whose pulses nobody was told of."""
    pulses = {
        name: np.delete(getattr(session, name), places) for name in ('onset_ns', 'intensity')
    }
    return session._replace(**pulses)


@pytest.mark.parametrize('what', ['gives way', 'unheard'])
def test_after_a_short_event_the_muscle_is_the_same(living_sessions, what):
    """It was named a change, and the curve was wrong by a third and more for ten seconds."""
    session = living_sessions.session('steady', 'random', 3, 30.0)
    seconds = session.stamp_ns / 1e9
    if what == 'gives way':
        away = (seconds > 20.0) & (seconds < 20.4)
        session = session._replace(force=np.where(away, 0.4 * session.force, session.force))
    else:
        strong = np.flatnonzero((session.onset_ns > 20_000_000_000) & (session.intensity > 0.9))
        session = unheard(session, strong[0])
    _, estimates = run(session)
    assert estimates[-1].changes == 0
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.01


@pytest.mark.parametrize('seed', [0, 1])
def test_unheard_pulses_under_a_sinusoid_are_no_change(living_sessions, seed):
    """The disturbance took them up, and the muscle with them; the curve was 101 % wrong."""
    session = living_sessions.session('steady', 'sinusoid', seed, 36.0)
    lost = np.flatnonzero(np.random.default_rng(seed).uniform(size=len(session.onset_ns)) < 0.01)
    session = unheard(session, lost)
    _, estimates = run(session)
    assert len(lost) > 4
    assert estimates[-1].changes == 0
    away = errors(session, estimates)
    # one at the threshold, when the force falls, is told from the muscle at the next rise
    assert away[session.noted_s > 15.0].max() < 0.05
    assert away[-1] < 0.005


def test_a_sensor_with_a_sample_in_an_interval_can_be_fitted(living_sessions):
    """Its disturbance has two unknowns in each interval, which a sample does not tell."""
    session = living_sessions.session('steady', 'random', 3, 20.0)
    slow = slice(None, None, 97)
    _, estimates = run(
        session._replace(stamp_ns=session.stamp_ns[slow], force=session.force[slow])
    )
    assert estimates[-1].curve_known


def test_an_effort_before_the_muscle_is_known_does_not_hold_the_fit(living_sessions):
    """Taken for the muscle, an effort at 6 s left the fit 30 % wrong for at least five seconds.

    No disturbance a little livelier than a drift explains it better than another muscle does.
    """
    session = living_sessions.session('bursts', 'sinusoid', 15, 15.0)
    _, estimates = run(session)
    error = errors(session, estimates)
    assert error[session.noted_s >= 6.0].max() < 0.15
    assert error[session.noted_s > 12.0].max() < 0.01


@pytest.mark.parametrize(
    ('time_constant', 'latency', 'order'), [(10e-3, 9e-3, 3), (70e-3, 24e-3, 3), (40e-3, 5e-3, 2)]
)
def test_latency_and_time_constant_need_not_be_known(
    living_sessions, time_constant, latency, order
):
    subject = replace(
        living_sessions.SUBJECT, time_constant=time_constant, latency=latency, order=order
    )
    session = living_sessions.session('steady', 'random', 1, 18.0, subject)
    _, estimates = run(session)
    assert errors(session, estimates)[-4:].max() < 0.005
    found = dict(zip(estimates[-1].physiology_names, estimates[-1].physiology, strict=True))
    assert found['twitch_time_constant_s'] == pytest.approx(time_constant, rel=0.1)
    assert found['latency_s'] == pytest.approx(latency, abs=2e-3)
    assert found['order'] == pytest.approx(order, rel=0.1)


@pytest.mark.parametrize(('latency', 'time_constant'), [(30e-3, 38.44e-3), (9e-3, 70e-3)])
def test_a_sinusoid_tells_latency_and_time_constant_too(living_sessions, latency, time_constant):
    """With the disturbance of a wrong basis every basis explains a slow sinusoid."""
    subject = replace(living_sessions.SUBJECT, time_constant=time_constant, latency=latency)
    session = living_sessions.session('steady', 'sinusoid', 2, 20.0, subject)
    _, estimates = run(session)
    late = session.noted_s > 15.0
    # half a percent is asked for
    assert errors(session, estimates)[late].max() < 0.005


def test_a_slow_muscle_under_a_sinusoid_that_begins_low(living_sessions):
    """The first samples tell little; a basis that does not fit them any worse must not stay."""
    subject = replace(living_sessions.SUBJECT, time_constant=90e-3)
    session = living_sessions.session('steady', 'sinusoid', 0, 24.0, subject)
    _, estimates = run(session)
    # a third of what is asked for: 1.2 % were left by a basis that had been chosen too early
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.0017


def test_a_basis_is_looked_for_where_no_response_shows(living_sessions):
    """A basis far from the muscle leaves so much to the disturbance that no response shows."""
    subject = replace(living_sessions.SUBJECT, time_constant=8e-3)
    session = living_sessions.session('steady', 'sinusoid', 2, 20.0, subject)
    _, estimates = run(session)
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.005
    assert estimates[-1].changes == 0


def test_a_slow_twitch_is_no_tremor(living_sessions):
    """Random pulses of a slow muscle have a line of their own at some hertz.

    When its basis is found depends on the last digit, so on the processor: by then the intervals
    say how little is known.
    """
    subject = replace(living_sessions.SUBJECT, time_constant=90e-3)
    session = living_sessions.session('steady', 'random', 1, 30.0, subject)
    _, estimates = run(session)
    assert not any('tremor' in reason for one in estimates for reason in one.reasons)
    for late_s, one, curve in zip(session.noted_s, estimates, session.curve, strict=True):
        inside = (one.curve_lower <= curve) & (curve <= one.curve_upper)
        assert late_s <= 15.0 or inside[5:].mean() > 0.9
    assert errors(session, estimates)[-1] < 0.005


@pytest.mark.parametrize('seed', [0, 1])
def test_a_tremor_from_the_beginning_does_not_mislead_the_basis(living_sessions, seed):
    session = living_sessions.session('tremor', 'random', seed, 20.0)
    _, estimates = run(session)
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.01


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_tremor_is_not_the_muscle(living_sessions, excitation):
    session = living_sessions.session('tremor', excitation, 2, 20.0)
    _, estimates = run(session)
    late = session.noted_s > 15.0
    # 1 % is asked for; the tremor has 3 %
    assert errors(session, estimates)[late].max() < 0.01
    assert estimates[-1].changes == 0
    # without a unit: the samples may be torques
    told = 'a tremor of 8.0 Hz with an amplitude of 0.[0-9]+ is taken off'
    assert any(re.fullmatch(told, reason) for reason in estimates[-1].reasons)


def test_a_muscle_that_tires_under_a_sinusoid_has_not_changed_suddenly(living_sessions):
    """A muscle observed for half a period is known less than its covariance says."""
    session = living_sessions.session('fatigue', 'sinusoid', 1, 20.0)
    _, estimates = run(session)
    assert estimates[-1].changes == 0
    assert errors(session, estimates)[session.noted_s > 15.0].max() < 0.01


def test_the_cut_into_blocks_does_not_matter(living_sessions):
    session = living_sessions.session('bursts', 'random', 0, 33.0)
    samples = 12_000
    usable = np.ones(samples, dtype=bool)
    predictions, estimates = [], []
    for cuts in ([samples], [1, 249, 250, 251, 3001, 9999, samples]):
        estimator = TrackingEstimator()
        estimator.add_pulses(session.onset_ns[:240], session.intensity[:240])
        parts = np.split(np.arange(samples), cuts[:-1])
        predictions.append(
            np.concatenate(
                [
                    estimator.update(session.stamp_ns[part], session.force[part], usable[part])
                    for part in parts
                ]
            )
        )
        estimates.append(estimator.estimate(0, {}))
    assert predictions[0].tobytes() == predictions[1].tobytes()
    assert estimates[0].curve_upper.tobytes() == estimates[1].curve_upper.tobytes()


def test_a_jump_of_the_clock_keeps_what_is_known(living_sessions):
    session = living_sessions.session('steady', 'random', 3, 20.0)
    estimator, estimates = run(session)
    estimator.forget_pulses()
    after = estimator.estimate(0, {})
    np.testing.assert_array_equal(after.curve_force, estimates[-1].curve_force)
    shifted = session.stamp_ns - 50_000_000_000
    estimator.add_pulses(session.onset_ns - 50_000_000_000, session.intensity)
    usable = np.ones(len(shifted), dtype=bool)
    estimator.update(shifted[:2000], session.force[:2000], usable[:2000])
    again = estimator.estimate(0, {})
    # two seconds more of the same muscle: nothing that was known is lost
    assert np.abs(again.curve_force - session.curve[-1]).max() < 0.01 * session.curve[-1].max()


def test_a_change_before_a_jump_of_the_clock_has_no_time(living_sessions):
    session = living_sessions.session('coil moved', 'random', 3, 50.0)
    estimator, estimates = run(session)
    assert len(estimates[-1].change_ago) == estimates[-1].changes == 1
    estimator.forget_pulses()
    after = estimator.estimate(0, {})
    assert (after.changes, after.change_kinds, len(after.change_ago)) == (1, (), 0)


def test_more_pulses_than_there_is_room_for(living_sessions):
    session = living_sessions.session('steady', 'random', 3, 20.0)
    estimator, _ = run(session)
    onset = session.stamp_ns[-1] + 2_000_000 * np.arange(1, 20_001)
    estimator.add_pulses(onset, np.full(len(onset), 0.5))
    stamp = np.array([onset[-1] + 1])
    estimator.update(stamp, np.array([1.0]), np.array([True]))
    estimate = estimator.estimate(int(stamp[0]), {})
    assert np.isfinite(estimate.curve_force).all()


def test_nothing_is_looked_for_where_it_is_turned_off(living_sessions):
    session = living_sessions.session('coil moved', 'random', 0, 48.0)
    settings = TrackingSettings(find_changes=False, choose_basis=False)
    _, estimates = run(session, TrackingEstimator(settings))
    assert estimates[-1].changes == 0


def test_a_rest_of_exactly_zero_before_the_first_pulse_does_not_end_it():
    intensity = np.random.default_rng(1).uniform(0.0, 1.0, 60)
    pulses = PulseTrain.regular(intensity, 20.0, 500_000_000)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamp_ns = np.arange(4000, dtype=np.int64) * 1_000_000
    found = identify(TrackingEstimator(), pulses, ForceTrace(stamp_ns, muscle.force(stamp_ns)))
    # the subject pulls 10 N, without noise; 3 s of pulses
    assert found.estimates[-1].curve_force[-1] == pytest.approx(10.0, rel=0.05)


def test_a_fit_that_cannot_be_solved_knows_nothing_and_is_counted(living_sessions, monkeypatch):
    session = living_sessions.session('steady', 'random', 0, 10.0)
    estimator, before = run(session)

    def unsolved(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(window_fit, '_best_scales', unsolved)
    stamp_ns = session.stamp_ns[-1] + 1_000_000 * np.arange(1, 501)
    usable = np.ones(len(stamp_ns), dtype=bool)
    estimator.update(stamp_ns, np.zeros(len(stamp_ns)), usable)
    after = estimator.estimate(int(stamp_ns[-1]), {})
    assert after.faults['factorisation_failed'] > 0
    known = np.max(before[-1].curve_upper - before[-1].curve_lower)
    width = after.curve_upper - after.curve_lower
    assert not len(width) or np.max(width) > 1e3 * known


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_an_effort_that_follows_the_intensity_is_doubted(league, excitation):
    """A slow sinusoid does not tell it from recruitment: 9 % beside a band of 2 %."""
    (time, force, onset, intensity), truth = league.session('effort', excitation, 0)
    found = rpms_ros.from_arrays(time, force, onset, intensity).identify('tracking')
    last = found.estimates.last
    assert np.abs(last.curve_force - truth).max() > 0.02 * truth.max()
    assert last.doubts == (DISTURBANCE_FOLLOWS,)
    assert found.verdict.grade == 'doubtful'


def test_an_effort_that_is_in_the_curve_is_doubted_by_the_number_of_pulses(league):
    """6 % off within 0.7, and good: intensities explained a quarter of the disturbance."""
    kinds, excitation, one, generator = league.drawn(571, league.MUSCLES)
    arrays, truth = league.simulated(kinds, excitation, one, generator)
    assert (kinds, excitation) == (['weibull', 'effort'], 'random')
    found = rpms_ros.from_arrays(*arrays).identify('tracking', rate_hz=10.0, most_estimates=1)
    last = found.estimates.last
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9
    assert last.doubts == (DISTURBANCE_FOLLOWS,)


def test_a_little_that_runs_with_the_intensity_is_doubted(league):
    """Such as a strap with backlash: half a per cent moved the response by 40 %."""
    (time, force, *pulses), _ = league.session('arctan', 'sinusoid', 0, 40.0)
    friction = 0.03 * np.tanh(10.0 * np.sin(2.0 * np.pi * (time - 0.1) / 9.0))
    found = rpms_ros.from_arrays(time, force - friction, *pulses).identify('tracking')
    assert found.estimates.last.doubts == (DISTURBANCE_FOLLOWS,)


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_muscle_that_is_not_held_is_doubted(league, excitation):
    """A joint that swings: 15 % of the active force, 5 % of a passive one."""
    arrays, _ = league.session('length', excitation, 0, 25.0)
    found = rpms_ros.from_arrays(*arrays).identify('tracking')
    assert NOT_ISOMETRIC in found.estimates.last.doubts
    assert found.verdict.grade != 'good'


@pytest.mark.long
@pytest.mark.parametrize(
    ('muscle', 'excitation', 'seed'),
    [
        *(('pools', 'sinusoid', 0), ('pools', 'random', 0)),
        *(('gauss', 'sinusoid', 1), ('weibull', 'random', 0)),
    ],
)
def test_a_muscle_of_another_kind_has_a_narrow_interval(league, muscle, excitation, seed):
    """8 % where steps along a valley of the cost were not tried; 2 % where bases differ in it.

    3 % where the covariance was that of another point of the valley.
    """
    arrays, truth = league.session(muscle, excitation, seed)
    found = rpms_ros.from_arrays(*arrays).identify('tracking')
    last = found.estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.004 * truth.max()
    assert (last.curve_upper - last.curve_lower).max() < 0.015 * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9
    assert found.verdict.grade == 'good'


@pytest.mark.long
def test_no_large_deviation_makes_up_for_arctangents_that_are_elsewhere(league):
    """7 % at the largest intensity, to which noise had bent the deviation."""
    arrays, truth = league.session('hum', 'random', 1)
    last = rpms_ros.from_arrays(*arrays).identify('tracking').estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.03 * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9


def test_estimates_that_were_wrong_beyond_their_intervals_widen_the_next(league):
    """A muscle of another kind that tires and rests was wrong by 2.3 % within .9, and good."""
    kinds, excitation, one, generator = league.drawn(1003, league.MUSCLES)
    arrays, truth = league.simulated(kinds, excitation, one, generator)
    found = rpms_ros.from_arrays(*arrays).identify('tracking', rate_hz=one['rate'])
    last = found.estimates.last
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9
    assert 'the last estimates were wrong by more than their intervals' in last.reasons
    assert found.verdict.grade == 'doubtful'


@pytest.mark.parametrize(
    ('muscle', 'excitation', 'seed', 'most'),
    [
        *(('slip', 'random', 0, 0.003), ('slip', 'sinusoid', 0, 0.001)),
        *(('sway', 'random', 0, 0.003), ('sway', 'sinusoid', 1, 0.01)),
    ],
)
def test_a_coil_that_moves_is_followed(league, muscle, excitation, seed, most):
    """A slip left .8 and .35 % where the force was linear in the move of the thresholds.

    A sway 5 and 9 % with one slope of the thresholds.
    """
    arrays, truth = league.session(muscle, excitation, seed)
    last = rpms_ros.from_arrays(*arrays).identify('tracking').estimates.last
    assert np.abs(last.curve_force - truth).max() < most * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9


def test_a_latency_that_jitters_is_no_effort(league):
    """1.1 % with an interval of 1 % where it was taken for one."""
    arrays, truth = league.session('jitter', 'random', 0, 20.0)
    last = rpms_ros.from_arrays(*arrays).identify('tracking').estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.004 * truth.max()


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_pause_at_the_end_widens_the_interval_by_what_a_muscle_recovers(league, excitation):
    """Eight seconds of fatigue and eight of rest: 7 % beside 1.4 % where recovery was a change.

    Under the sinusoid 2 to 5 % where pulses that recruit nothing did not let the muscle recover.
    """
    arrays, truth = league.session('rests', excitation, 1)
    last = rpms_ros.from_arrays(*arrays).identify('tracking').estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.015 * truth.max()
    assert last.curve_lower[-1] <= truth[-1] <= last.curve_upper[-1]


@pytest.mark.parametrize(
    ('excitation', 'seed', 'bound'), [('sinusoid', 2, 0.01), ('random', 4, 0.01)]
)
def test_a_burst_is_no_change_and_no_other_basis(living_sessions, excitation, seed, bound):
    """A change that was named while the curve was not known: 98 %; another basis: 5 %."""
    what = living_sessions.session('bursts', excitation, seed, 28.0)
    _, estimates = run(what)
    assert errors(what, estimates)[30:].max() < bound
    assert estimates[-1].changes == 0


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_noise_behind_the_filter_of_a_sensor_is_no_effort(living_sessions, excitation):
    """A low-pass of 30 Hz makes the noise stronger where the muscle moves than in the mean."""
    what = living_sessions.session('steady', excitation, 1, 20.0)
    session = what._replace(force=lfilter(*butter(2, 30, fs=1000.0), what.force))
    _, estimates = run(session)
    assert errors(session, estimates)[20:].max() < 0.003
    assert held(session, estimates)[20:].min() > 0.9
    assert not any(one.doubts for one in estimates[20:])


@pytest.mark.long
def test_noise_that_moves_all_the_time_need_not_wander(league):
    """Hum and 1/f noise of 1 % each: 5.5 % wrong if second differences alone have a prior."""
    arrays, truth = league.session('hum', 'sinusoid', 0, 30.0)
    last = rpms_ros.from_arrays(*arrays).identify('tracking').estimates.last
    # bench/league.py: 0.7 %
    assert np.abs(last.curve_force - truth).max() < 0.015 * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).all()


def test_arctangents_that_cannot_move_hold_no_weight_of_a_pulse(league):
    """Doublets: no step was taken, and the curve stayed 3.7 % too low with the first weight."""
    kinds, excitation, one, generator = league.drawn(412, league.MUSCLES)
    one['seconds'] = 20.0
    arrays, truth = league.simulated(kinds, excitation, one, generator)
    last = rpms_ros.from_arrays(*arrays).identify('tracking', rate_hz=one['rate']).estimates.last
    assert np.abs(last.curve_force - truth).max() < 0.02 * truth.max()
    assert ((last.curve_lower <= truth) & (truth <= last.curve_upper)).mean() > 0.9


@pytest.mark.long
def test_heart_and_breath_are_doubted(league):
    """A heart of 2 % and a breath of 3 %: 1 to 3 % wrong beside a band of 1 %."""
    arrays, _ = league.session('heart', 'random', 0, 30.0)
    found = rpms_ros.from_arrays(*arrays).identify('tracking')
    assert DISTURBANCE_LIVELY in found.estimates.last.doubts
    assert found.verdict.grade != 'good'


def behind_a_filter(league, seconds, rate, excitation, filtered=True):
    """Return pulses and force of a muscle, and its curve."""
    generator = np.random.default_rng([1, 4052642862])
    one = league.person(generator) | {'rate': rate, 'seconds': seconds}
    kinds = ['gauss', 'filter'] if filtered else ['gauss']
    return league.simulated(kinds, excitation, one, generator)


def test_a_filter_that_seven_functions_do_not_quite_bear_bends_no_curve(league):
    """It took what they miss for a change of the thresholds: .9 to 2.5 % from 13 to 20 s."""
    arrays, truth = behind_a_filter(league, 20.0, 10.0, 'sinusoid')
    found = rpms_ros.from_arrays(*arrays).identify('tracking', rate_hz=10.0)
    late = [one for one in found.estimates.estimates if one.stamp_ns > 12e9]
    assert len(late) > 10
    for one in late:
        assert np.abs(one.curve_force - truth).max() < 0.003 * truth.max()
        assert ((one.curve_lower <= truth) & (truth <= one.curve_upper)).mean() > 0.9
        assert (one.curve_upper - one.curve_lower).max() < 0.01 * truth.max()


def test_a_muscle_of_an_earlier_session_is_put_on_more_functions(league):
    """Its seven functions had no place in the prior of ten."""
    (time, force, onset, intensity), _ = behind_a_filter(league, 12.0, 10.0, 'random', False)
    _, known = fed(TrackingEstimator(), time, force, onset, intensity)
    (time, force, onset, intensity), truth = behind_a_filter(league, 12.0, 10.0, 'random')
    estimator = TrackingEstimator(rate_hz=10.0)
    estimator.start_from(known.fitted())
    last, _ = fed(estimator, time, force, onset, intensity)
    assert len([name for name in last.linear_names if name.startswith('basis')]) == 10
    assert np.abs(last.curve_force - truth).max() < 0.003 * truth.max()


def test_a_muscle_that_tires_anew_under_a_sinusoid_is_in_doubt(league):
    kinds, excitation, one, generator = league.drawn(49, league.MUSCLES)
    arrays, _ = league.simulated(kinds, excitation, one, generator)
    assert (kinds, excitation) == (['gauss', 'rests'], 'sinusoid')
    found = rpms_ros.from_arrays(*arrays).identify('tracking', most_estimates=1)
    assert CHANGED_LATELY in found.estimates.last.doubts


def test_pulses_below_the_threshold_after_a_rest_take_nothing_away(league):
    """Of a window with hardly any force, no prior of the coefficients says that there are none."""
    (time, _, onset, intensity), _ = behind_a_filter(league, 50.0, 20.0, 'random', False)
    rested = onset > 46.0
    intensity = np.where(rested, 0.05, intensity)
    kept = rested | (onset < 12.0)
    onset, intensity = onset[kept], intensity[kept]
    one = league.person(np.random.default_rng([1, 4052642862])) | {'seconds': 50.0, 'rate': 20.0}
    force, truth = league.contraction(
        ['gauss'], time, onset, intensity, one, np.random.default_rng(0)
    )
    noise = np.random.default_rng(0).standard_normal(len(time))
    force = lfilter(*butter(2, 30.0, fs=1e3), force + 0.005 * truth.max() * noise)
    last, _ = fed(TrackingEstimator(), time, force, onset, intensity)
    assert np.abs(last.curve_force - truth).max() < 0.004 * truth.max()
    assert (last.curve_upper - last.curve_lower).max() < 0.1 * truth.max()


def fed(estimator, time, force, onset, intensity):
    """Return the last estimate, and the estimator, fed with blocks of a quarter of a second."""
    stamp_ns = np.round(1e9 * time).astype(np.int64)
    estimator.add_pulses(np.round(1e9 * onset).astype(np.int64), intensity)
    for first in range(0, len(stamp_ns), 250):
        part = slice(first, first + 250)
        estimator.update(stamp_ns[part], force[part], np.ones(len(stamp_ns[part]), dtype=bool))
    return estimator.estimate(int(stamp_ns[-1]), {}), estimator
