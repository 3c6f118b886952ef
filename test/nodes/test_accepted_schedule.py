# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver is about to run is on the graph before its first pulse, and in the recording."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import AcceptedSchedule
from rpms_ros import messages
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.recording.rosbag.scan import Scan
from rpms_ros.recording.rosbag.verifying import verify as verify_recording
from rpms_ros.stimulation import constant, schedule_from_text
from rpms_ros.stimulation.records.append_only import verify_log

WARM_UP = replace(constant(0.5, 0.2, 50.0), name='wärm-up')


@pytest.fixture
def running(driver_bench, tmp_path):
    """A driver with an audit log, and somebody who asks for schedules."""
    bench = driver_bench(audit_log=str(tmp_path / 'audit.jsonl'))
    bench.audit = tmp_path / 'audit.jsonl'
    bench.ends = lambda: bench.result(bench.send(WARM_UP, operator_id='ada')).result
    return bench


def heard_by(graph, name: str) -> list[AcceptedSchedule]:
    node = graph.add(lambda **options: Node(name, **options))
    heard: list[AcceptedSchedule] = []
    node.create_subscription(
        AcceptedSchedule, topics.ACCEPTED_SCHEDULE, heard.append, qos.ACCEPTED_SCHEDULE
    )
    return heard


def recorded(path: Path) -> list[str]:
    """Topics of the messages of a recording, in their order."""
    with_places = [
        (place, channel.topic)
        for channel, records in Scan(path).blocks()
        for place in records.place.tolist()
    ]
    return [topic for _, topic in sorted(with_places)]


def test_a_schedule_is_told_before_its_first_pulse_and_recorded(graph, running, tmp_path) -> None:
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    driver, early = running.driver, heard_by(graph, 'early')
    graph.wait_for(lambda: driver.count_subscribers(topics.ACCEPTED_SCHEDULE) == 2)
    graph.wait_for(lambda: driver.count_subscribers(topics.PULSES) == 2)
    running.activate()
    assert running.ends().completed
    graph.wait_for(lambda: recorder.counts[topics.PULSES] == 10)
    graph.wait_for(lambda: recorder.counts[topics.ACCEPTED_SCHEDULE] == 1)
    late = heard_by(graph, 'late')
    graph.wait_for(lambda: len(late) == 1)
    (told,) = early
    assert late == early
    assert (told.name, told.operator_id, told.pulses) == ('wärm-up', 'ada', 10)
    assert told.duration == pytest.approx(0.2)  # one rounding of the sum of the segments
    assert schedule_from_text(told.schedule) == WARM_UP
    assert told.sha256 == hashlib.sha256(told.schedule.encode()).hexdigest()
    recorder.close()
    order = recorded(tmp_path / 'session')
    assert order.index('/accepted_schedule') < order.index('/pulses')
    assert order.index('/accepted_schedule') < order.index('/pulses_commanded')
    (entry,) = [
        record.content
        for record in verify_log(running.audit).records
        if record.content['kind'] == 'schedule'
    ]
    assert entry['text_sha256'] == told.sha256


def test_the_audit_log_vouches_for_the_pulses_of_a_recording(graph, running, tmp_path) -> None:
    path = tmp_path / 'session'
    recorder = graph.add(Recorder, path=str(path))
    graph.wait_for(lambda: running.driver.count_subscribers(topics.PULSES) == 2)
    sensor = graph.add(lambda **options: Node('sensor', **options))
    force = sensor.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    graph.wait_for(lambda: force.get_subscription_count() >= 1)
    for index in range(3):
        force.publish(messages.force_message(index, 1.0, messages.AXES['z'], MESSAGE_TYPES))
    running.activate()
    assert running.ends().completed
    graph.wait_for(lambda: not running.driver._active)
    running.arm()
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


def audit_findings(path: Path, audit: Path) -> list[tuple[str, str]]:
    findings = verify_recording(path, audit=audit)
    return [(one.state, one.text) for one in findings if one.check == 'audit']
