# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a node: one operator arms in two steps, and what is theirs ends with them."""

import os
import time
from functools import partial

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import DriverStatus
from rpms_ros.nodes.common.operator import OperatorClient
from rpms_ros.nodes.driver.reports import DriverAudit
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.records.append_only import verify_log

CODES = RunSchedule.Result
# a client in a process of its own: arms, starts a train, and waits to be killed
CLIENT = """
import sys
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rpms_ros.nodes.common.runner import use_fast_discovery
from rpms_ros.nodes.common.operator import OperatorClient
from rpms_ros.stimulation import constant
use_fast_discovery()
rclpy.init()
node, executor = Node('client'), EventsExecutor()
executor.add_node(node)
ada = OperatorClient(node, sys.argv[1])
def until(done):
    while not done():
        executor.spin_once(timeout_sec=0.05)
def ask(call):
    future = call()
    until(future.done)
    return future.result()
until(lambda: ada.ready)
ada.enable = True
until(lambda: ask(ada.request).success)
until(lambda: ada.token)
until(lambda: ask(ada.confirm).success)
handle = ask(lambda: ada.start(constant(0.5, 60.0, 50.0)))
until(lambda: False)
"""


@pytest.fixture
def clinic(driver_bench):
    """Make a driver that asks for operator and button, has both, and is configured."""
    both = {'button': True, 'operator': 'ada', 'require_stop_button': True}
    return partial(driver_bench, configured=True, **both)


def unlinked(path, monkeypatch):
    del monkeypatch
    path.unlink()


