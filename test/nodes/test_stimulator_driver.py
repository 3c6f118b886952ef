# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a node: silent until told to run, a goal from begin to end, stops."""

import asyncio
import math
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import State, Transition
from rclpy.node import Node

import rpms_ros
from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import AcceptedSchedule, DriverStatus, Pulse, Schedule as ScheduleMessage
from rpms_ros.errors import RpmsError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.driver.reports import ask_for_realtime
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.schedule_messages import schedule_message
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.records.append_only import verify_log

SPECIFICATIONS = (
    Path(rpms_ros.__file__).parent / 'stimulation' / 'limits' / 'device_specifications'
)
SHORT = constant(0.5, 0.2, 50.0)
LONG = constant(0.5, 60.0, 50.0)


def test_silent_until_told_to_run(driver_bench):
    lab = driver_bench()
    assert lab.statuses[-1].state == DriverStatus.UNCONFIGURED
    code, reason = lab.refusal(SHORT)
    assert code == RunSchedule.Result.WRONG_STATE
    assert 'expected state ARMED, got UNCONFIGURED' in reason
    lab.graph.wait_for(lambda: 'expected state ARMED, got UNCONFIGURED' in lab.reason)
    lab.activate()
    lab.wait_for_state(DriverStatus.ARMED)
    assert lab.pulses == []


def test_goal_delivers_every_pulse_and_says_so(driver_bench, graph):
    lab = driver_bench()
    lab.activate()
    handle = lab.send(SHORT)
    assert handle.accepted
    answer = lab.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.completed
    assert answer.result.pulses_delivered == 10
    graph.wait_for(lambda: len(lab.pulses) == 10)
    assert [pulse.sequence for pulse in lab.pulses] == list(range(10))
    assert {pulse.intensity for pulse in lab.pulses} == {0.5}
    assert {pulse.width for pulse in lab.pulses} == {100e-6}
    graph.wait_for(lambda: len(lab.commanded) == 10)
    assert [pulse.sequence for pulse in lab.commanded] == list(range(10))
    lab.wait_for_state(DriverStatus.DISARMED)
    assert lab.statuses[-1].pulses_delivered == 10


def test_a_goal_may_expire_while_the_driver_is_taken_down(driver_bench):
    lab = driver_bench()
    lab.activate()
    assert lab.result(lab.send(SHORT)).result.completed
    server = lab.driver._action._server
    expired = [SimpleNamespace(goal_id=SimpleNamespace(uuid=key)) for key in server._goal_handles]
    assert len(expired) == 1
    # the executor had taken this out of its queue before the server was destroyed
    late = server._execute_expire_goals(expired)
    # the graph destroys it once more
    lab.driver._action.destroy()
    asyncio.run(late)
    assert not server._goal_handles


def test_second_goal_is_refused_and_cancel_stops_the_first(driver_bench, graph):
    lab = driver_bench()
    lab.activate()
    handle = lab.send(LONG)
    graph.wait_for(lambda: bool(lab.pulses) and bool(lab.feedback))
    assert lab.feedback[0].segments == 1
    assert lab.refusal(SHORT) == (
        RunSchedule.Result.WRONG_STATE,
        'expected no schedule running, got a second goal',
    )
    lab.ask(handle.cancel_goal_async())
    answer = lab.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.reason == 'cancelled by the client'
    assert answer.result.error_code == RunSchedule.Result.CANCELLED
    assert not answer.result.completed
    assert lab.driver.controller.run.ended
    assert not lab.driver.controller.device.armed
    lab.graph.wait_for(lambda: lab.change(Transition.TRANSITION_ACTIVATE))
    assert lab.result(lab.send(SHORT)).status == GoalStatus.STATUS_SUCCEEDED


