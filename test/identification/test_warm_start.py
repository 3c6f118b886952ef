# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A returning patient: the last session is a prior, which is reduced where it is wrong."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    CURVE_INTENSITY,
    IdentificationStream,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.estimation.prior import known_from, warm_start
from rpms_ros.identification.model.recruitment import nearest_arctangents, recruitment_curve
from rpms_ros.identification.stream.stream import save
from rpms_ros.muscle import Contraction, IntensityRecruitment, Subject
from rpms_ros.muscle.recruitment import PARAMETER_NAMES
from rpms_ros.pulses import ForceTrace, PulseTrain

LAST_TIME = Subject()
RATE = 20.0


def errors(subject, seconds, seed, path=None, estimator=('tracking', 'paper_table_5')):
    """Error of the curve every 50 ms, as share of its maximum, and the stream."""
    generator = np.random.default_rng(seed)
    pulses = PulseTrain.regular(generator.uniform(size=int(seconds * RATE)), RATE)
    muscle = Contraction(subject)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = 1_000_000 * np.arange(50 * len(pulses), dtype=np.int64)
    noise = 0.005 * subject.maximum_force * generator.standard_normal(len(stamps))
    estimator = estimator_by_name(*estimator)
    if path is not None:
        warm_start(estimator, path)
    stream = IdentificationStream(estimator, StreamSettings(estimate_period=0.05))
    stream.add_pulses(pulses)
    stream.add_forces(ForceTrace(stamps, muscle.force(stamps) + noise))
    truth = subject.steady_force(CURVE_INTENSITY, RATE)
    found = [one.curve_force for one in [*stream.advance(), *stream.finish()]]
    known = [len(curve) == len(truth) for curve in found]
    return np.array(
        [
            np.abs(curve - truth).max() / truth.max() if there else np.inf
            for curve, there in zip(found, known, strict=True)
        ]
    ), stream


@pytest.fixture(name='saved', scope='module')
def saved_fixture(tmp_path_factory):
    path = tmp_path_factory.mktemp('last') / 'time'
    _, stream = errors(LAST_TIME, 20.0, 1)
    save(path, stream)
    return path


def other_day():
    shape = replace(LAST_TIME.recruitment, threshold=0.485, saturation=0.975).normalised()
    return replace(LAST_TIME, recruitment=shape, maximum_force=9.3)


def test_a_result_does_as_well(saved, tmp_path):
    known, path = known_from(saved), tmp_path / 'result.json'
    time = np.arange(0.0, 0.4, 5e-3)
    intensity = np.linspace(0.0, 1.0, 101)
    rho, _ = recruitment_curve(intensity, known.theta)
    # the response of a result is that at full intensity
    full = rho[-1]
    # in any order
    parameters, _ = nearest_arctangents(known.theta)
    names = zip(reversed(PARAMETER_NAMES), parameters[::-1].tolist(), strict=True)
    document = {
        'recruitment': dict(names),
        'curve': {'intensity': intensity.tolist(), 'force': (7.0 * rho).tolist()},
        'impulse_response': {
            'time_s': time.tolist(),
            'force': (full * known.basis.evaluate(time) @ known.linear).tolist(),
        },
        'output_error_n': 0.05,
    }
    path.write_text(json.dumps(document))
    found = known_from(path)
    assert found.basis == known.basis
    shape, _ = recruitment_curve(intensity, found.theta)
    np.testing.assert_allclose(shape / shape[-1], rho / full, atol=2e-3)
    force = shape[-1] * found.linear
    np.testing.assert_allclose(force, full * known.linear, atol=1e-3 * np.abs(force).max())
    warm, _ = errors(other_day(), 1.5, 2, path)
    # a step every five pulses, as in `test_tracking_starts_from_what_it_knew`
    assert warm[5] < 0.05
    assert warm[10:].max() < 0.015
    document['recruitment']['u_sat'] = None
    path.write_text(json.dumps(document))
    with pytest.raises(IdentificationError, match=r'expected a result that knows .*, got none of'):
        known_from(path)


