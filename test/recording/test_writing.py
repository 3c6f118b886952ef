# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written and read again: refusals, a full device, the order of reception."""

import resource
import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import (
    FurtherTopic,
    RecordingWriter,
    Topics,
    read_facts,
    read_recording,
    write_recording,
)
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED, known_types
from rpms_ros.recording.rosbag.scan import Scan


@pytest.fixture
def small_device():
    """A limit of the file size is met like the end of a device, at the same calls."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Python ignores the signal SIGXFSZ
    resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures('small_device')
def test_full_device_is_told_and_what_fits_is_kept(tmp_path):
    path = tmp_path / 'bag'
    stamp_ns = np.arange(50_000, dtype=np.int64) * 1_000_000
    pulses = PulseTrain.regular(np.full(1000, 0.5), 20.0)
    told = f'^expected room and permission to write {path}, got .*$'
    with pytest.raises(RecordingError, match=told):
        write_recording(path, pulses, ForceTrace(stamp_ns, np.ones(50_000)))
    facts = read_facts(path)
    force = next(topic for topic in facts.topics if topic.name == '/force')
    # 3 MB hold 25,000 messages of 119 bytes; what is behind the last whole chunk of 8192 is lost.
    assert 8_000 < force.count < 26_000


def test_a_failure_of_the_caller_still_closes_the_recording(tmp_path):
    path = tmp_path / 'bag'

    def fail():
        with RecordingWriter(path) as writer:
            writer.append(writer.add_topic('/pulses', PULSE), 1, b'x')
            raise KeyError('mine')

    with pytest.raises(KeyError, match='mine'):
        fail()
    facts = read_facts(path)
    assert facts.faults == {}
    assert facts.topics[0].count == 1


def test_unknown_compression(tmp_path):
    with pytest.raises(RecordingError, match="expected compression lz4 or zstd, got 'gz'"):
        RecordingWriter(tmp_path / 'bag', 'gz')
    assert not (tmp_path / 'bag').exists()


def test_further_topics_are_merged_by_time(tmp_path):
    path = tmp_path / 'bag'
    text = FurtherTopic('/notes', 'std_msgs/msg/String', [5, 25], [b'one', b'two'])
    forces = ForceTrace(np.array([0, 10, 20, 30]), np.zeros(4))
    write_recording(path, PulseTrain.of([]), forces, further=[text])
    counts = {topic.name: topic.count for topic in read_facts(path).topics}
    assert counts == {'/pulses': 0, '/force': 4, '/notes': 2}
    places = {channel.topic: records.place for channel, records in Scan(path).blocks()}
    np.testing.assert_array_equal(places['/notes'], [1, 4])


@pytest.mark.parametrize('compression', ['', 'lz4', 'zstd'])
def test_what_was_written_is_read_by_us_and_by_rosbags(session, tmp_path, compression):
    path = tmp_path / 'bag'
    write_recording(path, *session, compression=compression)
    pulses, forces = session
    recording = read_recording(path)
    for name in ('onset_ns', 'intensity', 'sequence', 'width'):
        assert getattr(recording.pulses, name).tobytes() == getattr(pulses, name).tobytes()
    assert recording.forces.stamp_ns.tobytes() == forces.stamp_ns.tobytes()
    assert recording.forces.force.tobytes() == forces.force.tobytes()
    assert recording.forces.frame_id == forces.frame_id
    assert recording.facts.storage == 'mcap'
    assert recording.facts.faults == {}
    assert recording.force_received_ns.tolist() == forces.stamp_ns.tolist()
    with AnyReader([path]) as reader:
        assert reader.message_count == len(pulses) + len(forces)
        counts = {topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
        assert counts == {'/pulses': (PULSE, len(pulses)), '/force': (WRENCH_STAMPED, len(forces))}
        messages = [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
        ]
    force = [message.wrench.force.z for topic, message in messages if topic == '/force']
    assert force == forces.force.tolist()
    # The first pulse comes before the sample of the same time.
    assert [topic for topic, _ in messages[:2]] == ['/pulses', '/force']


@pytest.mark.parametrize('storage', list(StoragePlugin))
@pytest.mark.parametrize('compression', list(CompressionMode))
def test_what_rosbags_wrote_is_read(write_with_rosbags, make, storage, compression):
    if storage is StoragePlugin.SQLITE3 and compression is CompressionMode.STORAGE:
        compression = CompressionMode.NONE
    messages = [('/pulses', PULSE, 10, make.pulse(5, 3, 0.25))]
    messages += [
        ('/force', WRENCH_STAMPED, 10 + i, make.wrench_stamped(7 + i, 0.5 * i)) for i in range(50)
    ]
    recording = read_recording(write_with_rosbags(messages, storage, compression))
    assert recording.pulses.onset_ns.tolist() == [5]
    assert recording.pulses.sequence.tolist() == [3]
    assert recording.pulse_received_ns.tolist() == [10]
    assert recording.forces.force.tolist() == [0.5 * i for i in range(50)]
    assert recording.forces.stamp_ns.tolist() == list(range(7, 57))
    assert recording.facts.faults == {}


def test_topics_below_a_namespace(write_with_rosbags, make):
    messages = [
        ('/left/pulses', PULSE, 1, make.pulse(1, 1)),
        ('/left/pulses_commanded', PULSE, 1, make.pulse(1, 2)),
        ('/left/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 4.0)),
        ('/right/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 8.0)),
    ]
    path = write_with_rosbags(messages)
    with pytest.raises(RecordingError, match=r'expected one topic force in .*, got /left/force, '):
        read_recording(path)
    recording = read_recording(path, Topics(force='/right/force'))
    assert recording.pulses.sequence.tolist() == [1]
    assert recording.forces.force.tolist() == [8.0]


def test_pulses_of_one_namespace_are_not_joined_with_the_force_of_another(
    write_with_rosbags, make
):
    messages = [
        ('/left/pulses', PULSE, 1, make.pulse(1, 1)),
        ('/left/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 4.0)),
        ('/force', WRENCH_STAMPED, 1, make.wrench_stamped(1, 8.0)),
    ]
    path = write_with_rosbags(messages)
    with pytest.raises(
        RecordingError, match=r'of one namespace in .*, got /left/pulses and /force:'
    ):
        read_recording(path)
    recording = read_recording(path, Topics(force='left/force'))
    assert (recording.forces.force.tolist(), recording.namespace) == ([4.0], '/left')


def test_files_that_nothing_names_are_told_of_and_what_is_packed_is_read_once(tmp_path, make):
    recording = written(tmp_path / 'bag', [(False, 1), (True, 2), (False, 3)], make)
    (storage,) = (tmp_path / 'bag').glob('*.mcap')
    shutil.copy(storage, storage.with_name('other.mcap'))
    again = read_recording(tmp_path / 'bag')
    assert again.facts.faults == {'unlisted_file': 1}
    assert len(again.forces) == len(recording.forces)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    (storage.with_name('other.mcap')).rename(storage.with_name(f'{storage.name}.zstd'))
    once = read_recording(tmp_path / 'bag')
    assert once.facts.faults == {'missing_metadata': 1}
    assert len(once.forces) == len(recording.forces)


def written(path, arrivals, make):
    """Return a recording of messages that are numbered in the order in which they came.

    Of each it is given whether it is a pulse, and the time at which it was received [ns].
    """
    with RecordingWriter(path) as writer:
        topics = writer.add_topic('/force', WRENCH_STAMPED), writer.add_topic('/pulses', PULSE)
        for number, (is_pulse, time_ns) in enumerate(arrivals):
            kind = PULSE if is_pulse else WRENCH_STAMPED
            message = (make.pulse if is_pulse else make.wrench_stamped)(number, number)
            raw = bytes(known_types().serialize_cdr(message, kind))
            writer.append(topics[is_pulse], time_ns, raw)
            if number % 5 == 4:
                writer.flush()
    return read_recording(path)


def order_of(recording):
    """Return the numbers of the messages as a replay would send them."""
    forces, pulses = recording.forces.stamp_ns, recording.pulses.onset_ns
    return np.insert(forces, recording.samples_before_pulse, pulses).tolist()


arrivals = st.lists(st.tuples(st.booleans(), st.integers(0, 2**50)), max_size=30).map(
    lambda drawn: [(True, 5), (False, 4), *drawn, (False, 3)]
)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None
)
@given(drawn=arrivals)
def test_the_order_written_is_the_order_read_where_the_clock_steps_back(
    tmp_path_factory, make, drawn
):
    path = tmp_path_factory.mktemp('order') / 'bag'
    recording = written(path, drawn, make)
    # The last force sample was received before the first: the clock of one topic stepped back.
    assert order_of(recording) == list(range(len(drawn)))
    received = {True: recording.pulse_received_ns, False: recording.force_received_ns}
    for is_pulse, times in received.items():
        assert times.tolist() == [time_ns for kind, time_ns in drawn if kind is is_pulse]


MILLISECONDS = 10_000 + np.arange(4000) - 1500 * (np.arange(4000) >= 2000)


@pytest.mark.parametrize(
    ('stamps', 'onsets', 'before'),
    [
        (MILLISECONDS, MILLISECONDS[::50], range(0, 4000, 50)),
        (1000 * np.array([1, 2, 3, 2, 3, 4]), np.array([2000]), [1]),
    ],
    ids=['both topics', 'force alone'],
)
def test_arrays_with_a_clock_set_back_keep_their_order(tmp_path, stamps, onsets, before):
    stamp_ns, onset_ns = 1_000_000 * stamps, 1_000_000 * onsets
    force = np.arange(float(len(stamps)))
    write_recording(
        tmp_path / 'bag', PulseTrain.numbered(onset_ns, 0.5), ForceTrace(stamp_ns, force)
    )
    recording = read_recording(tmp_path / 'bag')
    assert recording.forces.stamp_ns.tolist() == stamp_ns.tolist()
    assert recording.forces.force.tolist() == force.tolist()
    assert recording.pulses.onset_ns.tolist() == onset_ns.tolist()
    assert recording.samples_before_pulse.tolist() == list(before)
