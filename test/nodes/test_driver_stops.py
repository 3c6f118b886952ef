# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a node and as a process: stops, interlocks, faults, signals."""

import signal
import threading
import time
from functools import partial
from itertools import count

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from faulty_device import FaultyDevice, SimulatedFaults
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State, Transition
from std_srvs.srv import Trigger

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import DriverStatus, Pulse
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import ENDING, name_of
from rpms_ros.nodes.simulation_launcher import Monitor
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices import simulated
from rpms_ros.stimulation.records.append_only import verify_log

FROZEN_NS, DAY_NS = 1, 86400 * 10**9
ARGUMENTS = (
    'autostart:=true',
    'require_operator:=false',
    'require_stop_button:=false',
    'lateness_limit:=0.1',
)
# a machine under load may hold up the driver for seconds; what these limits do is tested elsewhere
START = """
import signal
import sys
# as nohup does: a driver whose terminal is gone ends all the same
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from dataclasses import replace
from rpms_ros.nodes import stimulator_driver
from rpms_ros.stimulation.devices import simulated
settings_of = stimulator_driver.driver_settings_of
stimulator_driver.driver_settings_of = lambda given: replace(
    settings_of(given), executor_timeout_s=5.0, response_limit_s=5.0, stuck_limit_s=5.0,
    supervisor_timeout_s=5.0,
)
stimulator_driver.patience_s = lambda *_: 5.0
simulated.KEEP_ALIVE_LIMIT_NS = 10**10
sys.exit(stimulator_driver.main())
"""


def wrench(force, frame='force_sensor', stamp_ns=None, quantity='force'):
    message = WrenchStamped()
    message.header.frame_id = frame
    stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    vector = getattr(message.wrench, quantity)
    vector.x, vector.z = 0.6 * force, 0.8 * force
    return message


def sensed(bench, make, profile=qos.FORCE_BEST_EFFORT):
    """Publish a force every 20 ms; the list that is returned holds what makes it."""
    sensor = bench.graph.publisher(WrenchStamped, topics.FORCE, profile)
    made = [make]
    bench.other.create_timer(0.02, lambda: sensor.publish(made[0]()))
    return made


def test_service_stops_in_every_state(driver_bench):
    bench = driver_bench(button=True)
    assert bench.call(bench.stop).success
    bench.wait_for_state(DriverStatus.STOPPED)
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    assert not bench.arms()
    assert bench.resets().success
    assert bench.arms()
    bench.wait_for_state(DriverStatus.ARMED)
    assert bench.call(bench.stop).success
    bench.wait_for_state(DriverStatus.STOPPED)
    # the life cycle follows: not active any more
    assert bench.resets().success
    assert bench.arms()


@pytest.mark.parametrize(
    ('force', 'quantity', 'unit'),
    [(200.0, 'force', 'N'), (float('nan'), 'force', 'N'), (200.0, 'torque', 'N m')],
)
def test_force_over_the_limit_stops(driver_bench, graph, force, quantity, unit):
    bench = driver_bench(button=True, force_limit=100.0, quantity=quantity)
    felt = partial(wrench, quantity=quantity)
    sensor = sensed(bench, lambda: felt(10.0), qos.FORCE)
    bench.run()
    sensor[0] = lambda: felt(force)
    assert f'force_limit: expected at most 100 {unit}, got' in bench.stopped()
    assert not bench.resets().success
    sensor[0] = lambda: felt(10.0)
    graph.wait_for(lambda: bench.resets().success)


