# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as one dataclass, their files, and nodes that are refused."""

import threading
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.errors import NodeError, RpmsError
from rpms_ros.nodes.common.parameters import (
    NodeParameters,
    declare_parameters,
    descriptions,
    parameter,
    type_of,
)
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.nodes.identifier import Identifier, IdentifierParameters
from rpms_ros.nodes.live_page import LivePage, LivePageParameters
from rpms_ros.nodes.operator_console import ConsoleParameters, OperatorConsole
from rpms_ros.nodes.plant_simulator import PlantParameters, PlantSimulator
from rpms_ros.nodes.recorder import Recorder, RecorderParameters
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButton, StopButtonParameters
from rpms_ros.stimulation import constant

FILES = {
    'identifier': IdentifierParameters,
    'plant_simulator': PlantParameters,
    'recorder': RecorderParameters,
    'live_page': LivePageParameters,
}
NODES = (*FILES.values(), ConsoleParameters, DriverParameters, StopButtonParameters)
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Example(NodeParameters):
    rate: float = parameter(20.0, 'Rate.', unit='Hz', bounds=(1.0, 50.0))
    count: int = parameter(3, 'Count.', bounds=(0, 9))
    gain: float = parameter(1.0, 'Gain.', dynamic=True, bounds=(0.0, 9.0))
    limit: float = parameter(2.0, 'Largest gain.', dynamic=True)
    mode: str = parameter('a', 'Mode.', choices=('a', 'b'))
    weights: tuple[float, ...] = parameter((0.5, 1.0), 'Weights.', bounds=(0.0, 1.0))

    def __post_init__(self):
        super().__post_init__()
        if self.gain > self.limit:
            raise NodeError(f'expected a gain up to limit {self.limit}, got {self.gain}')


@dataclass(frozen=True)
class Names(NodeParameters):
    names: tuple[str, ...] = parameter((), 'Names.')
    words: tuple[str, ...] = parameter(('a',), 'Words.')


def declare(context, settings=Example, **values):
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = Node(
        'example', context=context, parameter_overrides=overrides, use_global_arguments=False
    )
    return node, declare_parameters(node, settings)


@contextmanager
def nothing_left(graph):
    """What is done here leaves neither a node on the graph nor a thread."""
    other, threads = graph.node('other'), set(threading.enumerate())
    yield
    graph.wait_for(lambda: other.get_node_names() == ['other'])
    # one of before may have ended meanwhile
    assert set(threading.enumerate()) <= threads


def test_defaults_and_overrides_come_back(context):
    assert declare(context)[1] == Example()
    _, settings = declare(context, rate=50.0, mode='b', weights=[0.25])
    assert settings == Example(rate=50.0, mode='b', weights=(0.25,))


def test_a_list_may_be_empty_where_it_is_so_by_default(context):
    # ROS gives no type to an empty list of a file, and that of bytes to one of Python
    for values in ({}, {'names': None}, {'names': []}):
        node, settings = declare(context, Names, **values)
        found = node.get_parameter('names')
        assert (found.type_, found.value) == (Parameter.Type.STRING_ARRAY, [])
        assert settings == Names()
    assert declare(context, Names, names=['b'])[1] == Names(names=('b',))
    with pytest.raises(NodeError, match='parameter words: expected string array, got byte array'):
        declare(context, Names, words=[])


def test_a_descriptor_says_what_the_field_says(context):
    node, _ = declare(context)
    rate = node.describe_parameter('rate')
    assert (rate.type, rate.read_only) == (ParameterType.PARAMETER_DOUBLE, True)
    assert rate.description == 'Rate.'
    assert rate.additional_constraints == '[Hz] 1.0 to 50.0'
    assert node.describe_parameter('count').additional_constraints == '0 to 9'
    assert not node.describe_parameter('gain').read_only


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'rate': 20}, r'rate: expected double, got integer 20 \(write 20\.0\)'),
        ({'rate': 50.00001}, r'rate: expected \[Hz\] 1\.0 to 50\.0, got 50\.00001'),
        ({'rate': float('nan')}, r'rate: expected \[Hz\] 1\.0 to 50\.0, got nan'),
        ({'limit': float('inf')}, 'limit: expected finite, got inf'),
        ({'count': -1}, 'count: expected 0 to 9, got -1'),
        ({'count': 1.0}, r'count: expected integer, got double 1\.0'),
        ({'mode': 'c'}, "mode: expected one of a, b, got 'c'"),
        ({'weights': [0.5, 1.5]}, r'weights: expected 0\.0 to 1\.0, got 1\.5'),
        ({'gain': 3.0}, r'parameters of example: expected a gain up to limit 2\.0, got 3\.0'),
    ],
)
def test_a_bad_value_gives_one_clear_line(context, values, message):
    with pytest.raises(NodeError, match=message):
        declare(context, **values)


@pytest.mark.parametrize(
    ('given', 'meant'),
    [
        ('force_limt', 'force_limit'),
        ('maximum_intesity', 'maximum_intensity'),
        ('require_stopbutton', 'require_stop_button'),
        ('Temperature_limit', 'temperature_limit'),
        ('MAXIMUM_INTENSITY', 'maximum_intensity'),
        ('limits.force_limit', 'force_limit'),
    ],
)
def test_a_driver_refuses_a_misspelt_limit(context, given, meant):
    line = f'expected a parameter of stimulator_driver as {meant}, got {given}'
    with pytest.raises(NodeError, match=line):
        StimulatorDriver(context=context, parameter_overrides=[Parameter(given, value=0.5)])


