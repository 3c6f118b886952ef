# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Several publishers of one topic: those that count are told apart from the others."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from rpms_ros.api import load
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import RecordingWriter, read_recording
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED, direction_of
from rpms_ros.recording.rosbag.writing import encode_forces, encode_pulses
from rpms_ros.report.result import IdentificationOptions, identified

START_NS = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000
SAMPLES = 4000
OTHERS_AFTER, OTHERS = 2000, 50


def write(path: Path, storage: str, others: int, other: str = 'bb') -> None:
    """Pulses and force of `aa`; after two seconds another publisher says something else."""
    stamps = START_NS + MILLISECOND * np.arange(SAMPLES, dtype=np.int64)
    force = 2.0 + np.sin(np.arange(SAMPLES) / 40.0)
    forces = encode_forces(ForceTrace(stamps, force), direction_of('z'))
    wrong = encode_forces(ForceTrace(stamps, force - 30.0), direction_of('z'))
    pulses = PulseTrain.regular(np.random.default_rng(1).uniform(size=80), 20.0, START_NS)
    encoded = encode_pulses(pulses, 'coil')
    with RecordingWriter(path, storage) as writer:
        pulse_topic = writer.add_topic('/pulses', PULSE, publisher='aa')
        own = writer.add_topic('/force', WRENCH_STAMPED, publisher='aa')
        for index in range(SAMPLES):
            time_ns = int(stamps[index])
            if index % 50 == 0:
                writer.append(pulse_topic, time_ns, encoded.message(index // 50))
            writer.append(own, time_ns, forces.message(index))
            if index == OTHERS_AFTER and others:
                foreign = writer.add_topic('/force', WRENCH_STAMPED, publisher=other)
            if OTHERS_AFTER <= index < OTHERS_AFTER + others:
                writer.append(foreign, time_ns, wrong.message(index))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_only_the_first_publisher_counts(tmp_path: Path, storage: str) -> None:
    write(tmp_path / 'alone', storage, 0)
    write(tmp_path / 'both', storage, OTHERS)
    alone, both = (read_recording(tmp_path / name) for name in ('alone', 'both'))
    np.testing.assert_array_equal(both.forces.force, alone.forces.force)
    np.testing.assert_array_equal(both.samples_before_pulse, alone.samples_before_pulse)
    expected = OTHERS_AFTER + 1 + np.arange(OTHERS)
    np.testing.assert_array_equal(both.foreign.samples_before_sample, expected)
    assert both.facts.faults == {'several_publishers': OTHERS}
    assert alone.facts.faults == {}
    assert len(alone.foreign) == 0


@pytest.mark.long
def test_estimates_name_the_other_publisher_and_do_not_learn_from_it(tmp_path: Path) -> None:
    write(tmp_path / 'alone', 'mcap', 0)
    write(tmp_path / 'both', 'mcap', OTHERS)
    alone, both = (
        identified(read_recording(tmp_path / name), IdentificationOptions()).last
        for name in ('alone', 'both')
    )
    assert both.faults == {**alone.faults, 'force_publishers': OTHERS}
    np.testing.assert_array_equal(both.nonlinear, alone.nonlinear)


def test_a_part_of_a_session_has_what_others_sent_meanwhile(tmp_path: Path) -> None:
    write(tmp_path / 'both', 'mcap', OTHERS)
    session = load(tmp_path / 'both')
    begin, length = OTHERS_AFTER + 9, 21
    part = session.between(begin * 1e-3, (begin + length - 1) * 1e-3).recording
    assert len(part.forces) == length
    # One of others after each sample but the last.
    np.testing.assert_array_equal(part.foreign.samples_before_sample, np.arange(1, length))
    assert len(session.between(0.0, 1.0).recording.foreign) == 0


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_another_publisher_counts_after_the_first_is_silent(tmp_path: Path, storage: str) -> None:
    """As when a sensor is started anew: both are of one session."""
    stamps = START_NS + MILLISECOND * np.arange(SAMPLES, dtype=np.int64)
    forces = encode_forces(ForceTrace(stamps, np.arange(SAMPLES) / 100.0), direction_of('z'))
    with RecordingWriter(tmp_path / 'anew', storage) as writer:
        writer.append(writer.add_topic('/pulses', PULSE), START_NS, pulse_message())
        for publisher, part in (('aa', range(1000)), ('bb', range(1000, SAMPLES))):
            topic = writer.add_topic('/force', WRENCH_STAMPED, publisher=publisher)
            for index in part:
                writer.append(topic, int(stamps[index]), forces.message(index))
    recording = read_recording(tmp_path / 'anew')
    # More than a second by its own stamps.
    assert len(recording.foreign.samples_before_sample) == 1001
    assert len(recording.forces) == SAMPLES - 1001


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_other_readers_see_every_message(tmp_path: Path, storage: str) -> None:
    write(tmp_path / 'both', storage, OTHERS)
    with Reader(tmp_path / 'both') as reader:
        found = [connection.topic for connection, _, _ in reader.messages()]
        assert reader.topics['/force'].msgcount == SAMPLES + OTHERS
    assert found.count('/force') == SAMPLES + OTHERS
    if storage == 'mcap':
        with (tmp_path / 'both' / 'both_0.mcap').open('rb') as file:
            topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
        assert topics.count('/force') == SAMPLES + OTHERS


def pulse_message() -> bytes:
    return encode_pulses(PulseTrain.regular([0.5], 20.0, START_NS), 'coil').message(0)
