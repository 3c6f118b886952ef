# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a node: silent until told to run, a goal from begin to end, hostile goals."""

import asyncio
import hashlib
import math
import os
from dataclasses import replace
from random import Random
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import AcceptedSchedule, DriverStatus, Pulse, Schedule, ScheduleSegment
from rpms_ros import messages
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.recording.rosbag.scan import Scan
from rpms_ros.recording.rosbag.verifying import verify as verify_recording
from rpms_ros.schedule_messages import schedule_message
from rpms_ros.stimulation import constant, schedule_from_text
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, ChainedFile, verify_log

SHORT = constant(0.5, 0.2, 50.0)
WARM_UP = replace(SHORT, name='wärm-up')
# bench/hostile_goals.py asks for ten thousand
COUNT = int(os.environ.get('RPMS_HOSTILE_GOALS', '200'))
# a service holds ten requests
TOGETHER = 8
NUMBERS = (0.0, 0.0, 0.1, 0.5, 1.0, 1.5, 20.0, 60.0, -1.0, 1e-320, 1e300, math.inf, math.nan)
WHOLE = (0, 0, 1, 2, 3, 7, 1000, 2**31, 2**32 - 1)
NAMES = ('', 'x', 'x' * 3000, 'a\x07b', '../../etc', '\u202e', '${HOME}', '\n')
FIELDS = ScheduleSegment.get_fields_and_field_types()
CODES = RunSchedule.Result


@pytest.fixture
def running(driver_bench, tmp_path):
    """A driver with an audit log, and somebody who asks for schedules."""
    bench = driver_bench(audit_log=str(tmp_path / 'audit.jsonl'))
    bench.audit = tmp_path / 'audit.jsonl'
    bench.ends = lambda: bench.result(bench.send(WARM_UP, operator_id='ada')).result
    return bench


def audit_findings(path, audit):
    findings = verify_recording(path, audit=audit)
    return [(one.state, one.text) for one in findings if one.check == 'audit']


def hostile_segment(random):
    """Return a segment of which most fields are as a kind may have them."""
    segment = ScheduleSegment(kind=random.choice([*range(13), 255]), duration_s=1.0)
    for name in random.sample(sorted(FIELDS), random.randrange(6)):
        kind = FIELDS[name]
        if kind == 'double':
            setattr(segment, name, random.choice(NUMBERS))
        elif kind in ('uint32', 'uint64'):
            setattr(segment, name, random.choice(WHOLE))
        elif kind == 'boolean':
            segment.own_seed = True
        elif name == 'levels':
            segment.levels = [random.choice(NUMBERS)] * random.choice([1, 3, 20_000])
    return segment


def hostile_schedule(random):
    count = random.choice([0, 1, 1, 2, 3, 10, 10_001])
    segments = [hostile_segment(random) for _ in range(min(count, 10))]
    return Schedule(
        name=random.choice(NAMES),
        seed=random.choice([0, 1, 2**53 + 1, 2**64 - 1]),
        width_s=random.choice(NUMBERS),
        segments=segments if count <= 10 else segments * 1001,
    )


def test_silent_until_told_to_run(driver_bench):
    lab = driver_bench()
    assert lab.statuses[-1].state == DriverStatus.UNCONFIGURED
    code, reason = lab.refusal(SHORT)
    assert code == CODES.WRONG_STATE
    assert 'expected state ARMED, got UNCONFIGURED' in reason
    lab.graph.wait_for(lambda: 'expected state ARMED, got UNCONFIGURED' in lab.reason)
    lab.activate()
    lab.wait_for_state(DriverStatus.ARMED)
    assert lab.pulses == []


def test_a_goal_delivers_every_pulse_and_may_expire_while_the_driver_is_taken_down(
    driver_bench, graph
):
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
    server = lab.driver._action._server
    expired = [SimpleNamespace(goal_id=SimpleNamespace(uuid=key)) for key in server._goal_handles]
    assert len(expired) == 1
    # the executor had taken this out of its queue before the server was destroyed
    late = server._execute_expire_goals(expired)
    # the graph destroys it once more
    lab.driver._action.destroy()
    asyncio.run(late)
    assert not server._goal_handles


