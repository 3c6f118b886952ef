# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stop buttons as publishers: every kind is heard, each by itself, however much the others say."""

import threading
import time
from functools import partial

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from rpms_msgs.msg import DriverStatus
from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.operator import ButtonPublisher
from rpms_ros.nodes.driver import watch
from rpms_ros.nodes.driver.watch import Taker, publishers_of, says_released

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def new_ward(driver_bench):
    """Make a driver that asks for a stop button, and is configured."""
    return partial(driver_bench, require_stop_button=True, configured=True)


def test_without_a_button_nothing_is_armed(new_ward):
    ward = new_ward()
    assert not ward.arms()
    ward.wait_for_reason('expected a stop button that says its state at a rate, got none')


@pytest.mark.parametrize('profile', [BEST_EFFORT, qos.STOP, qos.STOP_STATE])
def test_a_button_of_any_kind_is_heard(new_ward, profile):
    ward = new_ward()
    said = [False]
    button = ward.other.create_publisher(Bool, topics.EMERGENCY_STOP, profile)
    ward.other.create_timer(0.02, lambda: button.publish(Bool(data=said[0])))
    ward.run()
    said[0] = True
    assert ward.stopped().startswith('emergency stop is pressed (/other)')


def test_a_press_that_is_released_before_the_driver_looks_stops(new_ward, graph):
    ward = new_ward()
    ButtonPublisher(ward.other)
    publisher = ward.other.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP_STATE)
    say = ward.other.create_timer(0.02, lambda: publisher.publish(Bool(data=False)))
    ward.knows('/other', '/other')
    ward.run()
    # a thread that is held up hears press and release at once
    with ward.driver._watch._lock:
        say.cancel()
        for pressed in (True, False):
            publisher.publish(Bool(data=pressed))
        say.reset()
    assert ward.stopped().startswith('emergency stop is pressed (/other)')
    graph.wait_for(lambda: ward.resets().success)
    assert ward.arms()


def test_one_that_was_pressed_before_the_driver_was_there_is_seen(new_ward, graph):
    early = graph.node('early')
    early.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP_STATE).publish(Bool(data=True))
    ward = new_ward(require_stop_button=False)
    assert ward.stopped().startswith('emergency stop is pressed (/early)')
    assert not ward.arms()
    assert not ward.resets().success


def test_a_button_that_says_nothing_forbids_arming(new_ward, graph):
    ward = new_ward(require_stop_button=False)
    ward.other.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP)
    # an arming that was quicker than the graph is undone by it
    graph.wait_for(lambda: not ward.arms())
    ward.wait_for_reason('expected every stop button to speak, got 1 still unknown')
    states = ward.statuses[-1]
    assert list(states.button_states) == [DriverStatus.BUTTON_UNKNOWN]


def test_a_button_that_falls_silent_stops(new_ward, graph):
    ward = new_ward(stop_button_timeout=3.0)
    button = ButtonPublisher(ward.other)
    ward.run()
    button.timer.cancel()
    assert ward.stopped().startswith('expected stop button /other to say its state every 3 s')
    assert not ward.resets().success
    button.timer.reset()
    graph.wait_for(lambda: ward.resets().success)


def test_of_two_buttons_one_pressed_is_enough_and_keeps_the_stop(new_ward, graph):
    ward = new_ward()
    first, second = ButtonPublisher(ward.other), ButtonPublisher(ward.other)
    # one that is seen before it is heard stops too
    ward.knows('/other', '/other')
    ward.run()
    first.set(True)
    ward.stopped()
    graph.wait_for(lambda: first.pressed and not second.pressed)
    answer = ward.resets()
    assert not answer.success
    assert answer.message.startswith(
        'reset: expected the cause emergency_stop gone, got emergency stop is pressed'
    )
    first.set(False)
    graph.wait_for(lambda: ward.resets().success)
    assert ward.arms()


def test_a_button_that_must_be_present_keeps_the_stop_when_it_went_away(new_ward, graph):
    ward = new_ward(stop_buttons=['/left/foot_switch', 'other'], stop_button_timeout=3.0)
    ButtonPublisher(ward.other)
    ward.knows('/other')
    assert not ward.arms()
    ward.wait_for_reason(
        'expected stop button /left/foot_switch on the graph, speaking and released'
    )

    def foot_switch():
        """One that speaks, from a namespace of its own."""
        node = graph.node('foot_switch', namespace='/left')
        publisher = node.create_publisher(Bool, f'/{topics.EMERGENCY_STOP}', qos.STOP_STATE)
        node.create_timer(0.02, lambda: publisher.publish(Bool(data=False)))
        return node

    switch = foot_switch()
    ward.run()
    graph.remove(switch)
    ward.stopped()
    # its silence is over once a reset has forgotten it: the others do not stand in for it
    refused = 'expected stop button /left/foot_switch on the graph'
    graph.wait_for(lambda: refused in ward.resets().message)
    foot_switch()
    graph.wait_for(lambda: ward.resets().success)
    ward.run()


