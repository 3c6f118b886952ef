# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drivers, a live page and a simulated muscle that is stimulated, on the graph of a test."""

import os
import socket
import subprocess
import sys
from functools import partial

import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import DriverStatus, Pulse
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.operator import ButtonPublisher, OperatorClient
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.schedule_messages import schedule_message
from rpms_ros.stimulation import Schedule, UniformRandom, constant, schedule_to_text

TOKEN = 'correct-horse-battery'


@pytest.fixture(autouse=True)
def patient(patient_supervision):
    """Every driver of these tests is one that a machine under load may hold up."""


@pytest.fixture
def page(graph):
    """A page with a stop, on a free port."""
    return graph.add(partial(LivePage, TOKEN), port=0)


@pytest.fixture
def schedule_file(tmp_path):
    """Write a schedule; return its path."""

    def write(schedule):
        path = tmp_path / 'schedule.yaml'
        path.write_text(schedule_to_text(schedule))
        return str(path)

    return write


@pytest.fixture
def driven(graph, schedule_file):
    """The driver of a simulated muscle that is stimulated for a minute and identified."""
    graph.add(Identifier, estimator='recursive')
    graph.add(PlantSimulator, minimum_subscribers=2, publication_delay=0.05, noise=0.02)
    return graph.add(
        StimulatorDriver,
        autostart=True,
        require_operator=False,
        require_stop_button=False,
        minimum_subscribers=3,
        schedule_file=schedule_file(Schedule((UniformRandom(20.0, 60.0, low=0.2),), seed=1)),
        # a machine under load may stall for longer than the default allows
        stop_button_timeout=10.0,
    )


@pytest.fixture
def unused_port():
    """A port that nobody listens on, of those that the system hands out to nobody by itself."""
    lowest = 10_000 + os.getpid() % 10_000
    for port in range(lowest, lowest + 1000):
        try:
            socket.create_server(('127.0.0.1', port)).close()
        except OSError:
            continue
        return port
    return pytest.fail('no port is free')


@pytest.fixture
def python(domain):
    """Start Python with arguments as a process in the domain of the test, killed at its end."""
    started = []

    def start(*arguments):
        process = subprocess.Popen(
            [sys.executable, *arguments],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


LONG = constant(0.5, 60.0, 50.0)


class DriverBench:
    """A driver, and a node that asks, listens and stops; `operator` is who arms, if anybody."""

    def __init__(self, graph, button=False, operator='', configured=False, **parameters):
        self.graph = graph
        # a machine under load may stall for longer than the default allows
        patient = {
            'require_operator': bool(operator),
            'require_stop_button': False,
            'stop_button_timeout': 5.0,
            'heartbeat_timeout': 5.0,
            'force_timeout': 5.0,
            'lateness_limit': 0.1,
        }
        self.driver = graph.add(StimulatorDriver, **{**patient, **parameters})
        self.controller = self.driver.controller
        self.other = graph.node('other')
        self.feedback = []
        self.pulses = graph.heard(Pulse, topics.PULSES, qos.PULSES)
        self.commanded = graph.heard(Pulse, topics.PULSES_COMMANDED, qos.PULSES)
        self.statuses = graph.heard(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
        self.diagnostics = graph.heard(DiagnosticArray, topics.DIAGNOSTICS)
        self.client = ActionClient(self.other, RunSchedule, topics.RUN_SCHEDULE)
        client = self.other.create_client
        self.changes = client(ChangeState, 'stimulator_driver/change_state')
        self.stop = client(Trigger, topics.EMERGENCY_STOP)
        self.reset = client(Trigger, topics.RESET_EMERGENCY_STOP)
        for one in (self.changes, self.stop, self.reset):
            graph.wait_for(one.service_is_ready)
        graph.wait_for(lambda: self.client.server_is_ready() and bool(self.statuses))
        self.button = ButtonPublisher(self.other) if button else None
        self.ada = OperatorClient(self.other, operator) if operator else None
        graph.wait_for(lambda: self.ada is None or self.ada.ready)
        if button:
            # one that is seen before it is heard stops
            self.knows('/other')
        if configured:
            assert self.change(Transition.TRANSITION_CONFIGURE)

    def ask(self, future):
        self.graph.wait_for(future.done)
        return future.result()

    def call(self, client, request=None):
        return self.ask(client.call_async(request or Trigger.Request()))

    def resets(self):
        return self.call(self.reset)

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(self.changes, request).success

    def arms(self):
        return self.change(Transition.TRANSITION_ACTIVATE)

    def arm(self):
        """Arm, by the operator if there is one."""
        if self.ada is None:
            # a driver of another test may still be on the graph, a button not heard yet
            self.graph.wait_for(self.arms)
            return
        self.request()
        self.graph.wait_for(lambda: self.ask(self.ada.confirm()).success)

    def request(self, enable=True):
        """Have the operator take the first step of arming, with or without the enable."""
        self.ada.enable = enable
        assert self.ask(self.ada.request()).success
        self.graph.wait_for(lambda: bool(self.ada.token))

    def refused_arming(self, reason, enable=True):
        """Have the operator try to arm until it is refused for this reason; return all of it.

        Heartbeat or button may not be heard yet.
        """
        self.request(enable)
        said = []

        def refused():
            said.append(self.ask(self.ada.confirm()).message)
            return reason in said[-1]

        self.graph.wait_for(refused)
        assert self.controller.state.name in ('DISARMED', 'STOPPED')
        return said[-1]

    def activate(self):
        """Configure if that was not done, and arm."""
        if self.controller.state.name == 'UNCONFIGURED':
            assert self.change(Transition.TRANSITION_CONFIGURE)
        self.arm()

    def send(self, schedule=LONG, **who):
        if isinstance(schedule, Schedule):
            schedule = schedule_message(schedule, MESSAGE_TYPES)
        goal = RunSchedule.Goal(typed_schedule=schedule, **who)
        take = self.feedback.append
        return self.ask(
            self.client.send_goal_async(goal, feedback_callback=lambda m: take(m.feedback))
        )

    def result(self, handle):
        return self.ask(handle.get_result_async())

    def refusal(self, schedule=LONG, **who):
        """Error code and reason of a goal that is not run."""
        answer = self.result(self.send(schedule, **who))
        assert answer.status == GoalStatus.STATUS_ABORTED
        assert not answer.result.completed
        return answer.result.error_code, answer.result.reason

    def run(self):
        """Arm, and wait for the first pulse of a long train; return its goal."""
        self.activate()
        self.pulses.clear()
        handle = self.send() if self.ada is None else self.ask(self.ada.start(LONG))
        self.graph.wait_for(lambda: bool(self.pulses))
        return handle

    def knows(self, *names):
        """Wait until the driver has heard these buttons say that they are released."""

        def heard():
            status = self.statuses[-1]
            released = all(state == DriverStatus.BUTTON_RELEASED for state in status.button_states)
            return released and sorted(status.button_names) == sorted(names)

        self.graph.wait_for(heard)

    @property
    def reason(self):
        return self.statuses[-1].reason

    def wait_for_reason(self, reason):
        self.graph.wait_for(lambda: reason in self.reason)

    def wait_for_state(self, state):
        self.graph.wait_for(lambda: self.statuses[-1].state == state)
        return self.reason

    def stopped(self):
        """Wait for a stop; return its reason."""
        reason = self.wait_for_state(DriverStatus.STOPPED)
        assert not self.controller.device.armed
        return reason


@pytest.fixture
def driver_bench(graph):
    """Make a driver with somebody who uses it; keywords are those of `DriverBench`."""
    return partial(DriverBench, graph)