def test_a_second_goal_is_refused_and_cancel_and_deactivation_end_the_first(driver_bench):
    lab = driver_bench()
    handle = lab.run()
    lab.graph.wait_for(lambda: bool(lab.feedback))
    assert lab.feedback[0].segments == 1
    assert lab.refusal(SHORT) == (
        CODES.WRONG_STATE,
        'expected no schedule running, got a second goal',
    )
    lab.ask(handle.cancel_goal_async())
    answer = lab.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.reason == 'cancelled by the client'
    assert answer.result.error_code == CODES.CANCELLED
    assert not answer.result.completed
    assert lab.controller.run.ended
    assert not lab.controller.device.armed
    handle = lab.run()
    assert lab.change(Transition.TRANSITION_DEACTIVATE)
    assert lab.result(handle).status == GoalStatus.STATUS_ABORTED
    lab.wait_for_state(DriverStatus.DISARMED)
    assert lab.change(Transition.TRANSITION_CLEANUP)
    lab.wait_for_state(DriverStatus.UNCONFIGURED)


def test_bad_goals_are_refused_with_one_reason(driver_bench):
    lab = driver_bench()
    lab.activate()
    for name, value, expected, reason in (
        ('rate_hz', 60.0, CODES.OVER_LIMIT, 'maximum_rate_hz: expected at most 50 Hz'),
        ('duration_s', math.nan, CODES.BAD_SCHEDULE, 'segments[0].duration_s: expected a number'),
        ('high', 0.1, CODES.BAD_SCHEDULE, 'segments[0].high: expected nothing here'),
        ('', 0.0, CODES.BAD_SCHEDULE, 'segments: expected at least one segment, got none'),
    ):
        schedule = schedule_message(SHORT, MESSAGE_TYPES) if name else Schedule()
        for segment in schedule.segments:
            setattr(segment, name, value)
        code, said = lab.refusal(schedule)
        assert (code, reason in said) == (expected, True)
        lab.wait_for_reason(reason)
    assert lab.pulses == []


def test_autostart_waits_for_its_listeners(driver_bench, graph, schedule_file):
    lab = driver_bench(autostart=True, minimum_subscribers=2, schedule_file=schedule_file(SHORT))
    graph.wait_for(lambda: lab.driver.count_subscribers(topics.PULSES) == 1)
    assert lab.controller.state.name == 'UNCONFIGURED'
    heard = graph.heard(Pulse, topics.PULSES, qos.PULSES)
    graph.wait_for(lambda: len(heard) == 10)
    graph.wait_for(lambda: lab.controller.reason == 'completed')


def test_an_automatic_start_that_is_refused_is_announced_nowhere(
    driver_bench, graph, schedule_file, tmp_path
):
    log = tmp_path / 'audit'
    heard = graph.heard(AcceptedSchedule, topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE)
    lab = driver_bench(
        autostart=True, schedule_file=schedule_file(constant(0.5, 0.2, 90.0)), audit_log=str(log)
    )
    graph.wait_for(lambda: 'maximum_rate_hz: expected' in lab.reason)
    lab.driver._audit.close()
    kinds = [record.content['kind'] for record in verify_log(log).records]
    assert 'refusal' in kinds
    assert 'schedule' not in kinds
    assert heard == []


def test_a_schedule_is_told_before_its_first_pulse_and_recorded(graph, running, tmp_path):
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    driver = running.driver
    early = graph.heard(AcceptedSchedule, topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE)
    graph.wait_for(lambda: driver.count_subscribers(topics.ACCEPTED_SCHEDULE) == 2)
    graph.wait_for(lambda: driver.count_subscribers(topics.PULSES) == 2)
    running.activate()
    assert running.ends().completed
    graph.wait_for(lambda: recorder.counts[topics.PULSES] == 10)
    graph.wait_for(lambda: recorder.counts[topics.ACCEPTED_SCHEDULE] == 1)
    late = graph.heard(AcceptedSchedule, topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE)
    graph.wait_for(lambda: len(late) == 1)
    (told,) = early
    assert late == early
    assert (told.name, told.operator_id, told.pulses) == ('wärm-up', 'ada', 10)
    assert told.duration == pytest.approx(0.2)  # one rounding of the sum of the segments
    assert schedule_from_text(told.schedule) == WARM_UP
    assert told.sha256 == hashlib.sha256(told.schedule.encode()).hexdigest()
    recorder.close()
    placed = sorted(
        (place, channel.topic)
        for channel, records in Scan(tmp_path / 'session').blocks()
        for place in records.place.tolist()
    )
    order = [topic for _, topic in placed]
    assert order.index('/accepted_schedule') < order.index('/pulses')
    assert order.index('/accepted_schedule') < order.index('/pulses_commanded')
    (entry,) = [
        record.content
        for record in verify_log(running.audit).records
        if record.content['kind'] == 'schedule'
    ]
    assert entry['text_sha256'] == told.sha256