@pytest.mark.long
@pytest.mark.parametrize('name', ['batch', 'tracking'])
def test_what_was_saved_is_the_muscle_of_the_estimate(name, tmp_path):
    """With a latency and a time constant for which batch and tracking choose their functions."""
    subject = replace(LAST_TIME, latency=20e-3, time_constant=20e-3)
    _, stream = errors(subject, 12.0, 1, estimator=(name,))
    save(tmp_path / name, stream)
    known, estimate = known_from(tmp_path / name), stream.estimate()
    full = recruitment_curve(np.ones(1), known.theta)[0][0]
    response = full * known.basis.evaluate(estimate.response_time) @ known.linear
    np.testing.assert_allclose(response, estimate.response_force, atol=1e-6)


def test_what_says_nothing_of_a_muscle_is_refused(tmp_path, saved):
    path = tmp_path / 'file'
    for text in ('{}', '[1]', '{"recruitment": null}', 'no JSON'):
        path.write_text(text)
        with pytest.raises(IdentificationError, match='expected a session with a recruitment'):
            known_from(path)
    flipped = bytearray(saved.read_bytes())
    flipped[len(flipped) // 2] ^= 4
    path.write_bytes(flipped)
    with pytest.raises(IdentificationError, match='expected a saved state that is whole'):
        known_from(path)
    with pytest.raises(IdentificationError, match=r'such as tracking, got recursive'):
        warm_start(estimator_by_name('recursive'), saved)


def test_a_session_that_has_begun_is_not_started_again(saved):
    _, stream = errors(LAST_TIME, 1.0, 4)
    with pytest.raises(IdentificationError, match='expected a fresh estimator'):
        warm_start(stream.estimator, saved)


@pytest.fixture(name='tracked', scope='module')
def tracked_fixture(tmp_path_factory):
    path = tmp_path_factory.mktemp('last') / 'tracked'
    save(path, errors(LAST_TIME, 12.0, 1, estimator=('tracking',))[1])
    return path


@pytest.mark.long
def test_tracking_keeps_what_it_knew_of_a_patient_who_has_changed_little(tracked):
    # A few pulses alone have many explanations; that they prefer another is no contradiction.
    subject = replace(other_day(), time_constant=1.03 * LAST_TIME.time_constant)
    seeds = (9, 15, 17, 24, 27)
    found = [errors(subject, 0.6, seed, tracked, ('tracking',))[0][10] for seed in seeds]
    # An estimator that knows all but the changes has up to 3 % (bench/warm_start.py).
    assert np.median(found) < 0.01
    assert max(found) < 0.02


@pytest.mark.long
def test_tracking_starts_from_what_it_knew(tracked):
    known = known_from(tracked)
    assert known.theta[0] == pytest.approx(LAST_TIME.recruitment.threshold, abs=0.005)
    warm, stream = errors(other_day(), 1.5, 2, tracked, ('tracking',))
    cold, _ = errors(other_day(), 1.5, 2, None, ('tracking',))
    # Steps are a quarter of a second apart: five pulses each, taken when the next sample comes.
    assert warm[5:10].max() < 0.2 * cold[5:10].min()
    assert warm[5] < 0.05
    assert warm[10:].max() < 0.01
    with pytest.raises(IdentificationError, match='expected a fresh estimator to start from'):
        warm_start(stream.estimator, tracked)


@pytest.mark.long
def test_tracking_gives_up_what_was_another_muscle(tracked):
    shape = IntensityRecruitment(0.62, 0.9, 5.0, 8.0).normalised()
    stranger = Subject(28e-3, 9e-3, recruitment=shape, maximum_force=31.0)
    wrong, _ = errors(stranger, 4.0, 3, tracked, ('tracking',))
    cold, _ = errors(stranger, 4.0, 3, None, ('tracking',))
    # a second later than without it, at most
    assert wrong[70:].max() < 0.01 + cold[50:].max()
