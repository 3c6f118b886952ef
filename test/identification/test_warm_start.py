# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The last session of a patient as a prior."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import rpms_ros
from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    CURVE_INTENSITY,
    IdentificationStream,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.estimation.prior import fitted_muscle_of, warm_start
from rpms_ros.identification.model.recruitment import recruitment_curve
from rpms_ros.muscle import Contraction, IntensityRecruitment, Subject
from rpms_ros.pulses import ForceTrace, PulseTrain

LAST_TIME = Subject()
RATE = 20.0


def drawn(subject, seconds, seed):
    """Pulses of random intensity, and the force with noise."""
    generator = np.random.default_rng(seed)
    pulses = PulseTrain.regular(generator.uniform(size=int(seconds * RATE)), RATE)
    muscle = Contraction(subject)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = 1_000_000 * np.arange(50 * len(pulses), dtype=np.int64)
    noise = 0.005 * subject.maximum_force * generator.standard_normal(len(stamps))
    return pulses, ForceTrace(stamps, muscle.force(stamps) + noise)


def identified(subject, seconds, estimator='tracking'):
    """Result of a session."""
    pulses, forces = drawn(subject, seconds, 1)
    times = 1e-9 * forces.stamp_ns, forces.force, 1e-9 * pulses.onset_ns, pulses.intensity
    return rpms_ros.from_arrays(*times).identify(estimator)


def errors(subject, seconds, seed, path=None):
    """Error of the curve every 50 ms, as share of its maximum, and the estimator."""
    estimator = estimator_by_name('tracking')
    if path is not None:
        warm_start(estimator, path)
    stream = IdentificationStream(estimator, StreamSettings(estimate_period=0.05))
    pulses, forces = drawn(subject, seconds, seed)
    stream.add_pulses(pulses)
    stream.add_forces(forces)
    truth = subject.steady_force(CURVE_INTENSITY, RATE)
    found = [
        np.abs(one.curve_force - truth).max() / truth.max() if one.curve_known else np.inf
        for one in [*stream.advance(), *stream.finish()]
    ]
    return np.array(found), estimator


@pytest.fixture(name='last_time', scope='module')
def last_time_fixture(tmp_path_factory):
    path = tmp_path_factory.mktemp('last') / 'time.json'
    identified(LAST_TIME, 12.0).to_json(path)
    return path


def other_day():
    shape = replace(LAST_TIME.recruitment, threshold=0.485, saturation=0.975).normalised()
    return replace(LAST_TIME, recruitment=shape, maximum_force=9.3)


@pytest.mark.parametrize('estimator', ['batch', 'tracking'])
def test_what_is_known_is_the_muscle_of_the_result(estimator, tmp_path):
    """With a latency and a time constant for which the estimators choose their functions."""
    found = identified(replace(LAST_TIME, latency=20e-3, time_constant=20e-3), 12.0, estimator)
    found.to_json(tmp_path / 'result.json')
    known = fitted_muscle_of(tmp_path / 'result.json')
    curve, response = found.curve, found.response
    rho, _ = recruitment_curve(curve.intensity, known.theta[:-2])
    np.testing.assert_allclose(rho / rho[-1], curve.force / curve.force[-1], atol=2e-3)
    force = rho[-1] * known.basis.evaluate(response.time_s) @ known.linear
    np.testing.assert_allclose(force, response.force, atol=1e-3 * response.force.max())


def test_what_says_nothing_of_a_muscle_or_comes_too_late_is_refused(tmp_path, last_time):
    path = tmp_path / 'file'
    for text in ('{}', '[1]', '{"recruitment": null}', 'no JSON', '\xff'):
        path.write_text(text, encoding='latin-1')
        with pytest.raises(IdentificationError, match='of a session with a recruitment'):
            fitted_muscle_of(path)
    document = json.loads(last_time.read_text())
    theta = document['muscle']['theta']
    for name, value, message in (
        ('theta', theta[1:], r'expected 30 parameters and a covariance of 37, got \(29,\)'),
        ('theta', [math.nan, *theta[1:]], 'expected finite parameters of a muscle'),
        ('theta', [*theta[:2], -1.0, *theta[3:]], 'expected alpha above 0, got'),
        ('covariance', [[1.0]], 'expected 30 parameters and a covariance of 37'),
        ('variance', 0.0, 'expected finite parameters of a muscle'),
        ('latency_s', 'soon', 'of a session with a recruitment'),
    ):
        muscle = {**document['muscle'], name: value}
        path.write_text(json.dumps({**document, 'muscle': muscle}))
        with pytest.raises(IdentificationError, match=message):
            fitted_muscle_of(path)
    path.write_text('{"recruitment": null}')
    with pytest.raises(IdentificationError, match="got none of its 'muscle'"):
        fitted_muscle_of(path)
    with pytest.raises(IdentificationError, match='expected a result in N m, got one in N in'):
        warm_start(estimator_by_name('tracking'), last_time, 'N m')
    with pytest.raises(IdentificationError, match='No such file'):
        fitted_muscle_of(tmp_path / 'none')
    with pytest.raises(IdentificationError, match=r'such as tracking, got recursive'):
        warm_start(estimator_by_name('recursive'), last_time)
    _, begun = errors(LAST_TIME, 1.0, 4)
    with pytest.raises(IdentificationError, match='expected a fresh estimator'):
        warm_start(begun, last_time)


@pytest.mark.long
def test_tracking_keeps_what_it_knew_of_a_patient_who_has_changed_little(last_time):
    # A few pulses alone have many explanations; that they prefer another is no contradiction.
    subject = replace(other_day(), time_constant=1.03 * LAST_TIME.time_constant)
    seeds = (9, 15, 17, 24, 27)
    found = [errors(subject, 0.6, seed, last_time)[0][10] for seed in seeds]
    # Without it these have 7 to 13 %.
    assert np.median(found) < 0.01
    assert max(found) < 0.02


@pytest.mark.long
def test_tracking_starts_from_what_it_knew(last_time):
    known = fitted_muscle_of(last_time)
    assert known.theta[0] == pytest.approx(LAST_TIME.recruitment.threshold, abs=0.005)
    warm, _ = errors(other_day(), 1.5, 2, last_time)
    cold, _ = errors(other_day(), 1.5, 2)
    # Steps are a quarter of a second apart: five pulses each, taken when the next sample comes.
    assert warm[5:10].max() < 0.2 * cold[5:10].min()
    assert warm[5] < 0.05
    assert warm[10:].max() < 0.01


@pytest.mark.long
def test_tracking_gives_up_what_was_another_muscle(last_time):
    shape = IntensityRecruitment(0.62, 0.9, 5.0, 8.0).normalised()
    stranger = Subject(28e-3, 9e-3, recruitment=shape, maximum_force=31.0)
    wrong, _ = errors(stranger, 4.0, 3, last_time)
    cold, _ = errors(stranger, 4.0, 3)
    # a second later than without it, at most
    assert wrong[70:].max() < 0.01 + cold[50:].max()
