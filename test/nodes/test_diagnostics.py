# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of every node: one status a task, names that do not collide, warnings that clear."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes import recorder as health_module
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder, recorder_health
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


@pytest.mark.long
def test_two_legs_have_ten_statuses_of_different_names_and_hardware(graph, tmp_path: Path) -> None:
    listener = Listener(graph)
    for leg in ('left', 'right'):
        for kind in (PlantSimulator, StimulatorDriver, Identifier):
            graph.add(lambda kind=kind, leg=leg, **options: kind(namespace=leg, **options))
        graph.add(
            lambda leg=leg, **options: Recorder(namespace=leg, **options),
            path=str(tmp_path / leg),
        )
        graph.add(lambda leg=leg, **options: LivePage(namespace=leg, **options), port=0)
    graph.wait_for(lambda: len(listener.newest) == 10)
    tasks = ('simulation', 'stimulator', 'identification', 'recording', 'live page')
    nodes = ('plant_simulator', 'stimulator_driver', 'identifier', 'recorder', 'live_page')
    assert set(listener.newest) == {
        f'/{leg}/{node}: {task}'
        for leg in ('left', 'right')
        for node, task in zip(nodes, tasks, strict=True)
    }
    hardware = {status.hardware_id for status in listener.newest.values()}
    assert len(hardware) == 10
    assert all(hardware)


@pytest.mark.long
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


@pytest.mark.long
def test_a_live_page_tells_what_it_cannot_show_and_a_stop_that_nobody_confirms(graph) -> None:
    listener = Listener(graph)
    page = graph.add(lambda **options: LivePage('x' * 16, **options), port=0)
    name = '/live_page: live page'
    force = listener.node.create_publisher(WrenchStamped, 'force', qos.FORCE)
    estimate = listener.node.create_publisher(MuscleEstimate, 'estimate', qos.ESTIMATE)

    def said(level: bytes, message: str) -> bool:
        stamp = listener.node.get_clock().now().nanoseconds
        force.publish(messages.force_message(stamp, 1.0, messages.AXES['z'], MESSAGE_TYPES))
        status = listener.newest.get(name)
        return status is not None and (status.level, status.message) == (level, message)

    graph.wait_for(lambda: name in listener.newest)
    assert listener.newest[name].level == DiagnosticStatus.STALE
    assert listener.newest[name].message == 'no force'
    graph.wait_for(lambda: said(DiagnosticStatus.OK, 'showing'))
    assert [value.key for value in listener.newest[name].values][:3] == [
        'browsers',
        'driver',
        '/force [Hz]',
    ]
    graph.wait_for(lambda: estimate.get_subscription_count() > 0)
    estimate.publish(MuscleEstimate(nonlinear_names=['u_thr']))
    graph.wait_for(lambda: said(DiagnosticStatus.WARN, 'cannot show all of /estimate'))
    page.stop.press()
    graph.wait_for(
        lambda: said(DiagnosticStatus.WARN, 'stop pressed, not confirmed by the driver')
    )
    page.stop.let_go()
    estimate.publish(MuscleEstimate())
    graph.wait_for(lambda: said(DiagnosticStatus.OK, 'showing'))


def test_a_recorder_says_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def room(free: int) -> None:
        usage = SimpleNamespace(free=free)
        monkeypatch.setattr(health_module.shutil, 'disk_usage', lambda _: usage)

    room(5_000_000_000)
    assert recorder_health(tmp_path, {'force': 0}, {}).message == 'recording; no message yet'
    fine = recorder_health(tmp_path, {'force': 3}, {})
    assert (fine.level, fine.message) == (DiagnosticStatus.OK, 'recording')
    assert fine.figures['messages of force'] == 3
    lossy = recorder_health(tmp_path, {'force': 3}, {'force': 7})
    assert (lossy.level, lossy.message) == (DiagnosticStatus.WARN, '7 messages of force lost')
    room(20_000_000)
    full = recorder_health(tmp_path, {'force': 3}, {})
    assert (full.level, full.message) == (DiagnosticStatus.WARN, '20 MB are left on the disk')