def test_no_parameter_of_another_node_is_taken_for_a_misspelt_one_of_the_driver(context):
    # one file with /** may hold those of all nodes
    own = set(descriptions(DriverParameters))
    others = {name for one in NODES for name in descriptions(one)} - own
    overrides = [Parameter(name, value='of another') for name in sorted(others)]
    StimulatorDriver(context=context, parameter_overrides=overrides).destroy_node()


def test_a_driver_of_a_real_device_takes_no_unknown_name(context):
    given = {'device': 'serial', 'max_rate': 5.0}
    given |= {'audit_log': '/log', 'ledger_folder': '/doses', 'patient_file': '/patient.yaml'}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    with pytest.raises(NodeError, match='expected parameters of stimulator_driver, got max_rate'):
        StimulatorDriver(context=context, parameter_overrides=overrides)


@pytest.mark.parametrize('wrong', [False, '', 0])
def test_no_list_is_not_an_empty_one(context, wrong):
    overrides = [Parameter('stop_buttons', value=wrong)]
    with pytest.raises(NodeError, match='parameter stop_buttons: expected'):
        StimulatorDriver(context=context, parameter_overrides=overrides)


@pytest.mark.parametrize('settings', NODES)
def test_every_number_of_a_node_has_a_range_with_two_ends(settings):
    for name, description in descriptions(settings).items():
        assert description.doc.endswith('.'), name
        if type_of(settings, name) in (Parameter.Type.DOUBLE, Parameter.Type.INTEGER):
            assert description.bounds is not None, name
            low, high = description.bounds
            assert low <= getattr(settings, name) <= high < float('inf'), name


@pytest.mark.parametrize('name', FILES)
@pytest.mark.parametrize(('namespace', 'renamed'), [('', ''), ('/left_leg', 'quadriceps')])
def test_a_parameter_file_holds_every_parameter_at_its_default(
    context, capfd, name, namespace, renamed
):
    path = ROOT / 'config' / f'{name}.yaml'
    (parameters,) = yaml.safe_load(path.read_text()).values()
    settings = FILES[name]
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


@pytest.mark.parametrize('name', ['identifier', 'plant_simulator', 'live_page'])
def test_the_axis_y_is_not_taken_for_yes(context, tmp_path, name):
    path = tmp_path / 'own.yaml'
    path.write_text('/**: {ros__parameters: {axis: y}}')
    for given in (['--params-file', str(path)], ['-p', 'axis:=y']):
        node = Node(
            name, context=context, cli_args=['--ros-args', *given], use_global_arguments=False
        )
        settings = declare_parameters(node, FILES[name])
        assert (settings.axis, node.get_parameter('axis').value) == ('y', 'y')


@pytest.mark.parametrize('word', ['off', '12', '1.5', 'y'])
def test_a_text_that_ros_reads_as_something_else_is_to_be_quoted(context, word):
    def declared(given):
        arguments = ['--ros-args', '-p', given]
        node = Node('recorder', context=context, cli_args=arguments, use_global_arguments=False)
        return declare_parameters(node, RecorderParameters)

    with pytest.raises(NodeError, match=r'path: expected string, got .* \(put it in quotes'):
        declared(f'path:={word}')
    assert declared(f"path:='{word}'") == RecorderParameters(path=word)


@pytest.mark.parametrize(
    ('kind', 'parameters', 'message'),
    [
        (Identifier, {'estimator': 'guess'}, 'estimator'),
        (PlantSimulator, {'rate': -1.0}, 'rate'),
        (PlantSimulator, {'scenario': 'x'}, 'expected a scenario of bad-sensor, .* got .x.'),
        (Recorder, {'path': '/proc/no/such'}, 'expected'),
        (LivePage, {'address': 'no such address'}, 'address'),
        (StimulatorDriver, {'maximum_intensity': 2.0}, 'maximum_intensity'),
        (StimulatorDriver, {'audit_log': '/proc/no/such'}, 'expected'),
        (StopButton, {'keyboard': False}, 'expected a keyboard or a joy_button'),
        (OperatorConsole, {'operator': ''}, 'expected the name of the operator, got none'),
        (
            OperatorConsole,
            {'operator': 'ada', 'schedule_file': '/nowhere.yaml'},
            'expected a readable schedule file, got /nowhere.yaml',
        ),
    ],
)
def test_a_node_that_is_refused_is_not_on_the_graph(
    graph, tmp_path, monkeypatch, kind, parameters, message
):
    monkeypatch.chdir(tmp_path)
    with nothing_left(graph), pytest.raises(RpmsError, match=message) as refused:
        graph.add(kind, **parameters)
    # whoever holds the error holds what was built of the node
    assert refused.traceback


def test_a_console_without_a_terminal_lets_go_of_it(graph, schedule_file):
    schedule, closed = schedule_file(constant(0.5, 1.0, 1.0)), []
    terminal = SimpleNamespace(there=False, close=lambda: closed.append(True))
    with nothing_left(graph), pytest.raises(RpmsError, match='expected a terminal'):
        graph.add(partial(OperatorConsole, terminal), operator='ada', schedule_file=schedule)
    assert closed


def test_the_driver_ends_what_it_has_begun_when_its_last_part_is_refused(
    graph, tmp_path, monkeypatch
):
    def refuse(*_):
        raise RpmsError('expected the last part, got none')

    monkeypatch.setattr('rpms_ros.nodes.stimulator_driver.every', refuse)
    log = tmp_path / 'audit.jsonl'
    with nothing_left(graph), pytest.raises(RpmsError, match='the last part'):
        graph.add(StimulatorDriver, audit_log=str(log))
    assert log.read_text().splitlines()[-1].count('"end"') == 1
