# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates over time, whether the muscle stayed the same, and the truth where it is known."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.cli import main
from rpms_ros.muscle import simulation_subject, twitch
from rpms_ros.muscle.contraction import MuscleState
from rpms_ros.muscle.simulation import Truth
from rpms_ros.recording import read_recording
from rpms_ros.report.course import course_of, steadiness
from rpms_ros.report.known_muscle import of_subject, of_truths
from rpms_ros.report.recorded import true_muscle


@pytest.fixture
def course(made_up):
    """The course of a session with these estimates."""
    return lambda estimates: course_of(made_up.session_of(estimates))


def several(made_up, count=20, **fields):
    return [made_up.estimate(index, **fields) for index in range(1, count + 1)]


def changed(index, kind, at_s):
    """Fields of an estimate that has found a change."""
    ago = np.array([0.5 * index - at_s])
    return {'changes': 1, 'change_kinds': (kind,), 'change_ago': ago}


def test_forces_and_parameters_have_their_intervals(made_up, course):
    found = course(several(made_up))
    assert found.time_s[[0, -1]].tolist() == [0.5, 10.0]
    assert found.force.value.tolist() == [10.0] * 20
    np.testing.assert_allclose(found.force.upper - found.force.value, 0.1)
    threshold = found.parameter('u_thr')
    # 1.96 standard deviations of 0.01
    np.testing.assert_allclose(threshold.upper - threshold.value, 0.0196, rtol=1e-3)
    assert found.has_course
    # of a sharpness symmetric in its logarithm, as in the table
    sharpness = found.parameter('alpha_sat')
    np.testing.assert_allclose(sharpness.upper * sharpness.lower, sharpness.value**2)
    assert (sharpness.lower > 0.0).all()


def test_what_is_not_known_is_left_out(made_up, course):
    empty = {'curve_force': np.empty(0), 'curve_lower': np.empty(0), 'curve_upper': np.empty(0)}
    unknown = {'nonlinear_identifiability': np.array([0, 2, 2, 2])}
    fields = {'samples': 0}, empty, unknown
    found = course([made_up.estimate(index, **one) for index, one in enumerate(fields, 1)])
    assert found.force.known.tolist() == [False, False, True]
    assert found.parameter('u_thr').known.tolist() == [False, True, False]
    assert found.parameter('u_sat').known.tolist() == [False, True, True]
    assert not found.has_course


def test_a_change_that_is_renamed_counts_once_under_its_last_name(made_up, course):
    told = [
        made_up.estimate(index, **changed(index, kind, 4.0))
        for index, kind in ((9, 'gain'), (10, 'thresholds'))
    ]
    (change,) = course([*several(made_up, 8), *told]).changes
    assert (change.kind, change.time_s) == ('thresholds', pytest.approx(4.0))
    assert 'the coil probably moved' in change.reason


def test_warnings_become_spans_and_short_breaks_do_not_end_them(made_up, course):
    # a reason says why an interval is wide, as of all estimates of a verdict that is good
    estimates = [
        made_up.estimate(
            index,
            doubts=('curve_negative',) if index in (3, 5, 12) else (),
            reasons=('followed by another estimator',),
        )
        for index in range(1, 21)
    ]
    flags = course(estimates).flags
    assert [(flag.start_s, flag.end_s) for flag in flags] == [(1.5, 2.5), (6.0, 6.0)]
    assert {flag.text for flag in flags} == {'the curve is negative: a muscle does not push'}


def test_a_fault_is_a_span_while_it_is_counted_not_ever_after(made_up, course):
    counts = [0, 0, 3, 9, 9, 9, 9, 9]
    estimates = [
        made_up.estimate(index + 1, faults={'force_frozen': count} if count else {}, doubts=('x',))
        for index, count in enumerate(counts)
    ]
    (flag,) = course(estimates).flags
    assert (flag.start_s, flag.end_s) == (1.5, 2.0)
    assert flag.text.startswith('force_frozen: ')


COUNT = 80


def told(made_up, forces, half=0.1, **fields):
    estimates = [
        made_up.estimate(index + 1, float(force), half, **fields)
        for index, force in enumerate(forces)
    ]
    return steadiness(course_of(made_up.session_of(estimates)))


def test_a_steady_muscle_stayed_the_same_within_what_the_intervals_allow(made_up):
    # twice 0.5 % of half an interval: 0.7 %
    assert told(made_up, np.full(COUNT, 10.0), 0.05) == (
        'The muscle stayed the same within 1 % from 8 s on.'
    )
    wandering = np.full(COUNT, 10.0)
    wandering[15:-1] += 0.3 * np.sin(np.linspace(0.0, 9.4, COUNT - 16))
    assert 'within 3 %' in told(made_up, wandering, 0.05)


def test_a_force_that_falls_is_told_with_its_interval(made_up):
    forces = np.full(COUNT, 10.0)
    forces[15:] = np.linspace(10.0, 7.7, COUNT - 15)
    # intervals of 1 % and 1.3 %: together 1.6 % of the start, times 0.77
    assert told(made_up, forces) == (
        'The force at full intensity fell by 23 % (22 to 24 %) between 8 and 40 s.'
    )
    assert 'rose by' in told(made_up, forces[::-1].copy())


