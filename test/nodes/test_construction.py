# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node that is refused leaves the graph, while its error is still held."""

import threading
from pathlib import Path

import pytest
from rclpy.node import Node

from rpms_ros.errors import RpmsError
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.operator_console import OperatorConsole
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButton

DEPTH = 'qos_overrides./force.subscription.depth'


class _NoTerminal:
    """Stands for a terminal that is not there; remembers whether it was let go of."""

    there = False

    def __init__(self) -> None:
        self.closed = False

    def read(self) -> str:
        return ''

    def close(self) -> None:
        self.closed = True


def names(node: Node) -> set[str]:
    """Nodes on the graph, but for the one that looks."""
    return {name for name, _ in node.get_node_names_and_namespaces()} - {node.get_name()}


# rclpy warns of a depth of zero, too
@pytest.mark.filterwarnings('ignore:A zero depth')
@pytest.mark.parametrize(
    ('kind', 'parameters', 'message'),
    [
        (Identifier, {'estimator': 'guess'}, 'estimator'),
        (Identifier, {'state_folder': '/no/such'}, 'expected a folder'),
        (Identifier, {DEPTH: 0}, 'expected a depth of 1'),
        (PlantSimulator, {'rate': -1.0}, 'rate'),
        (Recorder, {'storage': 'tape'}, 'storage'),
        (Recorder, {'path': '/proc/no/such'}, 'expected'),
        (Recorder, {DEPTH: 0}, 'expected a depth of 1'),
        (LivePage, {'address': 'no such address'}, 'address'),
        (LivePage, {DEPTH: 0}, 'expected a depth of 1'),
        (StimulatorDriver, {'maximum_intensity': 2.0}, 'maximum_intensity'),
        (StimulatorDriver, {'audit_log': '/proc/no/such'}, 'expected'),
        (StopButton, {'keyboard': False}, 'expected a keyboard or a joy_button'),
        (OperatorConsole, {'operator': ''}, 'expected the name of the operator'),
    ],
)
def test_a_node_that_is_refused_is_not_on_the_graph(
    graph,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: type[Node],
    parameters: dict[str, object],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    other = graph.add(lambda **options: Node('other', **options))
    threads = set(threading.enumerate())
    with pytest.raises(RpmsError, match=message) as refused:
        graph.add(kind, **parameters)
    graph.wait_for(lambda: not names(other))
    # one of before may have ended meanwhile
    assert set(threading.enumerate()) <= threads
    # whoever holds the error holds what was built of the node
    assert refused.traceback


def test_a_console_without_a_terminal_lets_go_of_it(graph, tmp_path: Path) -> None:
    other = graph.add(lambda **options: Node('other', **options))
    schedule = tmp_path / 'schedule.yaml'
    schedule.write_text('segments: [{kind: pause, duration_s: 1.0}]')
    terminal = _NoTerminal()
    with pytest.raises(RpmsError, match='expected a terminal'):
        graph.add(
            lambda **options: OperatorConsole(terminal, **options),
            operator='ada',
            schedule_file=str(schedule),
        )
    assert terminal.closed
    graph.wait_for(lambda: not names(other))


def test_the_driver_ends_what_it_has_begun_when_its_last_part_is_refused(
    graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise RpmsError('expected the last part, got none')

    monkeypatch.setattr('rpms_ros.nodes.stimulator_driver.follow_parameters', refuse)
    other = graph.add(lambda **options: Node('other', **options))
    threads = set(threading.enumerate())
    log = tmp_path / 'audit.jsonl'
    with pytest.raises(RpmsError, match='the last part'):
        graph.add(StimulatorDriver, audit_log=str(log))
    # one of before may have ended meanwhile
    assert set(threading.enumerate()) <= threads
    assert log.read_text().splitlines()[-1].count('"end"') == 1
    graph.wait_for(lambda: not names(other))