@pytest.mark.parametrize(
    'dead',
    [
        lambda: wrench(10.0, stamp_ns=FROZEN_NS),
        lambda: wrench(10.0, frame='ankle'),
        lambda: wrench(10.0, stamp_ns=time.time_ns() - DAY_NS),
    ],
    ids=['same stamp', 'foreign frame', 'a recording of yesterday'],
)
def test_force_that_is_frozen_foreign_or_of_yesterday_is_no_sign_of_life(driver_bench, dead):
    bench = driver_bench(button=True, force_limit=100.0, force_timeout=3.0)
    # a sensor that repeats nothing is heard as well
    sensor = sensed(bench, lambda: wrench(10.0))
    bench.activate()
    sensor[0] = dead
    assert 'force: expected a sign of life within 3 s' in bench.stopped()
    assert bench.controller.fault_counts()['force_refused'] > 0


def test_a_sensor_whose_clock_is_off_is_told_of_once(driver_bench, tmp_path, monkeypatch):
    """Each sample is of another age: the log must not grow with every one."""
    # a machine under load may stand still for longer than what is repeated at once
    monkeypatch.setattr('rpms_ros.nodes.driver.reports._REPEATED_NS', 60 * 10**9)
    bench = driver_bench(force_limit=100.0, audit_log=str(tmp_path / 'audit.jsonl'))
    ages = count(10)
    sensed(bench, lambda: wrench(10.0, stamp_ns=time.time_ns() - next(ages) * 10**9))
    bench.graph.wait_for(lambda: bench.controller.fault_counts().get('force_refused', 0) > 20)
    assert 'expected a force sample within 5 s' in bench.driver._reports.refusal
    bench.graph.remove(bench.driver)
    records = verify_log(tmp_path / 'audit.jsonl').records
    told = [one.content['reason'] for one in records if one.content['kind'] == 'refusal']
    assert len(told) == 1


def test_a_sample_over_the_limit_stops_also_if_it_is_no_sign_of_life(driver_bench):
    # nothing else stops within this time
    bench = driver_bench(button=True, force_limit=100.0, force_timeout=10.0)
    sensor = sensed(bench, lambda: wrench(10.0))
    bench.activate()
    sensor[0] = lambda: wrench(150.0, frame='ankle')
    assert 'force_limit: expected at most 100 N, got 150 N' in bench.stopped()


def test_with_two_sensors_the_end_of_one_would_not_show(driver_bench, graph):
    bench = driver_bench(button=True, force_limit=100.0)
    sensed(bench, lambda: wrench(10.0))
    bench.run()
    # of a simulated muscle that was left running, say
    graph.publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    assert 'expected one publisher of /force, got /' in bench.stopped()
    assert not bench.resets().success


def test_a_clean_up_ends_a_train_though_the_life_cycle_has_none_while_active(driver_bench):
    bench = driver_bench(button=True)
    bench.run()
    assert not bench.change(Transition.TRANSITION_CLEANUP)
    assert bench.controller.run.ended == 'a clean-up was asked for'
    assert not bench.controller.device.armed


def test_shutdown_of_the_life_cycle_disarms_and_closes_the_device(driver_bench):
    bench = driver_bench(button=True)
    bench.run()
    device = bench.controller.device
    assert device.armed
    assert bench.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert bench.controller.state.name == 'UNCONFIGURED'
    assert (device.opened, device.armed, device.intensity) == (False, False, 0.0)


def test_shutdown_of_the_context_stops_the_pulses(driver_bench):
    lab = driver_bench()
    lab.run()
    lab.graph.context.try_shutdown()
    assert lab.driver.controller.run.ended
    assert not lab.driver.controller.device.armed


def test_an_error_in_the_steady_work_of_the_node_is_a_fault(driver_bench, graph, monkeypatch):
    bench = driver_bench(button=True)
    bench.run()
    monkeypatch.setattr(bench.driver._action, 'progress', lambda *_: 1 / 0)
    graph.wait_for(lambda: bench.controller.state.name == 'FAULT')
    assert bench.controller.reason.startswith('expected to run on, got ZeroDivisionError')
    assert not bench.controller.device.armed


