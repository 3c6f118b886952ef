# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every ``ros2`` command of docs/how-to/first-pulse.md names what the running nodes have."""

import re
import shlex
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.node import Node

from rpms_msgs.msg import Schedule, ScheduleSegment
from rpms_ros.nodes.common.parameters import descriptions
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.nodes.operator_console import ConsoleParameters, OperatorConsole
from rpms_ros.nodes.recorder import RecorderParameters
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.schedule_messages import schedule_of
from rpms_ros.stimulation import schedule_from_text
from rpms_ros.stimulation.limits.patient import patient_from_mapping
from rpms_ros.stimulation.schedule.description import from_text

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'how-to' / 'first-pulse.md').read_text()
COMMANDS = [
    shlex.split(line, comments=True)[1:] for line in PAGE.splitlines() if line.startswith('ros2 ')
]
REHEARSAL = PAGE[PAGE.index('A third one.') : PAGE.index('Now stop one.')]
DRIVER = '/stimulator_driver'
PARAMETERS = {
    'stimulator_driver': DriverParameters,
    'operator_console': ConsoleParameters,
    'recorder': RecorderParameters,
}


def interface(name):
    """Return the class of ``package/kind/Name``."""
    package, kind, name = name.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def goal_of(kind, fields):
    """Return a goal as `ros2 action send_goal` makes it of a text."""
    segments = yaml.safe_load(fields)['typed_schedule']['segments']
    typed = Schedule(segments=[ScheduleSegment(**segment) for segment in segments])
    return interface(kind).Goal(typed_schedule=typed)


class Desk:
    """A driver without operator, a console, a force sensor, and a node that asks."""

    def __init__(self, graph, keyboard):
        self.graph = graph
        free = {'require_operator': False, 'require_stop_button': False}
        self.driver = graph.add(
            StimulatorDriver, **free, executor_timeout=10.0, watch_timeout=10.0
        )
        graph.add(lambda **given: OperatorConsole(keyboard, **given), operator='ada')
        self.node = graph.add(lambda **given: Node('desk', **given))
        self.node.create_publisher(WrenchStamped, 'force', 10)
        self.changes = self.node.create_client(ChangeState, f'{DRIVER}/change_state')
        graph.wait_for(lambda: self.changes.service_is_ready())

    def names(self):
        """Return what the graph has by name: topics, services and actions with their types."""
        node = self.node
        return [
            dict(found)
            for found in (
                node.get_topic_names_and_types(),
                node.get_service_names_and_types(),
                get_action_names_and_types(node),
            )
        ]

    def ask(self, future):
        self.graph.wait_for(future.done)
        return future.result()

    def change(self, label):
        request = ChangeState.Request()
        request.transition.label = label
        return self.ask(self.changes.call_async(request)).success

    def goal(self, name, kind, fields):
        client = ActionClient(self.node, interface(kind), name)
        self.graph.wait_for(client.server_is_ready)
        handle = self.ask(client.send_goal_async(goal_of(kind, fields)))
        return self.ask(handle.get_result_async()).result


class NoKeys:
    """A terminal at which nobody sits."""

    there = True

    def read(self):
        return ''

    def close(self):
        pass


@pytest.fixture
def desk(graph):
    found = Desk(graph, NoKeys())
    wanted = {'/driver_status', '/heartbeat', '/emergency_stop', '/force'}
    graph.wait_for(lambda: wanted <= set(found.names()[0]))
    return found


def plain(arguments):
    """Return arguments without flags and what belongs to them."""
    return [one for one in arguments if not one.startswith('--')]


def check_run(package, name, arguments):
    if package != 'rpms_ros':
        assert (package, name) == ('joy', 'joy_node')
        return
    assert name in {one.name for one in entry_points(group='console_scripts')}
    known = descriptions(PARAMETERS[name]) if name in PARAMETERS else ()
    for one in arguments:
        if ':=' in one:
            assert one.partition(':=')[0] in known
        if one.endswith('.yaml') and ':=' not in one:
            assert (ROOT / one).exists() or f'`{one}`' in PAGE


def check(desk, arguments):
    """Fail where a command names what is not there."""
    topics, services, actions = desk.names()
    match plain(arguments):
        case ['run', package, name, *more]:
            check_run(package, name, more)
        case ['lifecycle', 'get', node] | ['lifecycle', 'set', node, 'shutdown']:
            assert node == DRIVER
        case ['lifecycle', 'set', node, label]:
            assert node == DRIVER
            assert label in ('configure', 'activate', 'deactivate', 'cleanup')
        case ['topic', 'echo' | 'hz', name, *kind]:
            assert name in topics
            assert not kind or kind == topics[name]
        case ['service', 'call', name, kind]:
            assert services[name] == [kind]
        case ['service', 'list']:
            assert {'/request_arming', '/confirm_arming'} <= set(services)
        case ['action', 'send_goal', name, kind, fields]:
            assert actions[name] == [kind]
            schedule_of(goal_of(kind, fields).typed_schedule)
        case ['param', 'set', node, name, value]:
            assert node == DRIVER
            assert descriptions(DriverParameters)[name].dynamic
            DriverParameters(**{name: yaml.safe_load(value)})
        case ['interface', 'show', kind]:
            assert interface(kind)
        case unknown:
            pytest.fail(f'no test knows the command {unknown}')


def test_every_command_names_what_the_nodes_have(desk):
    assert len(COMMANDS) >= 30
    for arguments in COMMANDS:
        check(desk, arguments)


def test_the_rehearsal_gives_one_pulse_and_ends_as_the_page_says(desk):
    lines = [shlex.split(line)[1:] for line in REHEARSAL.splitlines() if line.startswith('ros2 ')]
    results = []
    for line in lines:
        match plain(line):
            case ['lifecycle', 'set', _, label]:
                assert desk.change(label), line
            case ['action', 'send_goal', *given]:
                results.append(desk.goal(*given))
                desk.graph.wait_for(lambda: not desk.driver._active)
    assert [(one.completed, one.pulses_delivered) for one in results] == [(True, 1)]


def test_files_of_the_page_are_read():
    air, phantom, nobody, driver = re.findall(r'```yaml\n(.*?)```', PAGE, re.DOTALL)
    assert schedule_from_text(air).totals.pulses == 1
    assert schedule_from_text(phantom).totals.pulses == 30
    assert from_text(nobody, patient_from_mapping).largest_comfortable == 0.3
    given = yaml.safe_load(driver)[DRIVER]['ros__parameters']
    settings = DriverParameters(**{**given, 'stop_buttons': tuple(given['stop_buttons'])})
    assert not settings.simulated
