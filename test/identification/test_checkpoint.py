# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A session that is saved and continued gives the estimates of an uninterrupted one."""

import dataclasses
import hashlib
import json
import os
import stat
from collections import deque
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    ESTIMATORS,
    Estimate,
    IdentificationStream,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.stream.monitors import Monitor
from rpms_ros.identification.stream.stream import load, save
from rpms_ros.pulses import ForceTrace
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


def test_every_cut_is_refused(saved):
    whole = saved.read_bytes()
    for length in (0, 1, 30, 100, 1000, len(whole) // 2, len(whole) - 1):
        saved.write_bytes(whole[:length])
        refused(saved, fresh('tracking'), 'expected a state that was saved|that is whole')


def test_every_flip_is_refused(saved):
    whole = saved.read_bytes()
    places = np.random.default_rng(5).integers(0, len(whole), 12).tolist()
    for place in [*range(0, 100, 7), *places]:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << (place % 8)
        saved.write_bytes(flipped)
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
