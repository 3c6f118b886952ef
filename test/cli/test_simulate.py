# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms simulate: what it writes is what was asked for."""

import re

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

import rpms_ros
from rpms_ros.estimate_messages import truth_of
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.recording import read_facts, read_recording
from rpms_ros.recording.rosbag.definitions import known_types
from rpms_ros.report.recorded import true_muscle
from rpms_ros.stimulation import paper_random


def test_session_of_the_paper(rpms, tmp_path):
    path = tmp_path / 'session'
    code, out, err = rpms('simulate', '--out', path, '--duration', 5)
    assert (code, err) == (0, '')
    assert out == f'{path}: 100 pulses, 5000 samples, 5 s\n'
    recording = read_recording(path)
    start_ns = int(recording.forces.stamp_ns[0])
    expected = paper_random(5.0, 20.0, 1).pulses(start_ns)
    assert recording.pulses.onset_ns.tolist() == expected.onset_ns.tolist()
    assert recording.pulses.intensity.tolist() == expected.intensity.tolist()
    assert (np.diff(recording.forces.stamp_ns) == 1_000_000).all()
    contraction = Contraction(simulation_subject(), 20.0)
    contraction.add_pulses(expected.onset_ns, expected.intensity)
    force = contraction.force(recording.forces.stamp_ns)
    # The same sums over the same pulses, folded at other times: rounding only.
    np.testing.assert_allclose(recording.forces.force, force, rtol=1e-12, atol=1e-12)


def test_the_same_options_make_the_same_recording(rpms, tmp_path):
    contents = []
    for folder in ('first', 'second'):
        path = tmp_path / folder / 'session'
        rpms('simulate', '--out', path, '--duration', 2, '--noise', 0.1, '--subject', 'random')
        contents.append({file.name: file.read_bytes() for file in path.iterdir()})
    assert contents[0] == contents[1]


@pytest.mark.parametrize('kind', ['gauss', pytest.param('ding', marks=pytest.mark.long)])
def test_another_muscle_is_judged_by_its_own_curve(rpms, tmp_path, kind):
    path = tmp_path / 'session'
    options = ('--muscle', kind, '--subject', 'rpms', '--noise', 0.05, '--duration', 30)
    assert rpms('simulate', '--out', path, *options)[0] == 0
    found = rpms_ros.load(path).identify('batch')
    truth = true_muscle(read_recording(path), 20.0)
    error, doubted = truth.error(found.estimates.last), found.verdict.grade != 'good'
    assert doubted if kind == 'ding' else error < 0.003 and not doubted


def test_a_file_says_itself_how_long_and_how_fast(rpms, tmp_path):
    path = tmp_path / 'schedule.yaml'
    assert rpms('protocol', 'sinusoid', '--duration', 1, '--out', path)[0] == 0
    for option in ('--duration', '--pulse-rate', '--intensity'):
        code, _, err = rpms(
            'simulate', '--schedule', path, option, '0.5', '--out', tmp_path / 'session'
        )
        assert code == 2
        assert f'expected a schedule by its name with {option}, got --schedule' in err
        assert not (tmp_path / 'session').exists()


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (
            ['--schedule', 'waltz'],
            'expected a schedule of uniform_random, .* or a file, got waltz',
        ),
        (['--rate', '0'], 'expected a rate of the force above 0 and up to 1e.06 Hz, got 0.0'),
        (['--noise', '-1'], 'noise of at least 0 N, got -1.0'),
        (['--intensity', '2', '--schedule', 'constant'], 'intensity.* got 2'),
        (['--intensity', '0.5'], 'expected --schedule constant with --intensity, got --sch'),
    ],
)
def test_bad_options(rpms, tmp_path, options, message):
    code, out, err = rpms('simulate', '--out', tmp_path / 'session', '--duration', 1, *options)
    assert (code, out) == (2, '')
    assert re.match(f'rpms: error: .*{message}', err), err
    assert err.count('\n') == 1


def test_existing_folder_is_not_touched(rpms, tmp_path):
    message = f'rpms: error: expected a new folder for the recording, got {tmp_path}\n'
    assert rpms('simulate', '--out', tmp_path) == (2, '', message)
    assert list(tmp_path.iterdir()) == []


def test_a_scenario_is_recorded_with_its_truth(rpms, tmp_path):
    path = tmp_path / 'session'
    scenario = tmp_path / 'moved.yaml'
    scenario.write_text(
        'changes: [{at: 2.0, gain: 0.5}]\nsensor_faults:\n'
        '  - {fault: lost, at: 1.0, duration: 0.5}\n'
    )
    code, _, err = rpms('simulate', '--out', path, '--duration', 4, '--scenario', scenario)
    assert (code, err) == (0, '')
    assert len(read_recording(path).forces) == 3500
    with Reader(path) as reader:
        truths = [
            truth_of(known_types().deserialize_cdr(data, connection.msgtype))
            for connection, _, data in reader.messages()
            if connection.topic == '/truth'
        ]
    assert len(truths) == 40
    assert [truth.state.gain for truth in truths] == [1.0] * 20 + [0.5] * 20
    assert truths[0].curve_force[-1] == pytest.approx(10.0)


def test_a_scenario_is_named_in_the_notes_with_what_the_sensor_adds(rpms, tmp_path):
    options = ('--duration', 2, '--scenario', 'fatigue')
    for name, more in (('as-it-is', ()), ('still', ('--noise', 0))):
        assert rpms('simulate', '--out', tmp_path / name, *options, *more)[0] == 0
    notes = [read_facts(tmp_path / name).custom for name in ('as-it-is', 'still')]
    assert {one['scenario'] for one in notes} == {'fatigue'}
    assert [one['disturbances'] for one in notes] == ['{"noise": 0.05}', '{}']
    # an option that is given counts, be it 0
    force = read_recording(tmp_path / 'still').forces.force
    assert (np.diff(force[:10]) > 0.0).all()
