# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The truth of a simulated recording: from its topic, from its notes, and never from nonsense."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from rpms_ros.cli import main
from rpms_ros.muscle import simulation_subject, twitch
from rpms_ros.muscle.contraction import MuscleState
from rpms_ros.muscle.simulation import Truth
from rpms_ros.recording import read_recording
from rpms_ros.report.course import course_of
from rpms_ros.report.known_muscle import of_subject, of_truths
from rpms_ros.report.recorded import true_muscle

POINTS = np.linspace(0.0, 1.0, 41)


def truth(second: float, force: float) -> Truth:
    state = MuscleState(1.0, 0.04, 0.009, 0.5, 1.0, 1.0, 0.0)
    curve = force * np.clip((POINTS - 0.5) / 0.5, 0.0, 1.0)
    return Truth(round(1e9 * second), state, 20.0, POINTS, curve, 0.5)


def test_the_error_is_that_of_the_worst_point_of_the_curve(made_up: ModuleType) -> None:
    muscle = of_truths([truth(0.0, 10.0)])
    assert muscle is not None
    # both curves are straight between the points
    assert muscle.error(made_up.estimate(1, 10.0)) == pytest.approx(0.0, abs=1e-12)
    assert muscle.error(made_up.estimate(1, 9.0)) == pytest.approx(0.1)
    assert muscle.inside(made_up.estimate(1, 10.0)) == 1.0
    # below the threshold both are zero: 21 points of 41
    assert muscle.inside(made_up.estimate(1, 9.0)) == pytest.approx(21 / 41)
    assert np.isnan(muscle.error(replace(made_up.estimate(1), repetition_rate=30.0)))
    assert np.isnan(muscle.error(replace(made_up.estimate(1), curve_force=np.empty(0))))


def test_a_session_is_judged_at_its_end_and_at_its_worst(made_up: ModuleType) -> None:
    muscle = of_truths([truth(0.0, 10.0)])
    assert muscle is not None
    forces = np.full(80, 10.0)
    forces[45], forces[-1], forces[5] = 9.0, 9.9, 1.0
    estimates = [made_up.estimate(i + 1, force) for i, force in enumerate(forces.tolist())]
    judged = muscle.judged(course_of(made_up.session_of(estimates)))
    assert judged is not None
    assert judged.error_at_the_end == pytest.approx(0.01)
    # that of 1 N came before the estimator had settled
    assert (judged.worst_error, judged.worst_at_s) == (pytest.approx(0.1), pytest.approx(23.0))
    assert 'at most 1 % of its maximum' in judged.sentence


def test_a_muscle_at_rest_has_its_own_response() -> None:
    subject = simulation_subject()
    muscle = of_subject(subject, 20.0)
    time = np.linspace(0.0, 0.4, 50)
    weight = float(subject.pulse_weight(1.0, 20.0))
    response = muscle.response(time, 0)
    assert response is not None
    expected = weight * twitch(time - subject.latency, subject.time_constant, subject.order)
    np.testing.assert_allclose(response, expected, rtol=1e-12)
    sharpness = muscle.parameter('alpha_thr', np.zeros(2, dtype=np.int64))
    assert sharpness is not None
    assert sharpness.tolist() == [6.0, 6.0]


def test_a_simulator_that_starts_anew_is_read_once() -> None:
    muscle = of_truths([truth(0.0, 10.0), truth(2.0, 9.0), truth(1.0, 1.0), truth(3.0, 8.0)])
    assert muscle is not None
    assert muscle.curve[:, -1].tolist() == [10.0, 9.0, 8.0]


@pytest.mark.parametrize(
    ('options', 'times'), [(['--scenario', 'fatigue'], 30), ([], 1)], ids=['topic', 'notes']
)
def test_a_simulated_recording_tells_its_muscle(
    tmp_path: Path, options: list[str], times: int
) -> None:
    path = str(tmp_path / 'one')
    assert main(['simulate', '--quiet', '--duration', '3', '--out', path, *options]) == 0
    muscle = true_muscle(read_recording(path), 20.0)
    assert muscle is not None
    assert len(muscle.stamp_ns) == times
    # a tired muscle potentiates first, by less than a tenth
    assert muscle.curve[:, -1] == pytest.approx(10.0, rel=0.1)
    assert muscle.subject == simulation_subject()
