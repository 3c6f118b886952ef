# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stop button and operator's console: keys on a real terminal, a joystick, a real driver."""

import contextlib
import os
import pty
import time
from functools import partial

import pytest
from rclpy.task import Future
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from rpms_msgs.msg import DriverStatus, OperatorHeartbeat, Pulse
from rpms_ros.nodes import operator_console
from rpms_ros.nodes.common import operator, qos, topics
from rpms_ros.nodes.common.operator import ButtonPublisher, Keyboard
from rpms_ros.nodes.operator_console import OperatorConsole
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButton
from rpms_ros.stimulation import Pause, Schedule, Single, constant

LONG = constant(0.5, 60.0, 50.0)


@pytest.fixture
def terminal():
    """Both ends of a terminal: where keys are typed, and a keyboard that reads them."""
    typed, read = pty.openpty()
    yield typed, Keyboard(read)
    for descriptor in (typed, read):
        with contextlib.suppress(OSError):
            os.close(descriptor)


@pytest.fixture
def said(graph):
    """What every stop button of the graph says; `heard` is all of it."""
    heard = graph.heard(Bool, topics.EMERGENCY_STOP, qos.STOP_LIVE)

    def newest():
        return heard[-1].data if heard else None

    newest.heard = heard
    return newest


@pytest.fixture
def typed(graph, terminal, said):
    """Where keys of a stop button are typed that has said that it is released."""
    graph.add(partial(StopButton, terminal[1]))
    graph.wait_for(lambda: said() is False)
    return terminal[0]


def test_any_key_presses_one_lets_go_and_a_terminal_that_is_gone_counts_as_pressed(
    graph, typed, said
):
    os.write(typed, b' ')
    graph.wait_for(lambda: said() is True)
    os.write(typed, b'r')
    graph.wait_for(lambda: said() is False)
    os.close(typed)
    graph.wait_for(lambda: said() is True)


def test_a_key_and_its_release_that_are_read_at_once_are_a_press(graph, typed, said):
    os.write(typed, b' r')
    graph.wait_for(lambda: any(one.data for one in said.heard))
    graph.wait_for(lambda: said() is False)


def test_a_joystick_presses_and_its_silence_too(graph, said):
    graph.add(StopButton, keyboard=False, joy_button=2, joy_timeout=1.0)
    graph.wait_for(lambda: said() is True)
    stick = graph.node('stick')
    down = [0]
    publisher = stick.create_publisher(Joy, topics.JOY, 10)
    timer = stick.create_timer(0.02, lambda: publisher.publish(Joy(buttons=[0, 0, down[0]])))
    graph.wait_for(lambda: said() is False)
    said.heard.clear()
    # nobody takes the first before the second is there
    for pressed in (1, 0):
        publisher.publish(Joy(buttons=[0, 0, pressed]))
    graph.wait_for(lambda: any(one.data for one in said.heard) and not said())
    down[0] = 1
    graph.wait_for(lambda: said() is True)
    down[0] = 0
    graph.wait_for(lambda: said() is False)
    timer.cancel()
    graph.wait_for(lambda: said() is True)


def test_an_enable_that_is_held_again_before_the_console_looks_was_let_go_of(
    graph, terminal, monkeypatch
):
    monkeypatch.setattr(operator_console, 'JOY_TIMEOUT_S', 10.0)
    beats = graph.heard(OperatorHeartbeat, topics.HEARTBEAT, qos.STOP_LIVE)
    console = graph.add(partial(OperatorConsole, terminal[1]), operator='ada', joy_enable=1)
    console.client.token = 'any'
    publisher = graph.publisher(Joy, topics.JOY, 10)
    graph.wait_for(lambda: bool(beats))
    publisher.publish(Joy(buttons=[0, 1]))
    graph.wait_for(lambda: beats[-1].enable)
    beats.clear()
    # nobody takes the first before the second is there
    for held in (0, 1):
        publisher.publish(Joy(buttons=[0, held]))
    graph.wait_for(lambda: any(not beat.enable for beat in beats))
    graph.wait_for(lambda: beats[-1].enable)


def test_a_button_that_leaves_ends_nobody_when_its_timer_is_already_due(graph, monkeypatch):
    node = graph.node('page')
    monkeypatch.setattr(operator, 'RATE', 5.0)
    button, left = ButtonPublisher(node), []

    def leave():
        button.destroy()
        leaving.cancel()
        left.append(time.monotonic())

    def stall():
        stalling.cancel()
        time.sleep(0.5)

    # both timers are due when the executor looks again, the button's after the other
    leaving = node.create_timer(0.1, leave)
    stalling = node.create_timer(0.02, stall)
    graph.wait_for(lambda: bool(left) and time.monotonic() > left[0] + 0.2)
    assert node.count_publishers(topics.EMERGENCY_STOP) == 0


