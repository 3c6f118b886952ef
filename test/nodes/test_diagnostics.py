"""Diagnostics of every node: one status a task, names that do not collide, warnings that clear."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes import qos
from rpms_ros.nodes import recorder_health as health_module
from rpms_ros.nodes.diagnostics import RecentChange
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.recorder_health import recorder_health
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.pulses import Pulse

SECOND = 1_000_000_000


class Listener:
    """The newest status of every task on the graph."""

    def __init__(self, graph) -> None:
        self.newest: dict[str, DiagnosticStatus] = {}
        self.node = graph.add(lambda **options: Node('listener', **options))
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 100)

    def _take(self, message: DiagnosticArray) -> None:
        self.newest |= {status.name: status for status in message.status}


def test_two_legs_have_eight_statuses_of_different_names_and_hardware(
    graph, tmp_path: Path
) -> None:
    listener = Listener(graph)
    for leg in ('left', 'right'):
        for kind in (PlantSimulator, StimulatorDriver, Identifier):
            graph.add(lambda kind=kind, leg=leg, **options: kind(namespace=leg, **options))
        graph.add(
            lambda leg=leg, **options: Recorder(namespace=leg, **options),
            path=str(tmp_path / leg),
        )
    graph.wait_for(lambda: len(listener.newest) == 8)
    tasks = ('simulation', 'stimulator', 'identification', 'recording')
    nodes = ('plant_simulator', 'stimulator_driver', 'identifier', 'recorder')
    assert set(listener.newest) == {
        f'/{leg}/{node}: {task}'
        for leg in ('left', 'right')
        for node, task in zip(nodes, tasks, strict=True)
    }
    hardware = {status.hardware_id for status in listener.newest.values()}
    assert len(hardware) == 8
    assert all(hardware)


def test_a_simulator_warns_of_a_wrong_pulse_and_the_warning_clears(graph) -> None:
    listener = Listener(graph)
    plant = graph.add(PlantSimulator)
    pulses = listener.node.create_publisher(PulseMessage, 'pulses', qos.PULSES)
    name = '/plant_simulator: simulation'
    graph.wait_for(lambda: name in listener.newest and pulses.get_subscription_count() == 1)
    assert listener.newest[name].level == DiagnosticStatus.OK
    pulses.publish(messages.pulse_message(Pulse(10**18, 2.0), MESSAGE_TYPES))
    graph.wait_for(lambda: listener.newest[name].level == DiagnosticStatus.WARN)
    assert listener.newest[name].message == 'simulating; a pulse was wrong or late'
    plant._recent._changed_ns -= 10 * SECOND
    graph.wait_for(lambda: listener.newest[name].level == DiagnosticStatus.OK)


def test_a_change_is_recent_for_ten_seconds() -> None:
    recent = RecentChange()
    assert not recent.seen(0, 0)
    assert recent.seen(1, SECOND)
    assert recent.seen(1, 11 * SECOND - 1)
    assert not recent.seen(1, 11 * SECOND)


def test_a_recorder_says_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def room(free: int) -> None:
        usage = SimpleNamespace(free=free)
        monkeypatch.setattr(health_module.shutil, 'disk_usage', lambda _: usage)

    room(5_000_000_000)
    assert recorder_health(tmp_path, {'force': 0}, []).message == (
        'recording; nothing has come yet'
    )
    fine = recorder_health(tmp_path, {'force': 3}, [])
    assert (fine.level, fine.message) == (DiagnosticStatus.OK, 'recording')
    assert fine.figures['messages of force'] == 3
    lacking = recorder_health(tmp_path, {'force': 3}, ['jaw'])
    assert (lacking.level, lacking.message) == (DiagnosticStatus.WARN, 'not recorded: jaw')
    room(20_000_000)
    full = recorder_health(tmp_path, {'force': 3}, [])
    assert (full.level, full.message) == (DiagnosticStatus.WARN, '20 MB are left on the disk')
