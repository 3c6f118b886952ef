# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of nodes: one status a task, names that do not collide, warnings that clear."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from rpms_ros.nodes.identifier import Identifier
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
def test_two_legs_have_six_statuses_of_different_names_and_hardware(graph, tmp_path):
    listener = Listener(graph)
    for leg in ('left', 'right'):
        for kind in (StimulatorDriver, Identifier):
            graph.add(lambda kind=kind, leg=leg, **options: kind(namespace=leg, **options))
        graph.add(
            lambda leg=leg, **options: Recorder(namespace=leg, **options), path=str(tmp_path / leg)
        )
    graph.wait_for(lambda: len(listener.newest) == 6)
    tasks = ('stimulator', 'identification', 'recording')
    nodes = ('stimulator_driver', 'identifier', 'recorder')
    assert set(listener.newest) == {
        f'/{leg}/{node}: {task}'
        for leg in ('left', 'right')
        for node, task in zip(nodes, tasks, strict=True)
    }
    hardware = {status.hardware_id for status in listener.newest.values()}
    assert len(hardware) == 6
    assert all(hardware)