def full(path, monkeypatch):
    del path
    left = os.statvfs_result((4096, 4096, 1000, 0, 0, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, 'fstatvfs', lambda _file: left)


def test_two_steps_arm_and_a_goal_of_the_operator_runs(clinic):
    lab = clinic()
    assert not lab.arms()
    lab.wait_for_reason('expected an operator to request and to')
    lab.run()
    assert lab.statuses[-1].operator_id == 'ada'
    assert lab.driver.authority.confirmed


def test_nothing_is_armed_without_the_enable(clinic):
    lab = clinic()
    lab.refused_arming('to hold the enable', enable=False)
    assert lab.controller.state.name == 'DISARMED'


def test_a_confirmation_that_did_not_arm_lets_nobody_arm_instead(clinic):
    lab = clinic()
    lab.controller.stop('test', 'a test')
    lab.refused_arming('latched stop')
    lab.controller.reset()
    assert not lab.arms()
    assert lab.controller.state.name == 'DISARMED'
    # the token can be confirmed again in its time
    assert lab.ask(lab.ada.confirm()).success


def test_a_goal_of_anybody_else_is_refused_before_its_schedule_is_looked_at(clinic):
    lab = clinic()
    lab.arm()
    eve = OperatorClient(lab.other, 'eve')
    for token in ('', 'x', lab.ada.token):
        eve.token = token
        refused = lab.result(lab.ask(eve.start(constant(0.5, 60.0, 90.0)))).result
        assert refused.error_code == CODES.NO_AUTHORITY
        assert refused.reason.startswith('expected operator and token: that of ada')
    assert lab.pulses == []


def test_letting_go_of_the_enable_disarms_and_ends_the_token(clinic):
    lab = clinic()
    lab.run()
    token = lab.ada.token
    lab.ada.enable = False
    reason = lab.wait_for_state(DriverStatus.DISARMED)
    assert reason == 'expected ada to hold the enable, got it released'
    assert not lab.controller.device.armed
    lab.graph.wait_for(lambda: lab.statuses[-1].operator_id == '')
    lab.ada.token = token
    lab.ada.enable = True
    assert not lab.ask(lab.ada.confirm()).success
    lab.arm()


def test_silence_of_the_operator_stops(clinic):
    lab = clinic(heartbeat_timeout=3.0)
    handle = lab.run()
    lab.ada.timer.cancel()
    assert lab.stopped().startswith('expected a heartbeat of ada within 3 s, got none for')
    result = lab.result(handle).result
    assert result.error_code == CODES.INTERLOCK
    assert result.reason.startswith('expected a heartbeat of ada within 3 s, got none for')


def test_a_second_process_with_the_token_stops(clinic):
    lab = clinic()
    lab.run()
    eve = OperatorClient(lab.other, 'ada')
    eve.token, eve.enable = lab.ada.token, True
    assert lab.stopped().startswith('expected one process with this token, got heartbeats of two')


def reason_of_the_stop_at_a_kill(lab, python, name):
    """Have a process of this operator arm and start a train; kill it."""
    client = python('-c', CLIENT, name)
    lab.graph.wait_for(lambda: len(lab.pulses) > 5, timeout=120.0)
    lab.graph.wait_for(lambda: lab.statuses[-1].operator_id == name)
    client.kill()
    return lab.wait_for_state(DriverStatus.STOPPED)


def test_the_end_of_the_operators_process_stops_before_its_heartbeat_is_missed(clinic, python):
    # only the end of the process itself can stop it in this time
    lab = clinic(heartbeat_timeout=10.0)
    reason = reason_of_the_stop_at_a_kill(lab, python, 'ada')
    assert reason == 'expected the process of ada to run, got its end'


def test_the_process_of_the_operator_who_has_armed_is_watched(clinic, python):
    lab = clinic(heartbeat_timeout=10.0)
    lab.driver.authority.valid_s = 1.0
    # ada asks for a token, is heard, and does not go on; her process stays
    lab.request()
    lab.graph.wait_for(lambda: lab.driver.authority.enabled)
    lab.driver.authority.valid_s = 60.0
    reason = reason_of_the_stop_at_a_kill(lab, python, 'bob')
    # ada's console goes on with its old token, which is refused
    assert reason.startswith('expected the process of bob to run, got its end')


def test_a_second_driver_of_this_name_stops_both(clinic, graph):
    lab = clinic()
    lab.run()
    second = graph.add(StimulatorDriver, require_operator=False, require_stop_button=False)
    assert lab.stopped().startswith('expected one driver /stimulator_driver, got 2')
    second.controller.configure()
    graph.wait_for(lambda: second.controller.interlocks.problem(time.monotonic_ns()) is not None)


def test_a_second_driver_of_one_action_stops(clinic, graph):
    lab = clinic()
    lab.run()
    other = partial(StimulatorDriver, cli_args=['--ros-args', '-r', '__node:=left_driver'])
    graph.add(other, require_operator=False, require_stop_button=False)
    assert lab.stopped() == 'expected one driver that serves /run_schedule, got 2'


def test_a_second_driver_stops_that_was_to_serve_another_action(clinic, graph):
    """ROS applies no remapping to an action: the other is served under the same name."""
    rules = ['-r', '__node:=left_driver', '-r', 'run_schedule:=left_run']
    left = partial(StimulatorDriver, cli_args=['--ros-args', *rules])
    driver = graph.add(left, require_operator=False, require_stop_button=False)
    driver.controller.configure()
    clinic()
    interlocks = driver.controller.interlocks
    problem = 'expected one driver that serves /run_schedule, got 2'
    graph.wait_for(lambda: problem in (interlocks.problem(time.monotonic_ns()) or ()))


def test_the_bound_on_the_intensity_is_lowered_and_never_raised_while_armed(clinic):
    lab = clinic(maximum_intensity=0.8)
    client = lab.other.create_client(SetParameters, 'stimulator_driver/set_parameters')
    lab.graph.wait_for(client.service_is_ready)

    def bound(share):
        value = Parameter('maximum_intensity', value=share).to_parameter_msg()
        request = SetParameters.Request(parameters=[value])
        answer = lab.ask(client.call_async(request)).results[0]
        return answer.successful or answer.reason

    assert bound(0.6) is True
    assert bound(0.7) is True
    handle = lab.run()
    assert bound(0.75) == 'maximum_intensity: expected a share in [0, 0.7], got 0.75'
    assert lab.controller.limits.maximum_intensity == 0.7
    assert lab.driver.get_parameter('maximum_intensity').value == 0.7
    # the train is at 0.5
    assert bound(0.4) is True
    result = lab.result(handle).result
    assert result.error_code == CODES.OVER_LIMIT
    assert 'maximum_intensity' in result.reason
    lab.graph.wait_for(lambda: lab.statuses[-1].maximum_intensity == 0.4)


@pytest.mark.parametrize('service', [SetParameters, SetParametersAtomically])
def test_a_parameter_of_no_type_does_not_end_the_driver(clinic, service):
    lab = clinic()
    name = f'stimulator_driver/set_parameters{"_atomically" * (service is not SetParameters)}'
    client = lab.other.create_client(service, name)
    lab.graph.wait_for(client.service_is_ready)
    lab.run()
    value = ParameterMessage(name='maximum_intensity', value=ParameterValue(type=77))
    lab.ask(client.call_async(service.Request(parameters=[value])))
    assert lab.controller.state.name == 'RUNNING'


def test_a_change_of_the_bound_that_is_refused_with_another_one_changes_nothing(clinic):
    lab = clinic(maximum_intensity=0.9)

    def bound(share, **others):
        values = {'maximum_intensity': share, **others}
        asked = [Parameter(name, value=value) for name, value in values.items()]
        return lab.driver.set_parameters_atomically(asked).successful

    def both(*shares):
        return [Parameter('maximum_intensity', value=share) for share in shares]

    for first, last in ((0.3, 0.5), (0.7, 0.5)):
        assert lab.driver.set_parameters_atomically(both(first, last)).successful
        assert lab.controller.limits.maximum_intensity == last
        assert lab.driver.get_parameter('maximum_intensity').value == last
    assert bound(0.3)
    for share in (0.9, 0.1):
        assert not bound(share, use_sim_time=True)
        assert lab.controller.limits.maximum_intensity == 0.3
        assert lab.driver.get_parameter('maximum_intensity').value == 0.3


def test_who_did_what_is_written_down(clinic, tmp_path):
    path = tmp_path / 'audit.jsonl'
    lab = clinic(audit_log=str(path))
    lab.refusal()
    lab.run()
    lab.button.set(True)
    lab.wait_for_state(DriverStatus.STOPPED)
    lab.graph.wait_for(lambda: not lab.driver._active)
    lab.driver._audit.close()
    audit = verify_log(path)
    assert not audit.fault
    kinds = [record.content['kind'] for record in audit.records]
    # how often it was refused before the button was heard differs
    once = [kind for kind in kinds if kind in ('session', 'configure', 'schedule', 'stop')]
    assert once == ['session', 'configure', 'schedule', 'stop']
    assert 'refusal' in kinds
    arm = audit.records[kinds.index('schedule') - 1].content
    assert arm['kind'] == 'arm'
    assert arm['operator'] == 'ada'
    assert 'maximum_intensity' in arm['limits']


def test_what_was_noted_is_written_before_what_followed_it(tmp_path):
    path = tmp_path / 'audit.jsonl'
    audit = DriverAudit(str(path), pytest.fail)
    expected = ['begin']
    for _ in range(20):
        for _ in range(10):
            audit.note('refusal')
        audit.require('arm')
        expected += 10 * ['refusal'] + ['arm']
    audit.note('end')
    audit.close()
    verified = verify_log(path)
    assert not verified.fault
    assert [record.content['kind'] for record in verified.records] == [*expected, 'end']


@pytest.mark.parametrize(
    ('change', 'reason'), [(unlinked, 'No such file'), (full, 'a disk with less than 1000000 b')]
)
def test_a_train_ends_without_an_audit_log_that_can_be_written(
    clinic, tmp_path, monkeypatch, change, reason
):
    path = tmp_path / 'audit.jsonl'
    lab = clinic(audit_log=str(path))
    lab.run()
    change(path, monkeypatch)
    assert reason in lab.wait_for_state(DriverStatus.STOPPED)


def test_without_its_audit_log_nothing_is_armed(clinic, tmp_path):
    lab = clinic(audit_log=str(tmp_path / 'audit.jsonl'))
    lab.driver._audit._log.close()
    lab.refused_arming('audit')
    assert lab.controller.state.name == 'DISARMED'


def test_simulated_time_is_refused_while_running(clinic):
    lab = clinic()
    (answer,) = lab.driver.set_parameters([Parameter('use_sim_time', value=True)])
    assert not answer.successful
    assert answer.reason.startswith('expected use_sim_time false')
    assert not lab.driver.get_parameter('use_sim_time').value


def test_an_operator_who_is_released_while_the_enable_is_let_go_stops_nothing(driver_bench, graph):
    bench = driver_bench(operator='ada')
    bench.activate()
    authority, controller = bench.driver.authority, bench.controller
    released = authority.released_enable

    def released_enable(now_ns):
        if not bench.ada.enable:
            # as the executor does, while the thread that watches is at work
            controller.disarm()
            authority.release()
        return released(now_ns)

    authority.released_enable = released_enable
    bench.ada.enable = False
    bench.ada.beat()
    graph.wait_for(lambda: not controller.device.armed)
    bench.wait_for_state(DriverStatus.DISARMED)
    # a heartbeat that was on its way counts as refused: its token is no longer accepted
    assert set(controller.fault_counts()) <= {'heartbeat_refused'}