@pytest.mark.parametrize(
    ('kind', 'words'),
    [
        ('thresholds', 'The coil probably moved at 20.0 s: the threshold went from 0.48 to 0.56,'),
        ('gain', 'The force of all intensities changed at 20.0 s: the force at full intensity'),
        ('dynamics', 'The response to a pulse changed its shape at 20.0 s'),
        ('unknown', 'Something changed at 20.0 s'),
    ],
)
def test_a_sudden_change_is_told_with_what_it_did(made_up, course, kind, words):
    other = {'force': 8.0, 'nonlinear': np.array([0.56, 1.06, 4.0, 6.0])}
    late = [
        made_up.estimate(index, **other, **changed(index, kind, 20.0))
        for index in range(41, COUNT + 1)
    ]
    text = steadiness(course([*several(made_up, 40), *late]))
    assert text.startswith(words)
    # two intervals of 1 % and 1.25 %, times 0.8
    assert text.endswith('the force at full intensity fell by 20 % (19 to 21 %).')
    assert text.count('fell by') == 1


@pytest.mark.parametrize('kind', ['thresholds', 'gain', 'dynamics'])
def test_what_is_the_same_afterwards_is_no_change(made_up, course, kind):
    def at(index, moved=0.0, half=0.1):
        fields = {'nonlinear_covariance': np.diag([1e-6, 1e-6, 0.01, 0.01])}
        if index > 40:
            fields |= changed(index, kind, 20.0)
            # a few seconds of something else
            shift = 0.04 * np.exp(-(index - 40) / 8) + moved
            fields['nonlinear'] = np.array([0.48 + shift, 0.98 + shift, 4.0, 6.0])
        return made_up.estimate(index, 10.0, half, **fields)

    def said(*options):
        return steadiness(course([at(index, *options) for index in range(1, COUNT + 1)]))

    assert said().startswith('Something at 20.0 s looked like another muscle, but thresholds,')
    assert 'an effort, a spasm or a bump, say. The muscle stayed the same within' in said()
    # thresholds that stay elsewhere, and a force that is too vague to tell
    assert 'looked like another' not in said(0.02)
    assert 'looked like another' not in said(0.0, 1.0)


def test_an_estimator_that_takes_the_muscle_for_constant_does_not_tell(made_up):
    text = told(made_up, np.full(COUNT, 10.0), rate_names=(), rate=np.empty(0))
    assert 'assumes a muscle that does not change' in text


POINTS = np.linspace(0.0, 1.0, 41)


def truth(second, force):
    state = MuscleState(1.0, 0.04, 0.009, 0.5, 1.0, 1.0, 0.0)
    curve = force * np.clip((POINTS - 0.5) / 0.5, 0.0, 1.0)
    return Truth(round(1e9 * second), state, 20.0, POINTS, curve, 0.5)


def test_the_error_is_that_of_the_worst_point_of_the_curve(made_up):
    muscle = of_truths([truth(0.0, 10.0)])
    # both curves are straight between the points
    assert muscle.error(made_up.estimate(1, 10.0)) == pytest.approx(0.0, abs=1e-12)
    assert muscle.error(made_up.estimate(1, 9.0)) == pytest.approx(0.1)
    assert np.isnan(muscle.error(replace(made_up.estimate(1), repetition_rate=30.0)))
    assert np.isnan(muscle.error(replace(made_up.estimate(1), curve_force=np.empty(0))))


def test_a_session_is_judged_at_its_end_and_at_its_worst(made_up):
    muscle = of_truths([truth(0.0, 10.0)])
    forces = np.full(80, 10.0)
    forces[45], forces[-1], forces[5] = 9.0, 9.9, 1.0
    estimates = [made_up.estimate(i + 1, force) for i, force in enumerate(forces.tolist())]
    judged = muscle.judged(course_of(made_up.session_of(estimates)))
    assert judged.error_at_the_end == pytest.approx(0.01)
    # that of 1 N came before the estimator had settled
    assert (judged.worst_error, judged.worst_at_s) == (pytest.approx(0.1), pytest.approx(23.0))
    assert 'at most 1 % of its maximum' in judged.sentence


def test_a_muscle_at_rest_has_its_own_response():
    subject = simulation_subject()
    muscle = of_subject(subject, 20.0)
    time = np.linspace(0.0, 0.4, 50)
    weight = float(subject.pulse_weight(1.0, 20.0))
    expected = weight * twitch(time - subject.latency, subject.time_constant, subject.order)
    np.testing.assert_allclose(muscle.response(time, 0), expected, rtol=1e-12)
    sharpness = muscle.parameter('alpha_thr', np.zeros(2, dtype=np.int64))
    assert sharpness.tolist() == [6.0, 6.0]


def test_a_simulator_that_starts_anew_is_read_once():
    muscle = of_truths([truth(0.0, 10.0), truth(2.0, 9.0), truth(1.0, 1.0), truth(3.0, 8.0)])
    assert muscle.curve[:, -1].tolist() == [10.0, 9.0, 8.0]


@pytest.mark.parametrize(
    ('options', 'times'), [(['--scenario', 'fatigue'], 30), ([], 1)], ids=['topic', 'notes']
)
def test_a_simulated_recording_tells_its_muscle(tmp_path, options, times):
    path = str(tmp_path / 'one')
    assert main(['simulate', '--quiet', '--duration', '3', '--out', path, *options]) == 0
    muscle = true_muscle(read_recording(path), 20.0)
    assert len(muscle.stamp_ns) == times
    # a tired muscle potentiates first, by less than a tenth
    assert muscle.curve[:, -1] == pytest.approx(10.0, rel=0.1)
    assert muscle.subject == simulation_subject()
