# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder on real rclpy: every byte that was published, readable even after a kill."""

import json
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from rpms_msgs.msg import DriverStatus, Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.errors import NodeError, RecordingError
from rpms_ros.nodes import recorder as module
from rpms_ros.nodes.common import qos, subscriptions, topics
from rpms_ros.nodes.common.subscriptions import QueuedTopic
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.recorder import Recorder, recorder_health
from rpms_ros.pulses import Pulse
from rpms_ros.recording import read_facts, read_recording
from rpms_ros.recording.rosbag.verifying import verify

MILLISECOND = 1_000_000
SAMPLES = 2000


class Source:
    """Publishes pulses and forces with known content."""

    def __init__(self, graph):
        self.graph = graph
        self.node = node = graph.node('source')
        self._pulses = node.create_publisher(PulseMessage, 'pulses', qos.PULSES)
        self._force = node.create_publisher(WrenchStamped, 'force', qos.FORCE)

    def wait_for_listeners(self):
        both = (self._pulses, self._force)
        # a recorder that is a process imports for a while on a machine under load
        self.graph.wait_for(
            lambda: all(one.get_subscription_count() == 1 for one in both), timeout=60.0
        )

    def send(self, samples):
        for index in range(samples):
            stamp_ns = 10**18 + index * MILLISECOND
            if index % 50 == 0:
                pulse = Pulse(stamp_ns, 0.5, index // 50)
                self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
            self._force.publish(
                messages.force_message(stamp_ns, 0.1 * index, messages.AXES['z'], MESSAGE_TYPES)
            )


def faults(path):
    """What `rpms verify` finds wrong with a recording."""
    return [str(one.text) for one in verify(path) if one.state == 'FAULT']


def check(path, samples):
    recording = read_recording(path)
    stamps = 10**18 + np.arange(samples) * MILLISECOND
    np.testing.assert_array_equal(recording.forces.stamp_ns, stamps)
    np.testing.assert_array_equal(recording.forces.force, 0.1 * np.arange(samples))
    np.testing.assert_array_equal(recording.pulses.onset_ns, stamps[::50])
    np.testing.assert_array_equal(recording.pulses.sequence, np.arange(len(stamps[::50])))


def test_what_was_published_is_in_the_recording(graph, tmp_path):
    source = Source(graph)
    path = tmp_path / 'session'
    recorder = graph.add(Recorder, path=str(path))
    source.wait_for_listeners()
    source.send(SAMPLES)
    graph.wait_for(lambda: recorder.counts['force'] == SAMPLES)
    graph.wait_for(lambda: recorder.counts['pulses'] == SAMPLES // 50)
    recorder.close()
    check(path, SAMPLES)
    assert ('lost', 'ok') in [(one.check, one.state) for one in verify(path)]


def test_recorders_of_one_second_take_different_names(graph, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recorders = [graph.add(partial(Recorder, namespace='leg/left')) for _ in range(3)]
    names = {recorder.path.name for recorder in recorders}
    assert len(names) == 3
    assert all('_leg_left' in name for name in names)


def test_a_topic_is_recorded_with_the_quality_of_its_publishers(graph, tmp_path):
    path = tmp_path / 'session'
    node = graph.node('source')
    recorder = graph.add(Recorder, path=str(path))
    pulses = [node.create_publisher(PulseMessage, 'pulses', qos.PULSES) for _ in range(2)]
    states = node.create_publisher(DriverStatus, 'driver_status', qos.STATUS)
    states.publish(DriverStatus(reason='before anybody listens'))
    graph.wait_for(lambda: recorder.counts['driver_status'] == 1)
    graph.wait_for(lambda: recorder.count_publishers('pulses') == 2)
    graph.wait_for(lambda: pulses[0].get_subscription_count() == 1)
    pulses[0].publish(messages.pulse_message(Pulse(10**18, 0.5), MESSAGE_TYPES))
    graph.wait_for(lambda: recorder.counts['pulses'] == 1)
    graph.wait_for(lambda: recorder._ears['pulses'].publishers == 2)
    recorder.close()
    with Reader(path) as reader:
        found = {each.topic: each for each in reader.connections}
    assert set(found) == {'/pulses', '/driver_status'}
    (profile,) = found['/driver_status'].ext.offered_qos_profiles
    assert profile.durability is QosDurability.TRANSIENT_LOCAL
    assert profile.reliability is QosReliability.RELIABLE
    assert len(found['/pulses'].ext.offered_qos_profiles) == 2
    facts = read_facts(path)
    assert facts.faults == {}
    assert json.loads(facts.custom['publishers']) == {'/pulses': 2, '/driver_status': 1}


def test_of_two_publishers_all_is_recorded_and_no_loss_is_claimed(graph, tmp_path):
    first, second = Source(graph), Source(graph)
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    for source in (first, second):
        source.wait_for_listeners()
    graph.wait_for(lambda: recorder.count_publishers('force') == 2)
    first.send(100)
    graph.wait_for(lambda: recorder.counts['force'] == 100)
    second.send(1)
    graph.wait_for(lambda: recorder.counts['force'] == 101)
    first.send(1)
    graph.wait_for(lambda: recorder.counts['force'] == 102)
    recorder.close()
    assert len(read_recording(tmp_path / 'session').forces) == 102
    lines = faults(tmp_path / 'session')
    assert '/force had 2 publishers' in lines
    assert not [line for line in lines if 'lost' in line]


def test_of_a_publisher_that_was_started_anew_nothing_is_lost(graph, tmp_path):
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    first = Source(graph)
    first.wait_for_listeners()
    first.send(3)
    graph.wait_for(lambda: recorder.counts['force'] == 3)
    first.node.destroy_publisher(first._force)
    second = Source(graph)
    # before anybody listens
    second.send(60)
    second.wait_for_listeners()
    second.send(1)
    graph.wait_for(lambda: recorder.counts['force'] > 3)
    assert recorder.lost == {}


def test_losses_are_counted_again_once_a_second_publisher_has_left(graph, monkeypatch):
    node = graph.node('listener')
    topic = QueuedTopic(node, node, WrenchStamped, 'force', qos.FORCE)
    first, second = Source(graph), Source(graph)
    graph.wait_for(lambda: topic.look() == '' and topic.publishers == 2)
    second.node.destroy_publisher(second._force)
    graph.wait_for(lambda: len(node.get_publishers_info_by_topic(topic.name)) == 1)
    graph.wait_for(lambda: first._force.get_subscription_count() == 1)
    whole = subscriptions.drained
    monkeypatch.setattr(
        subscriptions,
        'drained',
        lambda one: [some for some in whole(one) if not 10 < some.sequence <= 30],
    )
    first.send(60)
    found = []
    graph.wait_for(lambda: found.extend(topic.taken()) or len(found) == 40)
    assert topic.lost == 20


def test_of_a_publisher_that_comes_after_none_nothing_is_lost(graph, monkeypatch):
    node = graph.node('listener')
    topic = QueuedTopic(node, node, WrenchStamped, 'force', qos.FORCE)
    found = []

    def came(least):
        topic.look()
        found.extend(topic.taken())
        return len(found) > least

    first = Source(graph)
    graph.wait_for(lambda: first._force.get_subscription_count() == 1)
    first.send(3)
    graph.wait_for(lambda: came(2))
    first.node.destroy_publisher(first._force)
    graph.wait_for(lambda: not node.get_publishers_info_by_topic(topic.name))
    assert not came(3)
    second = Source(graph)
    # the first of them are not heard, as by somebody who begins to listen later
    whole = subscriptions.drained
    monkeypatch.setattr(
        subscriptions, 'drained', lambda one: [some for some in whole(one) if some.sequence > 50]
    )
    graph.wait_for(lambda: second._force.get_subscription_count() == 1)
    second.send(60)
    graph.wait_for(lambda: came(12))
    assert topic.lost == 0


def test_a_best_effort_sensor_is_recorded_whoever_else_is_on_the_graph(graph, tmp_path):
    """All was left out once a reliable publisher was there that sent nothing."""
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    sensor = graph.publisher(WrenchStamped, 'force', qos.FORCE_BEST_EFFORT)
    sample = messages.force_message(1, 1.0, messages.AXES['z'], MESSAGE_TYPES)

    def heard():
        sensor.publish(sample)
        return recorder.counts['force'] > 0

    graph.wait_for(heard)
    graph.wait_for(lambda: sensor.get_subscription_count() == 1)
    reliable = Source(graph)
    # both of its subscriptions hear this one
    graph.wait_for(lambda: reliable._force.get_subscription_count() == 2)
    graph.wait_for(lambda: recorder._ears['force'].publishers == 2)
    before = recorder.counts['force']
    for _ in range(10):
        sensor.publish(sample)
    graph.wait_for(lambda: recorder.counts['force'] >= before + 10)
    # and what both subscriptions hear is there once
    before = recorder.counts['force']
    reliable.send(10)
    graph.wait_for(lambda: recorder.counts['force'] >= before + 10)
    # a double would come with the next messages
    later = time.monotonic() + 0.3
    graph.wait_for(lambda: time.monotonic() > later)
    assert recorder.counts['force'] == before + 10
    recorder.close()


def test_what_a_full_queue_loses_is_counted(graph, tmp_path):
    source = Source(graph)
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    source.wait_for_listeners()
    source.send(1)
    graph.wait_for(lambda: recorder.counts['force'] == 1)
    # The recorder does not look meanwhile.
    depth = qos.FORCE.depth
    source.send(depth + 100)
    graph.wait_for(lambda: recorder.counts['force'] == 1 + depth)
    recorder._report()
    assert recorder.lost == {'force': 100}
    recorder.close()
    assert '100 messages of /force were lost' in faults(tmp_path / 'session')


def test_a_second_signal_while_messages_are_written_loses_none(graph, tmp_path, monkeypatch):
    source = Source(graph)
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    source.wait_for_listeners()
    append = recorder._writer.append

    def interrupted(*what):
        append(*what)
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(recorder._writer, 'append', interrupted)
    source.send(100)
    with pytest.raises(KeyboardInterrupt):
        graph.wait_for(lambda: recorder.counts['force'] == 100)
    # the others may still be under way
    graph.wait_for(lambda: recorder.counts['force'] == 100 and recorder.counts['pulses'] == 2)
    recorder.close()
    check(tmp_path / 'session', 100)


def test_what_waits_when_the_context_ends_is_written(graph, tmp_path):
    """Nothing was: the graph could not be asked for the profiles of a topic's publishers."""
    source = Source(graph)
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    source.wait_for_listeners()
    recorder.get_publishers_info_by_topic = None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder.context, 'ok', lambda: False)
        source.send(100)
        time.sleep(0.5)
        recorder.close()
    check(tmp_path / 'session', 100)


def test_status_that_is_not_kept_for_latecomers_is_recorded(graph, tmp_path, capfd):
    """Nothing of it was heard, and nobody said so."""
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    publisher = graph.publisher(DriverStatus, 'driver_status', QoSProfile(depth=10))
    graph.wait_for(lambda: bool(recorder._ears['driver_status']._best_effort))

    def heard():
        publisher.publish(DriverStatus(state=3))
        return recorder.counts['driver_status'] > 0

    graph.wait_for(heard)
    recorder.close()
    assert 'without keeping the last message: it is heard' in capfd.readouterr().err


def test_a_recorder_that_cannot_be_made_leaves_no_open_file(graph, tmp_path, monkeypatch):
    # an unclosed file is a warning, and a warning an error here
    monkeypatch.setattr(module, 'every', lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        graph.add(Recorder, path=str(tmp_path / 'session'))
    assert (tmp_path / 'session' / 'metadata.yaml').is_file()


def test_a_recorder_hears_a_best_effort_sensor_without_being_told(graph, tmp_path, capfd):
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    force = graph.publisher(WrenchStamped, 'force', qos.FORCE_BEST_EFFORT)
    sample = messages.force_message(10**18, 1.0, messages.AXES['z'], MESSAGE_TYPES)

    def heard():
        force.publish(sample)
        return recorder.counts['force'] > 0

    graph.wait_for(heard)
    said = ''.join(capfd.readouterr())
    assert '/force is published best effort: it is heard' in said
    recorder.close()
    assert f'closed {recorder.path}: ' in ''.join(capfd.readouterr())


FLOATS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64
from rpms_ros.nodes.common.runner import use_fast_discovery
use_fast_discovery()
rclpy.init()
node = Node('scale')
publisher = node.create_publisher(Float64, 'force', 10)
rclpy.spin(node)
"""


def test_a_force_of_another_type_is_told_while_there_is_time(graph, python, tmp_path, capfd):
    recorder = graph.add(Recorder, path=str(tmp_path / 'session'))
    graph.add(Identifier)
    diagnostics = graph.heard(DiagnosticArray, topics.DIAGNOSTICS)
    # a participant has one type for a topic
    python('-c', FLOATS)
    told = 'expected geometry_msgs/msg/WrenchStamped on /force, got std_msgs/msg/Float64'
    graph.wait_for(
        lambda: any(told == one.status[0].message for one in diagnostics), timeout=120.0
    )
    said = []

    def by_both():
        said.append(''.join(capfd.readouterr()))
        return all(f'[{who}]: {told}' in ''.join(said) for who in ('recorder', 'identifier'))

    graph.wait_for(by_both)
    recorder.close()


def test_a_recorder_says_what_it_lacks(tmp_path, monkeypatch):
    def room(free):
        usage = SimpleNamespace(free=free)
        monkeypatch.setattr(module.shutil, 'disk_usage', lambda path: path.stat() and usage)

    room(5_000_000_000)
    assert recorder_health(tmp_path, {'force': 0}, []).message == 'recording; no message yet'
    fine = recorder_health(tmp_path, {'force': 3}, [])
    assert (fine.level, fine.message) == (DiagnosticStatus.OK, 'recording')
    assert fine.figures['messages of force'] == 3
    lossy = recorder_health(tmp_path, {'force': 3}, ['7 messages of force lost'])
    assert (lossy.level, lossy.message) == (DiagnosticStatus.WARN, '7 messages of force lost')
    with pytest.raises(NodeError, match=r'expected the folder of the recording, got .*No such'):
        recorder_health(tmp_path / 'gone', {}, [])
    room(20_000_000)
    full = recorder_health(tmp_path, {'force': 3}, [])
    assert (full.level, full.message) == (DiagnosticStatus.WARN, '20 MB are left on the disk')


def test_a_kill_costs_nothing_that_was_flushed(graph, python, tmp_path):
    path, source = tmp_path / 'session', Source(graph)
    code = 'import sys; from rpms_ros.nodes.recorder import main; sys.exit(main())'

    def flushed():
        if not any(file.stat().st_size > 100_000 for file in path.glob('*.mcap')):
            return None
        try:
            found = read_recording(path)
        except RecordingError as error:
            # on a busy machine thousands of samples are heard before the first pulse
            if 'expected topic pulses' not in str(error):
                raise
            return None
        return len(found.forces), len(found.pulses)

    process = python('-c', code, '--ros-args', '-p', f'path:={path}')
    source.wait_for_listeners()
    source.send(SAMPLES)
    # how long it takes is measured in bench/recorder.py
    graph.wait_for(lambda: flushed() == (SAMPLES, SAMPLES // 50), timeout=60.0)
    process.kill()
    process.wait()
    assert not (path / 'metadata.yaml').exists()
    check(path, SAMPLES)