def test_an_error_while_a_goal_is_begun_is_a_fault(driver_bench, monkeypatch):
    bench = driver_bench(button=True)
    bench.activate()
    assert bench.controller.device.armed
    monkeypatch.setattr(bench.controller, 'start', lambda *_: 1 / 0)
    code, reason = bench.refusal()
    assert code == RunSchedule.Result.INTERNAL_ERROR
    assert reason.startswith('expected a goal without an error, got ZeroDivisionError')
    assert bench.controller.state.name == 'FAULT'
    assert not bench.controller.device.armed


@pytest.fixture
def faulty(monkeypatch):
    """The simulated device is one that can have faults."""
    monkeypatch.setattr(simulated, 'build', lambda _: FaultyDevice())


@pytest.mark.parametrize(
    ('faults', 'reason'),
    [
        (SimulatedFaults(silent_loss=1.0), 'expected a pulse from the device, got none'),
        (SimulatedFaults(vanish_after=1), 'expected an answer from the device, got none'),
    ],
)
def test_fault_of_the_device_ends_in_the_safe_state(faulty, driver_bench, graph, faults, reason):
    del faulty
    bench = driver_bench(button=True)
    bench.run()
    bench.controller.device.faults = faults
    bench.wait_for_state(DriverStatus.FAULT)
    assert reason in bench.statuses[-1].reason
    assert not bench.controller.device.armed
    assert bench.refusal()[0] == RunSchedule.Result.WRONG_STATE
    assert not bench.arms()
    graph.wait_for(lambda: bench.diagnostics[-1].status[0].level == DiagnosticStatus.ERROR)
    bench.controller.device.faults = SimulatedFaults()
    assert bench.change(Transition.TRANSITION_CLEANUP)
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    # the button has to be heard again
    graph.wait_for(lambda: bench.arms())


def test_temperature_over_the_limit_stops(faulty, driver_bench):
    del faulty
    bench = driver_bench(button=True)
    bench.run()
    bench.controller.device.faults = SimulatedFaults(heating_per_pulse=1.0)
    assert 'temperature: expected at most 40 Celsius' in bench.stopped()
    assert not bench.resets().success


def test_deaf_driver_of_a_blocked_executor_does_not_fire(driver_bench):
    # long enough for a loaded machine to start the schedule in
    bench = driver_bench(button=True)
    bench.run()
    # the executor is busy and keeps the interpreter busy with it
    end = time.monotonic() + 30.0
    while not bench.controller.interlocks.latched and time.monotonic() < end:
        sum(range(1000))
    assert bench.controller.interlocks.latched
    stopped = bench.controller.delivered
    bench.wait_for_state(DriverStatus.STOPPED)
    assert bench.controller.delivered == stopped


def test_a_stop_that_is_reset_in_the_same_moment_is_told_and_logged(driver_bench, graph, tmp_path):
    bench = driver_bench(audit_log=str(tmp_path / 'audit.jsonl'))
    bench.activate()
    bench.statuses.clear()
    bench.controller.stop('test', 'a test')
    assert bench.driver._on_reset(Trigger.Request(), Trigger.Response()).success
    graph.wait_for(lambda: any(one.state == DriverStatus.STOPPED for one in bench.statuses))
    graph.remove(bench.driver)
    kinds = [one.content['kind'] for one in verify_log(tmp_path / 'audit.jsonl').records]
    # on a busy machine it may have been refused before
    told = kinds[:3] + kinds[-4:]
    assert told == ['begin', 'session', 'configure', 'arm', 'stop', 'reset', 'end']


def test_a_pulse_on_its_way_when_the_driver_is_disarmed_is_vouched_for(
    driver_bench, graph, tmp_path
):
    bench = driver_bench(audit_log=str(tmp_path / 'audit.jsonl'))
    fire, begun, go_on = bench.controller.device.fire, threading.Event(), threading.Event()

    def fires(*what):
        given = fire(*what)
        begun.set()
        go_on.wait(10.0)
        return given

    bench.activate()
    bench.controller.device.fire = fires
    bench.send()
    graph.wait_for(begun.is_set)
    bench.driver.change('deactivate')
    go_on.set()
    graph.wait_for(lambda: bench.controller.delivered == 1)
    graph.remove(bench.driver)
    records = verify_log(tmp_path / 'audit.jsonl').records
    hashed = [one.content for one in records if 'pulses_sha256' in one.content]
    assert [one['pulses'] for one in hashed] == [1]