def test_deactivation_ends_the_goal(driver_bench, graph):
    lab = driver_bench()
    lab.activate()
    handle = lab.send(LONG)
    graph.wait_for(lambda: bool(lab.pulses))
    assert lab.change(Transition.TRANSITION_DEACTIVATE)
    assert lab.result(handle).status == GoalStatus.STATUS_ABORTED
    lab.wait_for_state(DriverStatus.DISARMED)
    assert lab.change(Transition.TRANSITION_CLEANUP)
    lab.wait_for_state(DriverStatus.UNCONFIGURED)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        (None, 'segments: expected at least one segment, got none'),
        ({'rate_hz': 60.0}, 'maximum_rate_hz: expected at most 50 Hz'),
        ({'duration_s': math.nan}, 'segments[0].duration_s: expected a number'),
        ({'high': 0.1}, 'segments[0].high: expected nothing here'),
    ],
)
def test_bad_goals_are_refused_with_one_reason(driver_bench, graph, changes, reason):
    lab = driver_bench()
    lab.activate()
    schedule = ScheduleMessage()
    if changes is not None:
        schedule = schedule_message(SHORT, MESSAGE_TYPES)
        for name, value in changes.items():
            setattr(schedule.segments[0], name, value)
    code, said = lab.refusal(schedule)
    assert reason in said
    limit = reason.startswith('maximum_rate_hz')
    assert code == (RunSchedule.Result.OVER_LIMIT if limit else RunSchedule.Result.BAD_SCHEDULE)
    graph.wait_for(lambda: reason in lab.reason)
    assert lab.pulses == []


def test_impossible_transition_does_not_end_the_node(driver_bench, graph):
    lab = driver_bench()
    assert not lab.change(Transition.TRANSITION_ACTIVATE)
    assert not lab.change(99)
    graph.wait_for(lambda: 'expected a transition of configure' in lab.reason)
    lab.activate()


def test_shutdown_of_the_context_stops_the_pulses(driver_bench, graph):
    lab = driver_bench()
    lab.activate()
    lab.send(LONG)
    graph.wait_for(lambda: bool(lab.pulses))
    lab.graph.context.try_shutdown()
    assert lab.driver.controller.run.ended
    assert not lab.driver.controller.device.armed


def test_autostart_waits_for_its_listeners(graph, schedule_file):
    driver = graph.add(
        StimulatorDriver,
        require_operator=False,
        require_stop_button=False,
        lateness_limit=0.1,
        autostart=True,
        schedule_file=schedule_file(constant(0.5, 0.2, 50.0)),
    )
    graph.wait_for(lambda: driver.count_publishers(topics.PULSES) == 1)
    assert driver.controller.state.name == 'UNCONFIGURED'
    heard = []
    other = graph.add(lambda **options: Node('other', **options))
    other.create_subscription(Pulse, topics.PULSES, heard.append, qos.PULSES)
    graph.wait_for(lambda: len(heard) == 10)
    graph.wait_for(lambda: driver.controller.reason == 'completed')


def test_an_automatic_start_that_is_refused_is_announced_nowhere(
    driver_bench, graph, schedule_file, tmp_path
):
    log = tmp_path / 'audit'
    heard = []
    other = graph.add(lambda **options: Node('other', **options))
    other.create_subscription(
        AcceptedSchedule, topics.ACCEPTED_SCHEDULE, heard.append, qos.ACCEPTED_SCHEDULE
    )
    lab = driver_bench(
        autostart=True,
        schedule_file=schedule_file(constant(0.5, 0.2, 90.0)),
        audit_log=str(log),
    )
    graph.wait_for(lambda: 'maximum_rate_hz: expected' in lab.reason)
    lab.driver._audit.close()
    kinds = [record.content['kind'] for record in verify_log(log).records]
    assert 'refusal' in kinds
    assert 'schedule' not in kinds
    assert heard == []


def test_the_process_that_drives_loads_no_identification():
    code = 'import sys, rpms_ros.nodes.stimulator_driver; print(*sys.modules)'
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = set(said.stdout.split())
    assert 'rpms_ros.stimulation.driver.controller' in loaded
    for name in ('identification', 'live', 'muscle', 'recording'):
        assert f'rpms_ros.{name}' not in loaded
    assert not {'numba', 'scipy', 'matplotlib'} & loaded


