# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of parameters in `config/`: what the nodes take, for any name and namespace."""

from pathlib import Path

import pytest
import yaml
from rclpy.context import Context
from rclpy.node import Node

from rpms_ros.errors import NodeError, StimulationError
from rpms_ros.muscle.scenario import load_scenario
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, descriptions
from rpms_ros.nodes.identifier import IdentifierParameters
from rpms_ros.nodes.live_page import LivePageParameters
from rpms_ros.nodes.plant_simulator import PlantParameters
from rpms_ros.nodes.recorder import RecorderParameters
from rpms_ros.stimulation.limits.device_specification import load_device_specification

ROOT = Path(__file__).resolve().parents[2]
WITH_AN_AXIS = ('identifier', 'plant_simulator', 'live_page')
NODES: dict[str, type[NodeParameters]] = {
    'identifier': IdentifierParameters,
    'plant_simulator': PlantParameters,
    'recorder': RecorderParameters,
    'live_page': LivePageParameters,
}


@pytest.mark.parametrize('name', NODES)
@pytest.mark.parametrize(('namespace', 'renamed'), [('', ''), ('/left_leg', 'quadriceps')])
def test_a_parameter_file_holds_every_parameter_at_its_default(
    context: Context, capfd: pytest.CaptureFixture[str], name: str, namespace: str, renamed: str
) -> None:
    path = ROOT / 'config' / f'{name}.yaml'
    (parameters,) = yaml.safe_load(path.read_text()).values()
    settings = NODES[name]
    assert list(parameters['ros__parameters']) == list(descriptions(settings))
    node = Node(
        renamed or name,
        namespace=namespace,
        context=context,
        cli_args=['--ros-args', '--params-file', str(path)],
        use_global_arguments=False,
    )
    # rclpy cannot tell whether a value was given: a spoiled one must be noticed
    assert set(descriptions(settings)) <= set(node._parameter_overrides)
    assert declare_parameters(node, settings) == settings()
    assert 'unknown' not in capfd.readouterr().err


@pytest.mark.parametrize('name', WITH_AN_AXIS)
def test_the_axis_y_is_not_taken_for_yes(context: Context, tmp_path: Path, name: str) -> None:
    path = tmp_path / 'own.yaml'
    path.write_text('/**: {ros__parameters: {axis: y}}')
    for given in (['--params-file', str(path)], ['-p', 'axis:=y']):
        node = Node(
            name, context=context, cli_args=['--ros-args', *given], use_global_arguments=False
        )
        settings = declare_parameters(node, NODES[name])
        assert (settings.axis, node.get_parameter('axis').value) == ('y', 'y')


def test_files_that_parameters_name_may_be_in_the_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    for name, text in (
        ('law.json', '{"facilitation": 0.5}'),
        ('mine.yaml', 'name: mine'),
        ('train.yaml', 'segments: [{kind: uniform_random, rate_hz: 20.0, duration_s: 2.0}]'),
    ):
        (tmp_path / name).write_text(text)
    # the parameters are refused if the file is not found
    IdentifierParameters(estimator='tracking', temporal_summation='~/law.json')
    with pytest.raises(NodeError, match='expected a session with a recruitment curve'):
        IdentifierParameters(estimator='tracking', start_from='~/law.json')
    assert load_scenario('~/mine.yaml').name == 'mine'
    with pytest.raises(StimulationError, match=r'train\.yaml'):
        load_device_specification('~/train.yaml')


@pytest.mark.parametrize('word', ['off', '12', '1.5', 'y'])
def test_a_text_that_ros_reads_as_something_else_is_to_be_quoted(
    context: Context, word: str
) -> None:
    def declared(given: str) -> NodeParameters:
        arguments = ['--ros-args', '-p', given]
        node = Node('recorder', context=context, cli_args=arguments, use_global_arguments=False)
        return declare_parameters(node, RecorderParameters)

    with pytest.raises(NodeError, match=r'path: expected string, got .* \(put it in quotes'):
        declared(f'path:={word}')
    assert declared(f"path:='{word}'") == RecorderParameters(path=word)