def test_the_audit_log_vouches_for_the_pulses_of_a_recording(graph, running, tmp_path):
    path = tmp_path / 'session'
    recorder = graph.add(Recorder, path=str(path))
    graph.wait_for(lambda: running.driver.count_subscribers(topics.PULSES) == 2)
    force = graph.publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    for index in range(3):
        force.publish(messages.force_message(index, 1.0, messages.AXES['z'], MESSAGE_TYPES))
    for _ in range(2):
        running.activate()
        assert running.ends().completed
        graph.wait_for(lambda: not running.driver._active)
    graph.wait_for(lambda: recorder.counts[topics.PULSES] == 20)
    graph.wait_for(lambda: recorder.counts[topics.FORCE] == 3)
    recorder.close()
    running.driver._audit.close()
    assert audit_findings(path, running.audit) == [('ok', '20 pulses as the driver gave them')]
    recording = read_recording(path)
    pulses = recording.pulses
    halved = replace(pulses, intensity=0.5 * pulses.intensity)
    write_recording(tmp_path / 'halved', halved, recording.forces)
    found = audit_findings(tmp_path / 'halved', running.audit)
    assert [state for state, _ in found] == ['FAULT', 'FAULT']
    assert found[0][1].endswith('not what the driver gave')
    later = replace(pulses[:1], onset_ns=pulses.onset_ns[-1:] + 10**9)
    write_recording(tmp_path / 'more', PulseTrain.joined([pulses, later]), recording.forces)
    assert audit_findings(tmp_path / 'more', running.audit) == [
        ('FAULT', 'the log has 20 of 21 pulses')
    ]
    text = running.audit.read_text()
    running.audit.write_text(text.replace('ada', 'bob'))
    assert any('chain of the log' in said for _, said in audit_findings(path, running.audit))
    running.audit.write_text(text[:-9])
    assert any('the log is cut off' in said for _, said in audit_findings(path, running.audit))
    ChainedFile(tmp_path / 'other.jsonl', AUDIT_LOG).close()
    found = audit_findings(path, tmp_path / 'other.jsonl')
    assert [state for state, _ in found] == ['FAULT'] * len(found)
    assert found[0][1].startswith('the log has no schedule ')
    assert found[-1][1] == 'the log has 0 of 20 pulses'


@pytest.mark.long
def test_every_hostile_goal_is_answered_with_a_reason(driver_bench, graph):
    lab, random = driver_bench(), Random(3)
    answered = 0
    for begin in range(0, COUNT, TOGETHER):
        batch = [hostile_schedule(random) for _ in range(min(TOGETHER, COUNT - begin))]
        sent = [lab.client.send_goal_async(RunSchedule.Goal(typed_schedule=one)) for one in batch]
        graph.wait_for(lambda: all(future.done() for future in sent), timeout=300.0)  # noqa: B023
        handles = [future.result() for future in sent]
        assert all(handle.accepted for handle in handles)
        results = [handle.get_result_async() for handle in handles]
        graph.wait_for(lambda: all(each.done() for each in results), timeout=300.0)  # noqa: B023
        for future in results:
            result = future.result().result
            assert result.reason
            assert result.error_code in (CODES.BAD_SCHEDULE, CODES.OVER_LIMIT, CODES.WRONG_STATE)
            answered += 1
    assert answered == COUNT
    assert lab.controller.fault_counts() == {}
    print(f'{answered} hostile goals, each answered with an error code and a reason')