@pytest.mark.long
def test_the_console_arms_runs_and_disarms(graph, terminal, schedule_file):
    typed, keyboard = terminal
    pulses = graph.heard(Pulse, topics.PULSES, qos.PULSES)
    statuses = graph.heard(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    # a machine under load may stall for longer than the default allows
    driver = graph.add(
        StimulatorDriver, stop_button_timeout=5.0, heartbeat_timeout=5.0, lateness_limit=0.1
    )
    ada = {'operator': 'ada', 'schedule_file': schedule_file(LONG), 'key_repeat': 2.0}
    console = graph.add(partial(OperatorConsole, keyboard), **ada)
    graph.wait_for(lambda: console.client.ready and bool(statuses))
    # of a driver that was gone before it answered
    console._pending = Future()
    os.write(typed, b'a')
    graph.wait_for(lambda: bool(console.client.token))
    assert driver.controller.state.name == 'DISARMED'
    # a tap is not a hold
    os.write(typed, b'e')
    end = time.monotonic() + 0.3
    graph.wait_for(lambda: time.monotonic() > end)
    assert not console.client.enable
    typing = graph.node('fingers').create_timer(0.05, lambda: os.write(typed, b'e'))
    graph.wait_for(lambda: len(pulses) > 3)
    assert statuses[-1].operator_id == 'ada'
    typing.cancel()
    graph.wait_for(lambda: statuses[-1].state == DriverStatus.DISARMED)
    assert 'to hold the enable' in statuses[-1].reason
    os.write(typed, b'x')
    graph.wait_for(lambda: statuses[-1].state == DriverStatus.STOPPED)
    graph.wait_for(lambda: console.button.pressed)
    os.write(typed, b'r')
    graph.wait_for(lambda: not console.button.pressed)
    # the driver may have heard the reset before the button
    end = time.monotonic() + 60.0
    while statuses[-1].state == DriverStatus.STOPPED and time.monotonic() < end:
        os.write(typed, b'r')
        before = len(statuses)
        graph.wait_for(lambda: len(statuses) > before)  # noqa: B023
    assert statuses[-1].state == DriverStatus.DISARMED


def test_a_goal_that_is_refused_disarms_and_latches_nothing(graph, terminal, schedule_file):
    typed, keyboard = terminal
    statuses = graph.heard(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    graph.add(StimulatorDriver, stop_button_timeout=5.0, heartbeat_timeout=1.0)
    # longer than the driver stays armed without a pulse
    refused = schedule_file(Schedule((Single(0.5), Pause(100.0))))
    ada = {'operator': 'ada', 'schedule_file': refused, 'key_repeat': 2.0}
    console = graph.add(partial(OperatorConsole, keyboard), **ada)
    graph.wait_for(lambda: console.client.ready and bool(statuses))
    os.write(typed, b'a')
    graph.wait_for(lambda: bool(console.client.token))
    graph.node('fingers').create_timer(0.05, lambda: os.write(typed, b'e'))
    graph.wait_for(lambda: console._started and not console.client.token)
    end = time.monotonic() + 2.0
    graph.wait_for(lambda: time.monotonic() > end)
    assert statuses[-1].state == DriverStatus.DISARMED
    assert 'to hold the enable' in statuses[-1].reason


def test_what_is_lost_is_said_by_button_and_console(graph, terminal, capfd):
    graph.add(StopButton, keyboard=False, joy_button=2)
    graph.add(partial(OperatorConsole, terminal[1]), operator='ada', joy_enable=1)
    heard = []

    def logged(words):
        heard.append(''.join(capfd.readouterr()))
        return words in ''.join(heard)

    graph.wait_for(lambda: logged('any key presses, r releases: joystick lost: pressed'))
    graph.wait_for(lambda: logged('[operator_console]: joystick lost: not enabled'))
    os.close(terminal[0])
    graph.wait_for(lambda: logged('[operator_console]: terminal lost: pressed'))


def test_a_button_that_no_driver_hears_says_so(graph, terminal, capfd):
    graph.add(partial(StopButton, terminal[1]))
    assert 'released; no driver listens' in ''.join(capfd.readouterr())
