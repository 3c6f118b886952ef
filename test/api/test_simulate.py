# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated sessions in Python, and the names that the package offers."""

import inspect
import re
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import rpms_ros
from rpms_ros import RpmsError, api
from rpms_ros.cli import main
from rpms_ros.muscle import Subject
from rpms_ros.recording import session_hash
from rpms_ros.stimulation import paper_sinusoid


@pytest.mark.parametrize(
    'options',
    [{}, {'noise': 0.05, 'drift': 0.1, 'seed': 7, 'subject': 'random'}, {'scenario': 'fatigue'}],
)
def test_it_is_the_session_of_the_command_with_its_truth(tmp_path, options):
    path = tmp_path / 'session'
    given = [word for name, value in options.items() for word in (f'--{name}', str(value))]
    assert main(['simulate', '--out', str(path), '--duration', '3', *given, '--quiet']) == 0
    session = rpms_ros.simulate(duration=3.0, **options)
    written = rpms_ros.load(path)
    np.testing.assert_array_equal(session.force.force, written.force.force)
    assert session_hash(session.recording) == session_hash(written.recording)
    assert written.subject == session.subject
    assert (written.truth is None) == (session.truth is None) == ('scenario' not in options)
    if session.truth is not None and written.truth is not None:
        assert written.truth.subject == session.subject
        np.testing.assert_array_equal(written.truth.stamp_ns, session.truth.stamp_ns)
        np.testing.assert_allclose(written.truth.curve, session.truth.curve, rtol=1e-6)


def test_a_muscle_and_a_schedule_of_ones_own():
    muscle = Subject(maximum_force=25.0)
    session = rpms_ros.simulate(paper_sinusoid(9.0), subject=muscle, force_rate_hz=500.0)
    assert session.subject is muscle
    assert session.info()['force_rate_hz'] == 500.0
    assert 20.0 < session.force.force.max() < 30.0


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'schedule': 'zigzag'}, 'expected a schedule of .* or a file, got zigzag'),
        (
            {'subject': 'nobody'},
            "expected a subject of rpms, fes, simulation, random, got 'nobody'",
        ),
        ({'schedule': 'sinusoid', 'intensity': 0.3}, 'intensity with constant alone, .*sinusoid'),
        ({'scenario': 'nothing'}, 'expected .*nothing'),
        ({'force_rate_hz': 0.0}, 'expected a rate of the force above 0 and up to'),
        ({'noise': -1.0}, 'expected .*noise.*-1'),
        ({'duration': -1.0}, 'expected .*-1'),
        ({'subject': 'random', 'seed': -1}, 'expected a seed, .*, got -1'),
        ({'schedule': 'sinusoid', 'seed': -1}, 'expected a seed, .*, got -1'),
    ],
)
def test_what_is_not_possible_is_refused(options, message):
    with pytest.raises(RpmsError, match=message):
        rpms_ros.simulate(**options)


def test_a_session_is_drawn_as_it_was_recorded():
    session = rpms_ros.simulate(duration=3.0)
    figure = session.plot(Figure())
    above, below = figure.axes
    time, force = above.lines[0].get_data()
    assert time[0] == 0.0
    np.testing.assert_array_equal(force, session.force.force)
    assert above.get_ylabel() == 'force [N]'
    assert len(below.collections[0].get_segments()) == len(session.pulses) == 60


OFFERED = [
    one
    for place in (api, api.Session, api.Identification)
    for name, one in inspect.getmembers(place, inspect.isfunction)
    if (name in api.__all__ if place is api else not name.startswith('_'))
]


def test_the_package_offers_what_the_module_offers():
    assert sorted(rpms_ros.__all__) == sorted(api.__all__)
    assert set(dir(rpms_ros)) == {*api.__all__, '__version__'}
    for name in api.__all__:
        assert getattr(rpms_ros, name) is getattr(api, name)
    with pytest.raises(AttributeError, match="'rpms_ros' has no attribute 'laod'"):
        rpms_ros.laod  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize(
    ('imported', 'absent'),
    [
        ('rpms_ros', {'numpy', 'scipy', 'numba', 'matplotlib'}),
        # neither ROS nor what only Unix has
        ('rpms_ros.api', {'rclpy', 'rpms_msgs', 'pandas', 'pyarrow', 'serial'}),
    ],
)
def test_importing_loads_no_more_than_is_needed(imported, absent):
    command = [sys.executable, '-c', f'import {imported}, sys; print(*sys.modules)']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=250)
    loaded = done.stdout.split()
    assert not absent & {name.partition('.')[0] for name in loaded}
    assert not {'rpms_ros.nodes', 'rpms_ros.cli'} & set(loaded)


@pytest.mark.parametrize('one', OFFERED, ids=lambda one: one.__qualname__)
def test_every_parameter_is_described(one):
    names = [name for name in inspect.signature(one).parameters if name != 'self']
    text = inspect.getdoc(one) or ''
    described = set(re.findall(r'^([\w, ]+) : ', text, re.MULTILINE))
    listed = {name for line in described for name in line.split(', ')}
    # a method of two plain numbers may say in its sentence what they are
    assert all(name in listed or f'`{name}`' in text for name in names), (names, listed)
