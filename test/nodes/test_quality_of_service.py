# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service: what a user may replace, and publishers that nobody was told of."""

from collections.abc import Callable
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from rpms_ros import messages
from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.recorder import Recorder

RELIABILITY = 'qos_overrides./force.subscription.reliability'


def built(kind: type[Node], tmp_path: Path) -> Callable[..., Node]:
    """Return how a node is made, a recorder with a folder of its own."""
    if kind is Identifier:
        return Identifier
    if kind is LivePage:
        return lambda **options: LivePage(cli_args=['--ros-args', '-p', 'port:=0'], **options)
    path = [f'path:={tmp_path / "session"}']
    arguments = [part for value in path for part in ('-p', value)]
    return lambda **options: Recorder(cli_args=['--ros-args', *arguments], **options)


@pytest.mark.parametrize('kind', [Identifier, Recorder, LivePage])
def test_a_user_may_replace_the_quality_of_the_force(
    graph, tmp_path: Path, capfd: pytest.CaptureFixture[str], kind: type[Node]
) -> None:
    node = graph.add(
        built(kind, tmp_path),
        **{
            RELIABILITY: 'best_effort',
            'qos_overrides./force.subscription.depth': 7,
            'qos_overrides./forse.subscription.depth': 7,
        },
    )
    (info,) = node.get_subscriptions_info_by_topic('/force')
    assert info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert node.get_parameter('qos_overrides./force.subscription.depth').value == 7
    # the profile that other nodes of this process take is as it was
    assert qos.FORCE.reliability is ReliabilityPolicy.RELIABLE
    assert qos.FORCE.depth == 5000
    said = ''.join(capfd.readouterr())
    assert 'qos_overrides./forse.subscription.depth fits no topic of this node' in said
    assert said.count('fits no topic') == 1


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        (RELIABILITY, 'sometimes', 'Unexpected QoS override for policy .reliability.: .sometimes'),
        ('qos_overrides./force.subscription.depth', 0, 'expected a depth of 1 or more, got 0'),
        (
            'qos_overrides./force.subscription.depth',
            'deep',
            'with a quality of service, got Trying',
        ),
    ],
)
# rclpy warns of it, too
@pytest.mark.filterwarnings('ignore:A zero depth')
def test_what_is_no_quality_of_service_is_refused(
    graph, name: str, value: object, message: str
) -> None:
    with pytest.raises(NodeError, match=message):
        graph.add(Identifier, **{name: value})


@pytest.mark.filterwarnings('ignore:A zero depth')
def test_a_recorder_that_cannot_be_made_leaves_no_open_file(graph, tmp_path: Path) -> None:
    # an unclosed file is a warning, and a warning an error here
    with pytest.raises(NodeError, match='got 0'):
        graph.add(built(Recorder, tmp_path), **{'qos_overrides./force.subscription.depth': 0})
    assert (tmp_path / 'session' / 'metadata.yaml').is_file()


def test_a_recorder_hears_a_best_effort_sensor_without_being_told(
    graph, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sensor = graph.add(lambda **options: Node('sensor', **options))
    force = sensor.create_publisher(WrenchStamped, 'force', qos.FORCE_BEST_EFFORT)
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    graph.wait_for(lambda: force.get_subscription_count() == 1)
    sample = messages.force_message(10**18, 1.0, messages.AXES['z'], MESSAGE_TYPES)

    def heard() -> bool:
        force.publish(sample)
        return recorder.counts['force'] > 0

    graph.wait_for(heard)
    said = ''.join(capfd.readouterr())
    assert '/force is published best effort: it is recorded' in said
    recorder.close()
    assert f'closed {recorder.path}: ' in ''.join(capfd.readouterr())