def test_two_simulated_drivers_of_one_busy_process_go_on(graph, wait_for, schedule_file):
    usual = {
        'require_operator': False,
        'require_stop_button': False,
        'lateness_limit': 0.1,
        'autostart': True,
        'minimum_subscribers': 0,
        'schedule_file': schedule_file(constant(0.5, 60.0, 50.0)),
    }
    drivers = [
        graph.add(partial(StimulatorDriver, namespace=name), **usual) for name in ('left', 'right')
    ]
    graph.wait_for(lambda: all(driver.controller.delivered for driver in drivers))
    end = time.monotonic() + 0.6
    with drivers[0]._watch._lock, drivers[1]._watch._lock:
        # neither the executor nor the threads that hear buttons have their turn
        wait_for(lambda: time.monotonic() > end)
    given = max(driver.controller.delivered for driver in drivers)
    graph.wait_for(lambda: all(one.controller.delivered > given + 50 for one in drivers))
    assert not any(driver.controller.interlocks.latched for driver in drivers)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'autostart': True}, 'expected schedule_file with autostart, got none'),
        ({'device': 'oracle'}, 'device: expected one of'),
        (
            {'device': 'serial', 'require_operator': False},
            'expected require_operator with a real device, got false',
        ),
        (
            {'device': 'serial', 'require_stop_button': False},
            'expected require_stop_button with a real device, got false',
        ),
        ({'device': 'serial', 'autostart': True}, 'expected no autostart with a real device'),
        ({'device': 'serial'}, 'expected audit_log with a real device, got none'),
        ({'use_sim_time': True}, 'expected use_sim_time false: a driver stamps what it does'),
        (
            {'device': 'serial', 'audit_log': 'a'},
            'expected ledger_folder with a real device, got none',
        ),
        (
            {'device': 'serial', 'audit_log': 'a', 'ledger_folder': 'b', 'patient_file': 'c'},
            'expected ledger_folder with an absolute path, got b',
        ),
        (
            {'device': 'serial', 'audit_log': 'a', 'ledger_folder': '/b'},
            'expected patient_file with a real device, got none',
        ),
        (
            {
                'device': 'serial',
                'audit_log': 'a',
                'ledger_folder': '/b',
                'patient_file': '/nowhere.yaml',
            },
            'expected a readable patient file, got /nowhere.yaml',
        ),
        ({'audit_log': '/proc/nowhere/a'}, 'expected /proc/nowhere/a to write and lock'),
        (
            {'device_specification': 'rapid2-240v'},
            "expected a patient file for the real device 'rapid2-240v', got none",
        ),
        (
            {'device_specification': 'oracle'},
            "expected a device of rapid2-240v, simulated .* got 'oracle'",
        ),
        ({'maximum_intensity': 1.5}, 'maximum_intensity: expected 0.0 to 1.0, got 1.5'),
        ({'maximum_rate': 10}, 'maximum_rate: expected double, got integer 10'),
        (
            {'autostart': True, 'schedule_file': '/nowhere.yaml'},
            'expected a readable schedule file, got /nowhere.yaml',
        ),
    ],
)
def test_bad_parameters_are_refused(graph, parameters, reason):
    with pytest.raises(RpmsError, match=reason):
        graph.add(StimulatorDriver, **parameters)


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


def test_device_that_is_not_there_is_refused(
    driver_bench, graph, tmp_path, patient_file, specification_file
):
    port = str(tmp_path / 'ttyUSB9')
    lab = driver_bench(
        device='serial',
        port=port,
        device_specification=str(specification_file),
        require_operator=True,
        require_stop_button=True,
        audit_log=str(tmp_path / 'audit.jsonl'),
        ledger_folder=str(tmp_path / 'ledger'),
        patient_file=str(patient_file),
    )
    assert not lab.change(Transition.TRANSITION_CONFIGURE)
    graph.wait_for(lambda: 'expected a serial port, got' in lab.reason)
    assert lab.statuses[-1].state == DriverStatus.UNCONFIGURED


def test_realtime_priority_is_asked_for_every_thread_or_its_refusal_said(monkeypatch):
    asked = []
    monkeypatch.setattr('os.sched_setscheduler', lambda *call: asked.append(call))
    assert ask_for_realtime(20) == ''
    assert os.getpid() in {thread for thread, *_ in asked}
    assert {policy for _, policy, _ in asked} == {os.SCHED_FIFO}
    assert {parameters.sched_priority for *_, parameters in asked} == {20}

    def refuse(*call):
        raise PermissionError(f'not for {call[0]}')

    monkeypatch.setattr('os.sched_setscheduler', refuse)
    assert ask_for_realtime(20).startswith('expected the right to real-time priority 20, got')