def test_a_publisher_that_runs_wild_does_not_hide_a_press(new_ward, graph):
    ward = new_ward()
    button = ButtonPublisher(ward.other)
    wild = ward.other.create_publisher(Bool, topics.EMERGENCY_STOP, BEST_EFFORT)
    ward.other.create_timer(0.02, lambda: wild.publish(Bool(data=False)))
    ward.knows('/other', '/other')
    ward.run()
    end = threading.Event()

    def flood():
        while not end.is_set():
            for _ in range(200):
                wild.publish(Bool(data=False))

    thread = threading.Thread(target=flood)
    thread.start()
    try:
        button.set(True)
        reason = ward.stopped()
    finally:
        end.set()
        thread.join()
    assert 'emergency stop is pressed' in reason or 'some may be lost' in reason
    button.say()
    graph.wait_for(lambda: not ward.resets().success)


def test_states_that_may_have_been_pushed_out_of_the_queue_stop(new_ward):
    ward = new_ward()
    button = ButtonPublisher(ward.other)
    ward.knows('/other')
    ward.run()
    # as on a machine that holds up the thread that listens
    with ward.driver._watch._lock:
        for _ in range(qos.STOP_DEPTH + 10):
            button.say()
    reason = ward.stopped()
    assert 'expected at most 2000 messages in a look' in reason


def latched(ward, wait_for):
    """Wait for a stop while nobody spins the executor; return its reason."""
    wait_for(lambda: ward.controller.interlocks.latched)
    commanded = ward.controller.commanded
    assert not ward.controller.device.armed
    time.sleep(0.2)
    assert ward.controller.commanded == commanded
    return ward.controller.interlocks.latched_reason


def test_a_press_is_heard_while_the_executor_is_blocked(new_ward, graph, wait_for):
    ward = new_ward()
    other = Node('hand', context=graph.context, use_global_arguments=False)
    publisher = other.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP_STATE)
    publisher.publish(Bool(data=False))
    said = threading.Event()

    def say():
        while not said.wait(0.02):
            publisher.publish(Bool(data=False))
        publisher.publish(Bool(data=True))

    thread = threading.Thread(target=say)
    thread.start()
    try:
        ward.knows('/hand')
        ward.run()
        # nobody spins the executor from here on
        said.set()
        assert 'emergency stop is pressed (/hand)' in latched(ward, wait_for)
    finally:
        said.set()
        thread.join()
    other.destroy_node()


def test_the_stop_service_is_heard_while_the_executor_is_blocked(new_ward, wait_for):
    ward = new_ward(require_stop_button=False)
    ward.run()
    # nobody spins the executor of driver and client from here on
    answer = ward.stop.call_async(Trigger.Request())
    assert latched(ward, wait_for) == 'emergency stop by service'
    assert ward.ask(answer).success


def test_anything_but_one_zero_byte_is_pressed():
    assert says_released(b'\0\1\0\0\0')
    # three bytes fill up a word; not every middleware says so
    assert says_released(b'\0\1\0\3\0\0\0\0')
    assert says_released(b'\0\1\0\0\0\0\0\0')
    wrong = (b'\0\1\0\0\1', b'\0\1\0\0', b'\0\1\0\0\0\0', b'\0\1\0\3\1\0\0\0')
    wrong += (b'\0\1\0\0\1\0\0\0', b'\0\1\0\3\0', b'\0', b'')
    assert not any(says_released(data) for data in wrong)


BUTTON = """
import sys
import threading
import rclpy
from rpms_ros.nodes.common.operator import ButtonPublisher
rclpy.init()
node = rclpy.create_node('hand')
button = ButtonPublisher(node)
threading.Thread(target=lambda: button.set(bool(sys.stdin.readline())), daemon=True).start()
rclpy.spin(node)
"""


def test_a_button_of_another_process_is_heard(new_ward, python):
    ward = new_ward()
    hand = python('-c', BUTTON)
    ward.knows('/hand')
    ward.run()
    hand.stdin.write('press\n')
    hand.stdin.flush()
    assert ward.stopped().startswith('emergency stop is pressed (/hand)')
    hand.terminate()
    # it is known by its name when it has gone
    ward.graph.wait_for(lambda: not ward.other.get_publishers_info_by_topic('emergency_stop'))
    answer = ward.resets()
    assert not answer.success
    assert answer.message.endswith('got emergency stop is pressed (/hand)')


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
    node = graph.node('silent')
    subscription = node.create_subscription(Bool, 'said', lambda _: None, qos.STOP_LIVE)

    def missing(name):
        raise OSError(f'{name} is not there')

    monkeypatch.setattr(watch.ctypes, 'CDLL', missing)
    with pytest.raises(NodeError, match=r'expected rcl of ROS 2 Jazzy, got librcl\.so is not'):
        Taker(subscription)
