# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A session that is saved and continued; the last session of a patient as a prior."""

import dataclasses
import hashlib
import json
import os
import stat
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    CURVE_INTENSITY,
    ESTIMATORS,
    Estimate,
    IdentificationStream,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.estimation.prior import known_from, warm_start
from rpms_ros.identification.model.recruitment import nearest_arctangents, recruitment_curve
from rpms_ros.identification.stream.monitors import Monitor
from rpms_ros.identification.stream.stream import load, save
from rpms_ros.muscle import Contraction, IntensityRecruitment, Subject
from rpms_ros.muscle.recruitment import PARAMETER_NAMES
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.saved_state import FORMAT, MOST_BYTES

SECOND = 1_000_000_000
PAPER = 'paper recursive'
START_NS = 1_700_000_000 * SECOND
SESSION_SAMPLES = 4000
# A hundred and more search longer.
EXAMPLES = int(os.environ.get('RPMS_CHECKPOINT_EXAMPLES', '6'))


def fresh(name, period=0.1) -> IdentificationStream:
    preset = 'paper_table_4' if name == PAPER else 'people'
    estimator = estimator_by_name(name.removeprefix('paper '), preset)
    return IdentificationStream(estimator, StreamSettings(estimate_period=period))


@pytest.fixture(name='session', scope='module')
def session_fixture(record):
    """Pulses and force of four seconds, with noise, a spike, a lost pulse, a gap and a jump."""
    pulses, forces = record(np.random.default_rng(3).uniform(size=80), START_NS)
    value = forces.force + 0.02 * np.random.default_rng(4).standard_normal(len(forces))
    value[700] += 40.0
    stamps = forces.stamp_ns.copy()
    stamps[2000:] += 3 * SECOND
    stamps[3000:] -= 30 * SECOND
    onset = pulses.onset_ns.copy()
    onset[40:] += 3 * SECOND
    onset[60:] -= 30 * SECOND
    kept = np.arange(80) != 17
    pulses = dataclasses.replace(pulses, onset_ns=onset)[kept]
    return pulses, ForceTrace(stamps, value), 50 * np.flatnonzero(kept)


def run(stream, session, start, stop) -> list[Estimate]:
    """Hand samples `start` to `stop` to a stream, and the pulses of their time."""
    pulses, forces, before = session
    estimates = []
    for first in range(start, stop, 20):
        last = min(first + 20, stop)
        due = (before >= first) & (before < last)
        stream.add_pulses(pulses[due])
        stream.add_forces(ForceTrace(forces.stamp_ns[first:last], forces.force[first:last]))
        estimates += stream.advance()
    return estimates


@pytest.mark.long
@pytest.mark.parametrize('name', [*sorted(ESTIMATORS), PAPER])
@settings(max_examples=EXAMPLES)
@given(cut=st.integers(0, SESSION_SAMPLES))
def test_going_on_is_never_having_stopped(session, tmp_path_factory, images, name, cut):
    path = tmp_path_factory.mktemp('state') / 'saved'
    period = 0.1 if name != 'batch' else 1.0
    whole, before, after = (fresh(name, period) for _ in range(3))
    run(whole, session, 0, cut)
    run(before, session, 0, cut)
    save(path, before)
    load(path, after)
    same_everywhere(whole, after, name)
    expected = run(whole, session, cut, SESSION_SAMPLES) + whole.finish()
    found = run(after, session, cut, SESSION_SAMPLES) + after.finish()
    assert images(found) == images(expected)


def parts_of(value) -> dict[object, object]:
    """What a value is made of, by name or place; nothing if it has no parts."""
    if isinstance(value, dict):
        return value
    if isinstance(value, list | tuple | deque):
        return dict(enumerate(value))
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if type(value).__module__.startswith('rpms_ros') and hasattr(value, '__dict__'):
        # The workspace is what every sample overwrites, the line is the stream itself.
        parts = vars(value).items()
        return {name: part for name, part in parts if name not in ('_workspace', '_line')}
    return {}


