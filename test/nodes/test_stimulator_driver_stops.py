# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a node: interlocks, heartbeat, emergency stop, faults of the device."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import DriverStatus, Pulse
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.common.operator import ButtonPublisher
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.schedule_messages import schedule_message
from rpms_ros.stimulation import constant, paper_random
from rpms_ros.stimulation.devices import SimulatedFaults

LONG = constant(0.5, 60.0, 50.0)


class Bench:
    """A driver, somebody who watches it, and the means to stop it."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        # a machine under load may stall for longer than the default allows
        patient = {
            'require_operator': False,
            'require_stop_button': False,
            'executor_timeout': 5.0,
            'watch_timeout': 5.0,
            'stop_button_timeout': 5.0,
            'force_timeout': 5.0,
            'lateness_limit': 0.1,
        }
        self.driver = graph.add(StimulatorDriver, **{**patient, **parameters})
        self.controller = self.driver.controller
        self.other = graph.add(lambda **options: Node('other', **options))
        self.pulses, self.statuses, self.diagnostics = [], [], []
        listen, talk = self.other.create_subscription, self.other.create_publisher
        listen(Pulse, topics.PULSES, self.pulses.append, qos.PULSES)
        listen(DriverStatus, topics.DRIVER_STATUS, self.statuses.append, qos.STATUS)
        listen(DiagnosticArray, topics.DIAGNOSTICS, self.diagnostics.append, qos.STOP)
        self.button = ButtonPublisher(self.other)
        self.sensor = talk(WrenchStamped, topics.FORCE, qos.FORCE)
        self.client = ActionClient(self.other, RunSchedule, topics.RUN_SCHEDULE)
        ask = self.other.create_client
        self.changes = ask(ChangeState, 'stimulator_driver/change_state')
        self.stop = ask(Trigger, topics.EMERGENCY_STOP)
        self.reset = ask(Trigger, topics.RESET_EMERGENCY_STOP)
        for ready in (self.changes, self.stop, self.reset):
            graph.wait_for(ready.service_is_ready)
        graph.wait_for(self.client.server_is_ready)
        graph.wait_for(lambda: self.button.listeners == 2 and bool(self.statuses))

    def call(self, client, request=None):
        future = client.call_async(request or Trigger.Request())
        self.graph.wait_for(future.done)
        return future.result()

    def change(self, transition):
        return self.call(
            self.changes, ChangeState.Request(transition=Transition(id=transition))
        ).success

    def arm(self):
        assert self.change(Transition.TRANSITION_CONFIGURE)
        # a driver of another test may still be on the graph, the button not heard yet
        self.graph.wait_for(lambda: self.change(Transition.TRANSITION_ACTIVATE))

    def run(self, schedule=LONG):
        self.arm()
        self.send(schedule)
        self.graph.wait_for(lambda: bool(self.pulses))

    def send(self, schedule=LONG):
        future = self.client.send_goal_async(
            RunSchedule.Goal(typed_schedule=schedule_message(schedule, MESSAGE_TYPES))
        )
        self.graph.wait_for(future.done)
        return future.result()

    def refusal(self, schedule=LONG):
        future = self.send(schedule).get_result_async()
        self.graph.wait_for(future.done)
        return future.result().result.error_code, future.result().result.reason

    def wait_for_state(self, state):
        self.graph.wait_for(lambda: self.statuses[-1].state == state)

    def wait_for_reason(self, reason):
        self.graph.wait_for(lambda: reason in self.statuses[-1].reason)


def test_button_stops_and_latches_until_reset_with_the_cause_gone(graph):
    bench = Bench(graph)
    bench.run()
    bench.button.set(True)
    bench.wait_for_state(DriverStatus.STOPPED)
    assert bench.controller.due_ns() is None
    assert not bench.controller.device.armed
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_reason('expected the latched stop to be reset, got: emergency stop')
    answer = bench.call(bench.reset)
    assert not answer.success
    assert answer.message == (
        'reset: expected the cause emergency_stop gone, got emergency stop is pressed (/other)'
    )
    bench.button.set(False)
    bench.graph.wait_for(lambda: bench.call(bench.reset).success)
    bench.wait_for_state(DriverStatus.DISARMED)
    assert bench.change(Transition.TRANSITION_ACTIVATE)


def test_service_stops_in_every_state(graph):
    bench = Bench(graph)
    assert bench.call(bench.stop).success
    bench.wait_for_state(DriverStatus.STOPPED)
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    assert bench.call(bench.reset).success
    assert bench.change(Transition.TRANSITION_ACTIVATE)
    bench.wait_for_state(DriverStatus.ARMED)
    assert bench.call(bench.stop).success
    bench.wait_for_state(DriverStatus.STOPPED)
    # the life cycle follows: not active any more
    assert bench.call(bench.reset).success
    assert bench.change(Transition.TRANSITION_ACTIVATE)


FROZEN_NS, DAY_NS = 1, 86400 * 10**9


def wrench(force, frame='force_sensor', stamp_ns=None):
    message = WrenchStamped()
    message.header.frame_id = frame
    stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.wrench.force.x = 0.6 * force
    message.wrench.force.z = 0.8 * force
    return message


@pytest.mark.parametrize(
    ('force', 'quantity', 'unit'),
    [(200.0, 'force', 'N'), (float('nan'), 'force', 'N'), (200.0, 'torque', 'N m')],
)
def test_force_over_the_limit_stops(graph, force, quantity, unit):
    bench = Bench(graph, force_limit=100.0, quantity=quantity)
    graph.wait_for(lambda: bench.sensor.get_subscription_count() == 1)
    felt = [10.0]

    def feel():
        message = wrench(felt[0])
        if quantity == 'torque':
            message.wrench.torque, message.wrench.force = message.wrench.force, Vector3()
        bench.sensor.publish(message)

    bench.other.create_timer(0.02, feel)
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    graph.wait_for(lambda: bench.change(Transition.TRANSITION_ACTIVATE))
    bench.send()
    graph.wait_for(lambda: bool(bench.pulses))
    felt[0] = force
    bench.wait_for_state(DriverStatus.STOPPED)
    assert f'force_limit: expected at most 100 {unit}, got' in bench.statuses[-1].reason
    assert not bench.call(bench.reset).success
    felt[0] = 10.0
    graph.wait_for(lambda: bench.call(bench.reset).success)


def test_force_sensor_that_falls_silent_stops(graph):
    bench = Bench(graph, force_limit=100.0, force_timeout=2.0)
    graph.wait_for(lambda: bench.sensor.get_subscription_count() == 1)
    timer = bench.other.create_timer(0.02, lambda: bench.sensor.publish(wrench(10.0)))
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    graph.wait_for(lambda: bench.change(Transition.TRANSITION_ACTIVATE))
    timer.cancel()
    bench.wait_for_state(DriverStatus.STOPPED)
    assert 'force: expected a sign of life within' in bench.statuses[-1].reason


@pytest.mark.parametrize(
    'dead',
    [
        lambda: {'stamp_ns': FROZEN_NS},
        lambda: {'frame': 'ankle'},
        lambda: {'stamp_ns': time.time_ns() - DAY_NS},
    ],
    ids=['same stamp', 'foreign frame', 'a recording of yesterday'],
)
def test_force_that_is_frozen_foreign_or_of_yesterday_is_no_sign_of_life(graph, dead):
    bench = Bench(graph, force_limit=100.0, force_timeout=3.0)
    # a sensor that repeats nothing is heard as well
    sensor = bench.other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE_BEST_EFFORT)
    graph.wait_for(lambda: sensor.get_subscription_count() == 1)
    how = [dict]
    bench.other.create_timer(0.02, lambda: sensor.publish(wrench(10.0, **how[0]())))
    bench.arm()
    how[0] = dead
    bench.wait_for_state(DriverStatus.STOPPED)
    assert 'force: expected a sign of life within 3 s' in bench.statuses[-1].reason
    assert bench.controller.fault_counts()['force_refused'] > 0


def test_shutdown_of_the_life_cycle_disarms_and_closes_the_device(graph):
    bench = Bench(graph)
    bench.run()
    device = bench.controller.device
    assert device.armed
    assert bench.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert bench.controller.state.name == 'UNCONFIGURED'
    assert (device.opened, device.armed, device.intensity) == (False, False, 0.0)


def test_an_error_in_the_steady_work_of_the_node_is_a_fault(graph, monkeypatch):
    bench = Bench(graph)
    bench.run()
    monkeypatch.setattr(bench.driver._action, 'progress', lambda *_: 1 / 0)
    graph.wait_for(lambda: bench.controller.state.name == 'FAULT')
    assert bench.controller.reason.startswith('expected to run on, got ZeroDivisionError')
    assert not bench.controller.device.armed


def test_an_error_while_a_goal_is_begun_is_a_fault(graph, monkeypatch):
    bench = Bench(graph)
    bench.arm()
    assert bench.controller.device.armed
    monkeypatch.setattr(bench.controller, 'start', lambda *_: 1 / 0)
    code, reason = bench.refusal()
    assert code == RunSchedule.Result.INTERNAL_ERROR
    assert reason.startswith('expected a goal without an error, got ZeroDivisionError')
    assert bench.controller.state.name == 'FAULT'
    assert not bench.controller.device.armed


def test_a_sample_over_the_limit_stops_also_if_it_is_no_sign_of_life(graph):
    # nothing else stops within this time
    bench = Bench(graph, force_limit=100.0, force_timeout=10.0)
    sensor = bench.other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE_BEST_EFFORT)
    graph.wait_for(lambda: sensor.get_subscription_count() == 1)
    felt = [wrench(10.0)]
    bench.other.create_timer(0.02, lambda: sensor.publish(felt[0]))
    bench.arm()
    felt[0] = wrench(150.0, frame='ankle')
    bench.wait_for_state(DriverStatus.STOPPED)
    assert 'force_limit: expected at most 100 N, got 150 N' in bench.statuses[-1].reason


@pytest.mark.parametrize(
    ('faults', 'reason'),
    [
        (SimulatedFaults(silent_loss=1.0), 'expected a pulse from the device, got none'),
        (SimulatedFaults(extra_intensity=0.1), 'expected intensity 0.5 from the device, got 0.6'),
        (SimulatedFaults(slow_s=0.8), 'expected the pulse within 0.5 s'),
        (SimulatedFaults(stuck_s=60.0), 'fire: expected an answer within 5 s'),
        (SimulatedFaults(vanish_after=1), 'expected an answer from the device, got none'),
    ],
)
def test_fault_of_the_device_ends_in_the_safe_state(graph, faults, reason):
    bench = Bench(graph)
    bench.run()
    bench.controller.device.faults = faults
    bench.wait_for_state(DriverStatus.FAULT)
    assert reason in bench.statuses[-1].reason
    assert not bench.controller.device.armed
    assert bench.refusal()[0] == RunSchedule.Result.WRONG_STATE
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    levels = (DiagnosticStatus.ERROR,)
    graph.wait_for(lambda: bench.diagnostics[-1].status[0].level in levels)
    bench.controller.device.faults = SimulatedFaults()
    assert bench.change(Transition.TRANSITION_CLEANUP)
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    # the button has to be heard again
    graph.wait_for(lambda: bench.change(Transition.TRANSITION_ACTIVATE))


def test_temperature_over_the_limit_stops(graph):
    bench = Bench(graph)
    bench.run()
    bench.controller.device.faults = SimulatedFaults(heating_per_pulse=1.0)
    bench.wait_for_state(DriverStatus.STOPPED)
    assert 'temperature: expected at most 40 Celsius' in bench.statuses[-1].reason
    assert not bench.call(bench.reset).success


def test_undeliverable_schedule_is_refused_with_an_offer(graph, patient_file):
    bench = Bench(graph, device_specification='rapid2-240v', patient_file=str(patient_file))
    bench.arm()
    code, reason = bench.refusal(paper_random(seed=0))
    assert code == RunSchedule.Result.OVER_LIMIT
    assert reason.startswith('maximum_intensity: expected an intensity in [0, 0.55]')
    bench.wait_for_reason('maximum_intensity: expected an intensity in [0, 0.55]')
    assert 'mean power' in bench.statuses[-1].reason
    assert 'at 20 Hz intensities up to 0.456 can be delivered' in bench.statuses[-1].reason
    assert bench.pulses == []


def test_deaf_driver_of_a_blocked_executor_does_not_fire(graph):
    # long enough for a loaded machine to start the schedule in
    bench = Bench(graph, executor_timeout=3.0)
    bench.run()
    # the executor is busy and keeps the interpreter busy with it
    end = time.monotonic() + 30.0
    while not bench.controller.interlocks.latched and time.monotonic() < end:
        sum(range(1000))
    assert bench.controller.interlocks.latched
    stopped = bench.controller.delivered
    bench.wait_for_state(DriverStatus.STOPPED)
    assert bench.controller.delivered == stopped


def test_diagnostics_are_ok_while_all_is_well(graph):
    bench = Bench(graph)
    bench.run()
    graph.wait_for(lambda: bool(bench.diagnostics))
    status = bench.diagnostics[-1].status[0]
    assert status.level == DiagnosticStatus.OK
    assert status.name == '/stimulator_driver: stimulator'
    assert {value.key for value in status.values} >= {
        'state',
        'device specification',
        'energy [J]',
    }
