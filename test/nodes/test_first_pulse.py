# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""docs/how-to/first-pulse.md: its rehearsal gives one pulse, its files are read."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.node import Node

from rpms_msgs.msg import Schedule, ScheduleSegment
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.stimulation import schedule_from_text
from rpms_ros.stimulation.limits.patient import patient_from_mapping
from rpms_ros.stimulation.schedule.description import from_text

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'how-to' / 'first-pulse.md').read_text()
REHEARSAL = PAGE[PAGE.index('A third one.') : PAGE.index('Now stop one.')]
DRIVER = '/stimulator_driver'


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
    """A driver without operator, and a node that asks."""

    def __init__(self, graph):
        self.graph = graph
        free = {'require_operator': False, 'require_stop_button': False}
        self.driver = graph.add(StimulatorDriver, **free)
        self.node = graph.add(lambda **given: Node('desk', **given))
        self.changes = self.node.create_client(ChangeState, f'{DRIVER}/change_state')
        graph.wait_for(lambda: self.changes.service_is_ready())

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


@pytest.fixture
def desk(graph):
    return Desk(graph)


def plain(arguments):
    """Return arguments without flags and what belongs to them."""
    return [one for one in arguments if not one.startswith('--')]


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
