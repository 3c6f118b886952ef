# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of every node: one status a task, names that do not collide, warnings that clear."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import MuscleEstimate
from rpms_ros import messages
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver


class Listener:
    """The newest status of every task on the graph."""

    def __init__(self, graph):
        self.newest = {}
        self.node = graph.add(lambda **options: Node('listener', **options))
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 100)

    def _take(self, message):
        self.newest |= {status.name: status for status in message.status}


@pytest.mark.long
def test_two_legs_have_ten_statuses_of_different_names_and_hardware(graph, tmp_path):
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
def test_a_live_page_tells_what_it_cannot_show_and_a_stop_that_nobody_confirms(graph):
    listener = Listener(graph)
    page = graph.add(lambda **options: LivePage('x' * 16, **options), port=0)
    name = '/live_page: live page'
    force = listener.node.create_publisher(WrenchStamped, 'force', qos.FORCE)
    estimate = listener.node.create_publisher(MuscleEstimate, 'estimate', qos.ESTIMATE)

    def said(level, message):
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