def test_error_in_a_transition_ends_in_the_safe_state(driver_bench, graph):
    lab = driver_bench()
    lab.driver.controller.configure = lambda: 1 / 0
    assert not lab.change(Transition.TRANSITION_CONFIGURE)
    graph.wait_for(lambda: 'expected a transition without an error, got Zero' in lab.reason)
    assert lab.driver._state_machine.current_state[0] == State.PRIMARY_STATE_UNCONFIGURED
    del lab.driver.controller.configure
    lab.activate()
    assert lab.driver.controller.device.armed

    def fails_once():
        del lab.driver.controller.disarm
        raise ZeroDivisionError

    lab.driver.controller.disarm = fails_once
    assert not lab.change(Transition.TRANSITION_DEACTIVATE)
    assert lab.driver._state_machine.current_state[0] == State.PRIMARY_STATE_UNCONFIGURED
    assert not lab.driver.controller.device.armed


@pytest.mark.long
@pytest.mark.parametrize(
    'number',
    [
        signal.SIGHUP,
        signal.SIGQUIT,
        signal.SIGUSR1,
        signal.SIGTERM,
        signal.SIGINT,
        signal.SIGTSTP,
        # of a watchdog of systemd, and one without a name
        signal.SIGABRT,
        signal.SIGRTMIN + 3,
    ],
)
def test_a_signal_disarms_and_ends_the_driver(graph, python, tmp_path, schedule_file, number):
    pulses = graph.heard(Pulse, topics.PULSES, qos.PULSES)
    statuses = graph.heard(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
    audit, train = tmp_path / 'audit.jsonl', schedule_file(constant(0.5, 90.0, 50.0))
    given = (*ARGUMENTS, f'audit_log:={audit}', f'schedule_file:={train}')
    process = python('-c', START, '--ros-args', *(word for one in given for word in ('-p', one)))
    graph.wait_for(lambda: len(pulses) > 5, timeout=120.0)
    process.send_signal(number)
    graph.wait_for(lambda: process.poll() is not None, timeout=120.0)
    assert process.returncode == 0
    stops = [record.content for record in verify_log(audit).records]
    assert stops[-1]['kind'] == 'end'
    reasons = [content['reason'] for content in stops if content['kind'] == 'signal']
    assert reasons == [f'signal {name_of(number)}']
    assert reasons == [content['reason'] for content in stops if content['kind'] == 'stop']
    # what the driver has said last may still be under way
    graph.wait_for(lambda: statuses[-1].state == DriverStatus.STOPPED)
    assert statuses[-1].reason == reasons[0]


def test_what_a_driver_says_when_it_is_ended_is_not_how_its_schedule_ended(graph):
    monitor = graph.add(Monitor)
    for state in (DriverStatus.RUNNING, DriverStatus.DISARMED, DriverStatus.STOPPED):
        monitor._on_status(DriverStatus(state=state, reason=str(state)))
    assert (monitor.status.state, monitor.broken_off) == (DriverStatus.DISARMED, '')


def test_every_signal_that_ends_a_process_and_can_be_caught_is():
    caught = {name_of(one) for one in ENDING}
    assert {'SIGINT', 'SIGTERM', 'SIGABRT', 'SIGSTKFLT', 'SIGPWR'} <= caught
    assert {'SIGRTMIN', 'SIGRTMIN+1', 'SIGRTMAX'} <= caught
    assert not {'SIGKILL', 'SIGSEGV', 'SIGCHLD', 'SIGTSTP'} & caught
