# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Launch files: what they describe is started with real nodes."""

import os
import sys
from pathlib import Path

import pytest
import yaml

from rpms_msgs.msg import DriverStatus, MuscleEstimate
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver

ROOT = Path(__file__).resolve().parents[2]
KINDS = {
    'identifier': Identifier,
    'live_page': LivePage,
    'plant_simulator': PlantSimulator,
    'recorder': Recorder,
    'stimulator_driver': StimulatorDriver,
}


class Launched:
    """A launch file with its arguments, and the nodes that it would start."""

    def __init__(self, module, folder, **arguments):
        described = module.generate_launch_description().entities
        *declared, started = described
        self.declared = {argument.name: argument for argument in declared}
        assert set(arguments) <= set(self.declared)
        values = {name: argument.default_value for name, argument in self.declared.items()}
        context = sys.modules['launch'].LaunchContext({**values, **arguments})
        self.nodes = {node.options['name']: node.options for node in started.function(context)}
        self._folder = folder

    def builder(self, name):
        """Return what builds a node as its process would, from the command line it is given."""
        options = self.nodes[name]
        line = ['--ros-args', '-r', f'__node:={name}']
        if options['namespace']:
            line += ['-r', f'__ns:=/{options["namespace"]}']
        for number, given in enumerate(options['parameters']):
            path = given
            if isinstance(given, dict):
                path = str(self._folder / f'{name}_{number}.yaml')
                Path(path).write_text(yaml.safe_dump({'/**': {'ros__parameters': given}}))
            line += ['--params-file', path]
        for old, new in options.get('remappings', []):
            line += ['-r', f'{old}:={new}']
        return lambda **options: KINDS[name](cli_args=line, **options)

    def add_to(self, graph):
        """Build every node, on the graph of a test."""
        return {name: graph.add(self.builder(name)) for name in self.nodes}

    def chosen(self, name):
        """Return the parameters of a node that the arguments choose."""
        return self.nodes[name]['parameters'][-1]


@pytest.fixture
def load(beside, module_at, monkeypatch, tmp_path):
    """Read a launch file with these arguments."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.environ.get('AMENT_PREFIX_PATH', sys.prefix))
    beside('launch_stand_in').install(monkeypatch.setitem)

    def read(name, **arguments):
        path = ROOT / 'launch' / f'{name}.launch.py'
        return Launched(module_at(path), tmp_path, **arguments)

    return read


@pytest.mark.parametrize('name', ['identifier', 'simulation'])
def test_every_argument_is_documented_here_and_on_the_page(load, name):
    page = (ROOT / 'docs' / 'nodes.md').read_text()
    launched = load(name)
    for argument in launched.declared.values():
        assert argument.description.endswith('.')
        assert f'`{argument.name}`' in page
    setup = (ROOT / 'setup.py').read_text()
    for node in launched.nodes:
        assert f"'{node} = rpms_ros.nodes.executables:{node}'" in setup


def test_the_identifier_takes_everything_by_arguments(graph, load, tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(
        '/**: {ros__parameters: {repetition_rate: 30.0, estimator: recursive}}\n'
        '/**/live_page: {ros__parameters: {port: 0}}'
    )
    launched = load(
        'identifier',
        namespace='left_leg',
        force='/cell/wrench',
        pulses='triggers',
        estimator='tracking',
        axis='-0.6,0,-0.8',
        quantity='torque',
        use_sim_time='true',
        parameters=str(own),
        live='true',
        record='true',
        path=str(tmp_path / 'session'),
    )
    nodes = launched.add_to(graph)
    identifier, recorder, page = (nodes[name] for name in ('identifier', 'recorder', 'live_page'))
    settings = identifier.settings
    assert identifier.get_fully_qualified_name() == '/left_leg/identifier'
    assert (settings.estimator, settings.axis) == ('tracking', '-0.6,0,-0.8')
    assert settings.quantity == 'torque'
    # the file of the user comes after that of config/, an argument after both
    assert settings.repetition_rate == 30.0
    assert recorder.path == tmp_path / 'session'
    shown = page.settings
    assert (shown.axis, shown.quantity, shown.port) == ('-0.6,0,-0.8', 'torque', 0)
    for node in nodes.values():
        assert node.get_parameter('use_sim_time').value
        assert node.resolve_topic_name('force') == '/cell/wrench'
        assert node.resolve_topic_name('pulses') == '/left_leg/triggers'
    recorder.close()


def test_the_simulation_runs_a_schedule_and_is_recorded(graph, load, tmp_path):
    schedule = tmp_path / 'short.yaml'
    schedule.write_text('segments: [{kind: uniform_random, rate_hz: 20.0, duration_s: 2.0}]')
    own = tmp_path / 'own.yaml'
    own.write_text('/**/stimulator_driver: {ros__parameters: {lateness_limit: 0.1}}')
    launched = load(
        'simulation',
        namespace='ward/left_leg',
        estimator='tracking',
        subject='simulation',
        scenario='steady',
        quantity='torque',
        schedule=str(schedule),
        parameters=str(own),
        record='true',
        path=str(tmp_path / 'session'),
    )
    leg = '/ward/left_leg'
    statuses = graph.heard(DriverStatus, f'{leg}/driver_status', qos.STATUS)
    estimates = graph.heard(MuscleEstimate, f'{leg}/estimate', qos.ESTIMATE)
    nodes = launched.add_to(graph)
    assert {node.get_namespace() for node in nodes.values()} == {leg}
    graph.wait_for(lambda: bool(statuses) and statuses[-1].pulses_delivered == 40)
    graph.wait_for(lambda: bool(estimates) and estimates[-1].pulses > 20)
    assert (estimates[-1].unit, estimates[-1].estimator) == ('N m', 'tracking')
    counts = nodes['recorder'].counts
    graph.wait_for(lambda: counts['pulses'] == 40)
    graph.wait_for(lambda: counts['accepted_schedule'] == 1)
    nodes['recorder'].close()


def test_a_schedule_waits_for_the_page_too(graph, load, tmp_path):
    """The page hears force and pulses: it was taken for the identifier, which compiles longer."""
    own = tmp_path / 'own.yaml'
    own.write_text('/**/live_page: {ros__parameters: {port: 0}}')
    launched = load('simulation', live='true', quantity='torque', parameters=str(own))
    assert launched.chosen('plant_simulator')['minimum_subscribers'] == 2
    assert launched.chosen('stimulator_driver')['minimum_subscribers'] == 3
    page = graph.add(launched.builder('live_page'))
    assert page.session.unit == 'N m'


def test_without_a_schedule_the_driver_waits_for_a_goal(load):
    heard = {'minimum_subscribers': 2}
    assert load('simulation').chosen('stimulator_driver') == heard
    slow = {'autostart': True, 'schedule_file': 'slow.yaml', **heard}
    assert load('simulation', schedule='slow.yaml').chosen('stimulator_driver') == slow
