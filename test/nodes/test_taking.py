# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages without an executor, and for a driver with the identity of their publisher."""

import pytest
from rclpy.node import Node
from std_msgs.msg import Bool

from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.driver import watch
from rpms_ros.nodes.driver.watch import Taker, publishers_of


def test_a_message_comes_with_the_publisher_that_the_graph_shows(graph, wait_for):
    silent = Node('silent', context=graph.context, use_global_arguments=False)
    taker = Taker(silent.create_subscription(Bool, 'said', lambda _: None, qos.STOP_LIVE))
    speakers = [graph.add(lambda name=name, **o: Node(name, **o)) for name in ('one', 'two')]
    talk = [node.create_publisher(Bool, 'said', qos.STOP) for node in speakers]
    graph.wait_for(lambda: all(each.get_subscription_count() == 1 for each in talk))
    graph.wait_for(lambda: len(publishers_of(silent, '/said')) == 2)
    assert taker.take() is None
    names = publishers_of(silent, '/said')
    for number in (1, 2):
        for publisher, name, state in zip(talk, ('/one', '/two'), (True, False), strict=True):
            publisher.publish(Bool(data=state))
            found = []
            wait_for(lambda found=found: found.append(taker.take()) or found[-1] is not None)
            taken = found[-1]
            assert names[taken.identity] == name
            assert taken.sequence == number
            assert taken.data == bytes([0, 1, 0, 0, state])
    taker.close()
    silent.destroy_node()


def test_another_rcl_is_refused(graph, monkeypatch):
    node = graph.add(lambda **options: Node('silent', **options))
    subscription = node.create_subscription(Bool, 'said', lambda _: None, qos.STOP_LIVE)

    def missing(name):
        raise OSError(f'{name} is not there')

    monkeypatch.setattr(watch.ctypes, 'CDLL', missing)
    with pytest.raises(NodeError, match=r'expected rcl of ROS 2 Jazzy, got librcl\.so is not'):
        Taker(subscription)
