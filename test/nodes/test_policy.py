# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of what each node may do is what the running nodes do; policies say just that."""

import os
import pty
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from rclpy.node import Node

from rpms_ros.nodes import policy
from rpms_ros.nodes.common.keyboard import Keyboard
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.operator_console import OperatorConsole
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButton

ROOT = Path(__file__).resolve().parents[2]
SERVER_TOPICS = ('feedback', 'status')
SERVER_SERVICES = ('cancel_goal', 'get_result', 'send_goal')


@pytest.fixture
def running(graph, tmp_path):
    """A node that looks at all others, in a namespace so that relative names show."""
    typed, read = pty.openpty()
    keyboard = Keyboard(read)
    graph.add(StimulatorDriver, force_limit=10.0)
    graph.add(lambda **options: OperatorConsole(keyboard, **options), operator='ada', joy_enable=0)
    graph.add(StopButton, keyboard=False, joy_button=0)
    graph.add(Identifier)
    graph.add(PlantSimulator, publish_clock=True)
    graph.add(Recorder, path=str(tmp_path / 'recording'))
    page = graph.add(lambda **options: LivePage('x' * 16, **options), port=0)
    # a button of the page is on the graph only while it is pressed
    page.stop.press()
    watcher = graph.add(lambda **options: Node('watcher', **options))
    graph.wait_for(lambda: len(watcher.get_node_names()) >= 11)
    graph.wait_for(lambda: page.stop._button is not None)
    yield watcher
    os.close(typed)
    os.close(read)


def full(names, node):
    return {name if name.startswith('/') else f'/{name.replace("~", node)}' for name in names}


def of_action(actions, parts):
    return {f'/{action}/_action/{part}' for action in actions for part in parts}


@pytest.mark.long
@pytest.mark.parametrize('node', policy.NODES)
def test_the_table_is_what_a_node_really_does(running, node):
    declared = policy.NODES[node]

    def real(ask):
        return {name for name, _ in ask(node, '/')}

    assert real(running.get_publisher_names_and_types_by_node) == (
        full((*declared.publish, *declared.common_topics), node)
        | of_action(declared.execute, SERVER_TOPICS)
    )
    assert real(running.get_subscriber_names_and_types_by_node) == (
        full(declared.subscribe, node) | of_action(declared.start, SERVER_TOPICS)
    )
    assert real(running.get_service_names_and_types_by_node) == (
        full((*declared.serve, *declared.common_services), node)
        | of_action(declared.execute, SERVER_SERVICES)
    )
    assert real(running.get_client_names_and_types_by_node) == (
        full(declared.call, node) | of_action(declared.start, SERVER_SERVICES)
    )


def test_policies_are_written_and_allow_what_the_table_says(tmp_path):
    command = [sys.executable, str(ROOT / 'tools' / 'policies'), str(tmp_path), '/ward']
    subprocess.run(command, check=True)
    assert {path.stem for path in tmp_path.iterdir()} == set(policy.ENCLAVES)
    tree = ET.parse(tmp_path / 'stimulator_driver.xml')
    profiles = tree.findall('.//profile')
    assert [profile.get('node') for profile in profiles] == [
        'stimulator_driver',
        'stimulator_driver_watch',
    ]
    assert {profile.get('ns') for profile in profiles} == {'/ward'}
    heard = [topic.text for topic in profiles[1].findall('topics[@subscribe="ALLOW"]/topic')]
    assert heard == ['emergency_stop', 'heartbeat']
    (button,) = ET.parse(tmp_path / 'stop_button.xml').findall('.//profile')
    spoken = [topic.text for topic in button.findall('topics[@publish="ALLOW"]/topic')]
    assert spoken == ['/diagnostics', '/parameter_events', '/rosout', 'emergency_stop']
    assert button.find('actions') is None


def test_the_script_says_how_it_is_used():
    command = [sys.executable, str(ROOT / 'tools' / 'policies')]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 2
    assert 'Usage: tools/policies FOLDER' in answer.stderr
