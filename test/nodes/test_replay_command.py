# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms replay`: against the estimates in the recording, against those without nodes."""

import json
import re
from array import array
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from rpms_ros import estimate_messages, messages
from rpms_ros.cli import main
from rpms_ros.identification import Estimate
from rpms_ros.nodes.identifier import IdentifierParameters, build_stream
from rpms_ros.recording import Recording, RecordingWriter, read_recording
from rpms_ros.recording.rosbag.definitions import direction_of, known_types
from rpms_ros.recording.rosbag.records import Records
from rpms_ros.recording.rosbag.writing import encode_forces, encode_pulses

Replayed = Callable[..., tuple[int, str, str]]


@pytest.fixture
def rpms(capfd: pytest.CaptureFixture[str]) -> Replayed:
    # the executor looks for a real stderr
    def run(*arguments: object) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        return (code, *capfd.readouterr())

    return run


@pytest.fixture(scope='module')
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds without estimates."""
    path = tmp_path_factory.mktemp('replay') / 'plain'
    assert main(['simulate', '--out', str(path), '--duration', '2', '--quiet']) == 0
    return path


def live_estimates(recording: Recording) -> list[Estimate]:
    # As the node does where nothing is said.
    stream = build_stream(IdentifierParameters())
    stream.add_pulses(recording.pulses)
    stream.add_forces(recording.forces)
    return stream.advance()


def with_estimates(path: Path, recording: Recording, estimates: list[Estimate]) -> Path:
    """A recording as the recorder leaves one: pulses, force and estimates."""
    types = known_types()
    kind = messages.MUSCLE_ESTIMATE
    built = [estimate_messages.estimate_message(one, types.types) for one in estimates]
    for message in built:
        # rosbags takes arrays of NumPy only
        for name, value in vars(message).items():
            if isinstance(value, array):
                setattr(message, name, np.array(value))
    encoded = [bytes(types.serialize_cdr(message, kind)) for message in built]
    with RecordingWriter(path) as writer:
        columns: list[tuple[str, str, Records]] = [
            ('/pulses', messages.PULSE, encode_pulses(recording.pulses, 'coil')),
            (
                '/force',
                messages.WRENCH_STAMPED,
                encode_forces(recording.forces, direction_of('z')),
            ),
        ]
        for name, type_name, records in columns:
            topic = writer.add_topic(name, type_name)
            for index in range(len(records)):
                writer.append(topic, int(records.time_ns[index]), records.message(index))
        topic = writer.add_topic('/estimate', kind)
        for estimate, data in zip(estimates, encoded, strict=True):
            writer.append(topic, estimate.stamp_ns + 200_000_000, data)
    return path


def test_recorded_estimates_come_again(rpms: Replayed, plain: Path, tmp_path: Path) -> None:
    recording = read_recording(plain)
    path = with_estimates(tmp_path / 'session', recording, live_estimates(recording))
    code, out, err = rpms('replay', path)
    assert (code, err) == (0, '')
    assert out.count('all 17 estimates, bit for bit') == 2
    document = json.loads(rpms('replay', path, '--json')[1])
    assert document['recorded'] == document['off_line']
    assert document['messages'] == 2040


def test_a_recorded_estimate_that_differs_is_told(
    rpms: Replayed, plain: Path, tmp_path: Path
) -> None:
    recording = read_recording(plain)
    estimates = live_estimates(recording)
    estimates[5] = replace(estimates[5], damping=estimates[5].damping + 1.0)
    estimates[6] = replace(estimates[6], stamp_ns=estimates[6].stamp_ns + 1)
    code, out, _ = rpms('replay', with_estimates(tmp_path / 'session', recording, estimates))
    assert code == 1
    assert 'DIFFERS: 1 estimates missing, 16 compared, differing fields damping 1' in out
    assert 'off line   all 17 estimates, bit for bit' in out


def test_without_recorded_estimates_the_nodes_are_held_against_the_library(
    rpms: Replayed, plain: Path, tmp_path: Path
) -> None:
    parameters = tmp_path / 'identifier.yaml'
    content = {'identifier': {'ros__parameters': {'estimate_period': 0.5}}}
    parameters.write_text(yaml.safe_dump(content))
    document = json.loads(rpms('replay', plain, '--parameters', parameters, '--json')[1])
    assert document['recorded'] is None
    assert document['off_line'] == {
        'exact': True,
        'compared': 3,
        'missing': 0,
        'differing': {},
    }


def test_a_file_for_several_nodes_serves_a_replay(
    rpms: Replayed, plain: Path, tmp_path: Path
) -> None:
    path = tmp_path / 'launched.yaml'
    content = {
        '/**': {'ros__parameters': {'use_sim_time': True, 'noise': 0.1, 'seed': 3}},
        'left_leg': {
            'live_page': {'ros__parameters': {'port': 0}},
            'identifier': {
                'ros__parameters': {'estimate_period': 0.5, 'qos_overrides': {'/force': {}}}
            },
        },
    }
    path.write_text(yaml.safe_dump(content))
    document = json.loads(rpms('replay', plain, '--parameters', path, '--json')[1])
    assert document['off_line']['compared'] == 3


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (
            '{a: {identifier: {ros__parameters: {}}}, b: {identifier: {ros__parameters: {}}}}',
            'parameters of one identifier in .*, got those of /a/identifier, /b/identifier',
        ),
        (5000 * '[', 'expected at most 32 levels'),
        ('identifier: 3', 'expected ros__parameters of an identifier in'),
        ('{', 'expected a parameter file, got'),
        ('identifier: {ros__parameters: {colour: red}}', 'expected parameters of the identifier'),
    ],
)
def test_a_parameter_file_that_holds_none_is_refused(
    rpms: Replayed, plain: Path, tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / 'parameters.yaml'
    path.write_text(text)
    code, _, err = rpms('replay', plain, '--parameters', path)
    assert code == 2
    assert re.search(expected, err)


def test_a_factor_below_zero_is_refused(rpms: Replayed, plain: Path) -> None:
    code, _, err = rpms('replay', plain, '--factor', '-1')
    assert (code, err) == (2, 'rpms: error: expected a factor of 0 or above, got -1.0\n')