def same_everywhere(one, other, where) -> None:
    """Whatever is in the one is in the other, whether or not it was named as part of the state."""
    assert type(one) is type(other), where
    parts, others = parts_of(one), parts_of(other)
    assert parts.keys() == others.keys(), where
    for name, part in parts.items():
        same_everywhere(part, others[name], f'{where}.{name}')
    if isinstance(one, np.ndarray):
        assert (one.dtype, one.tobytes()) == (other.dtype, other.tobytes()), where
    elif isinstance(one, int | float | str):
        assert one == other or one != one, where


@pytest.fixture(name='saved')
def saved_fixture(session, tmp_path) -> Path:
    stream = fresh('tracking')
    run(stream, session, 0, 1500)
    save(tmp_path / 'saved', stream)
    return tmp_path / 'saved'


def refused(path, stream, text) -> None:
    with pytest.raises(IdentificationError, match=text):
        load(path, stream)


def resigned(path, change) -> None:
    """Change the document of a file and make its sum right again, as a forger would."""
    content = path.read_bytes().partition(b'\n')[2]
    text, _, arrays = content.partition(b'\n')
    document = json.loads(text)
    arrays = change(document, arrays) or arrays
    content = json.dumps(document).encode() + b'\n' + arrays
    line = f'{FORMAT} {hashlib.sha256(content).hexdigest()}\n'
    path.write_bytes(line.encode() + content)


def test_other_settings_are_refused_by_name(saved):
    refused(saved, fresh('tracking', 0.2), 'estimate_period 0.2, as it is set here, got 0.1')
    other = IdentificationStream(estimator_by_name('tracking', preset='paper_table_5'))
    refused(saved, other, r'with start \[0\.4, 0\.9, 10\.0, .* got \[0\.4, 0\.9, 3\.0')
    rate = IdentificationStream(estimator_by_name('tracking', rate_hz=30.0))
    refused(saved, rate, 'rate_hz 30.0, as it is set here, got 20.0')


def test_another_estimator_is_refused(saved):
    refused(saved, fresh('recursive'), 'of the estimator recursive, got .tracking.')
    assert stat.S_IMODE(saved.stat().st_mode) == 0o600


def test_other_versions_are_refused(saved):
    resigned(saved, lambda document, _: document.update(package='99.0'))
    refused(saved, fresh('tracking'), "expected a saved state of the package .*, got '99.0'")
    resigned(saved, lambda document, _: document.update(version=1))
    refused(saved, fresh('tracking'), 'expected a saved state of version 3, got 1')


