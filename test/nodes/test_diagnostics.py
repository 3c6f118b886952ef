# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of nodes: one status a task, names that do not collide, warnings that clear."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver


@pytest.mark.long
def test_two_legs_have_six_statuses_of_different_names_and_hardware(graph, tmp_path):
    heard = graph.heard(DiagnosticArray, '/diagnostics')

    def newest():
        return {status.name: status for message in heard for status in message.status}

    for leg in ('left', 'right'):
        for kind in (StimulatorDriver, Identifier):
            graph.add(lambda kind=kind, leg=leg, **options: kind(namespace=leg, **options))
        graph.add(
            lambda leg=leg, **options: Recorder(namespace=leg, **options), path=str(tmp_path / leg)
        )
    graph.wait_for(lambda: len(newest()) == 6)
    tasks = ('stimulator', 'identification', 'recording')
    nodes = ('stimulator_driver', 'identifier', 'recorder')
    assert set(newest()) == {
        f'/{leg}/{node}: {task}'
        for leg in ('left', 'right')
        for node, task in zip(nodes, tasks, strict=True)
    }
    hardware = {status.hardware_id for status in newest().values()}
    assert len(hardware) == 6
    assert all(hardware)