def test_every_cut_and_every_flip_is_refused(saved):
    whole = saved.read_bytes()
    cuts = [whole[:length] for length in (0, 1, 30, 100, 1000, len(whole) // 2, len(whole) - 1)]
    places = np.random.default_rng(5).integers(0, len(whole), 12).tolist()
    flips = []
    for place in [*range(0, 100, 7), *places]:
        flips.append(bytearray(whole))
        flips[-1][place] ^= 1 << (place % 8)
    for content in cuts + flips:
        saved.write_bytes(content)
        refused(saved, fresh('tracking'), 'expected a state that was saved|that is whole')


def test_what_is_no_file_is_refused(tmp_path):
    refused(tmp_path, fresh('tracking'), 'expected a file with a saved state')
    refused(tmp_path / 'none', fresh('tracking'), 'expected a file with a saved state')
    os.mkfifo(tmp_path / 'pipe')
    refused(tmp_path / 'pipe', fresh('tracking'), 'expected a file with a saved state')


def test_larger_files_than_any_are_not_read(tmp_path):
    with (tmp_path / 'large').open('wb') as file:
        file.truncate(MOST_BYTES + 1)
    refused(tmp_path / 'large', fresh('tracking'), 'expected a saved state of at most')


def deep() -> list:
    inner: list = []
    for _level in range(60):
        inner = [inner]
    return inner


FORGED = {
    # a ring of blocks that goes on for ever
    'size': ('estimator_state', '_problem', 'first', 10**9),
    'type': ('stream_state', '_last_ns', 'noon'),
    'name': ('stream_state', '_queue', '__class__', 1),
    'place': ('stream_state', '_acting_ns', {'$array': ['<i8', [3], 10**9]}),
    'shape': ('estimator_state', '_predictor', 'theta', {'$array': ['<f8', [2], 0]}),
    'huge': ('stream_state', '_acting_ns', {'$array': ['<i8', [999999999999], 0]}),
    'deep': ('stream_state', '_names', deep()),
    'missing': ('stream_state', None),
    'arrays': (),
}


@pytest.mark.parametrize('change', FORGED)
def test_forged_states_are_refused(saved, change):
    def forge(document, arrays):
        if not FORGED[change]:
            return arrays[: len(arrays) // 2]
        *places, last, value = FORGED[change]
        for place in places:
            document = document[place]
        document[last] = value
        return arrays

    resigned(saved, forge)
    refused(saved, fresh('tracking'), 'expected|saved')


def test_a_failed_write_leaves_the_old_file(saved, monkeypatch):
    def full(_):
        raise OSError('no space left')

    before = saved.read_bytes()
    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(IdentificationError, match=r'expected to write .*no space left'):
        save(saved, fresh('tracking'))
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]


def test_estimates_that_wait_are_not_lost(session, tmp_path):
    stream = fresh('tracking')
    pulses, forces, _ = session
    stream.add_pulses(pulses[:20])
    stream.add_forces(ForceTrace(forces.stamp_ns[:1000], forces.force[:1000]))
    stream.finish()
    save(tmp_path / 'saved', stream)
    stream._finished = [stream.estimate()]
    with pytest.raises(IdentificationError, match='expected all estimates taken'):
        save(tmp_path / 'saved', stream)


def test_an_estimator_without_a_state_is_refused(tmp_path):
    class Bare:
        name, memory, on_line = 'bare', 0.5, True

    stream = fresh('tracking')
    stream.estimator = Bare()
    with pytest.raises(IdentificationError, match=r'with state\(\) and restore\(\), got bare'):
        save(tmp_path / 'saved', stream)


def test_a_monitor_says_what_it_remembers():
    class Forgetful(Monitor):
        def __init__(self) -> None:
            self.count = 0

    class Mindful(Monitor):
        count: int

        def __init__(self) -> None:
            self.count = 0

    with pytest.raises(IdentificationError, match='expected annotations of all that Forgetful'):
        Forgetful().state()
    other = Mindful()
    other.restore({'count': 3})
    assert other.count == 3


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


@pytest.fixture(name='last_time', scope='module')
def last_time_fixture(tmp_path_factory):
    path = tmp_path_factory.mktemp('last') / 'time'
    _, stream = errors(LAST_TIME, 20.0, 1)
    save(path, stream)
    return path


def other_day():
    shape = replace(LAST_TIME.recruitment, threshold=0.485, saturation=0.975).normalised()
    return replace(LAST_TIME, recruitment=shape, maximum_force=9.3)


def test_a_result_does_as_well(last_time, tmp_path):
    known, path = known_from(last_time), tmp_path / 'result.json'
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


def test_what_says_nothing_of_a_muscle_is_refused(tmp_path, last_time):
    path = tmp_path / 'file'
    for text in ('{}', '[1]', '{"recruitment": null}', 'no JSON'):
        path.write_text(text)
        with pytest.raises(IdentificationError, match='expected a session with a recruitment'):
            known_from(path)
    flipped = bytearray(last_time.read_bytes())
    flipped[len(flipped) // 2] ^= 4
    path.write_bytes(flipped)
    with pytest.raises(IdentificationError, match='expected a saved state that is whole'):
        known_from(path)
    with pytest.raises(IdentificationError, match=r'such as tracking, got recursive'):
        warm_start(estimator_by_name('recursive'), last_time)


def test_a_session_that_has_begun_is_not_started_again(last_time):
    _, stream = errors(LAST_TIME, 1.0, 4)
    with pytest.raises(IdentificationError, match='expected a fresh estimator'):
        warm_start(stream.estimator, last_time)


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
