# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Replay through the real nodes: every estimate again, in every bit, and none invented."""

from dataclasses import replace as changed

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.nodes import replay as module
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.replay import Replayer, replay
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import Recording, read_recording, write_recording
from rpms_ros.report.recorded import compare

START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope='module')
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Four seconds at 1 kHz: more messages than may be under way at once."""
    intensity = np.random.default_rng(1).uniform(0.0, 1.0, 80)
    pulses = PulseTrain.regular(intensity, 20.0, START_NS)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = START_NS + np.arange(4000) * 1_000_000
    path = tmp_path_factory.mktemp('replay') / 'session'
    write_recording(path, pulses, ForceTrace(stamps, muscle.force(stamps)))
    return read_recording(path)


def test_a_replay_gives_the_estimates_of_the_recording_bit_for_bit(recording: Recording) -> None:
    seen: list[int] = []
    done = replay(recording, {'preset': 'paper_table_5'}, progress=seen.append)
    assert compare(done.expected, done.estimates).exact
    # one a tenth of a second, but for the last two that are held back and the one of the end
    assert len(done.estimates) == len(done.expected) == 37
    assert sum(seen) == done.messages == 4080
    assert done.recorded_s == pytest.approx(3.999)


def test_a_factor_paces_a_replay(recording: Recording) -> None:
    second = slice(0, 1000)
    forces = ForceTrace(recording.forces.stamp_ns[second], recording.forces.force[second])
    short = changed(
        recording,
        pulses=recording.pulses[:20],
        pulse_received_ns=recording.pulse_received_ns[:20],
        samples_before_pulse=recording.samples_before_pulse[:20],
        forces=forces,
        force_received_ns=recording.force_received_ns[second],
    )
    done = replay(short, factor=2.0)
    assert compare(done.expected, done.estimates).exact
    # the last message is not due earlier; a busy machine may take longer
    assert done.elapsed_s >= 0.999 / 2.0
    assert done.factor <= 2.01


def test_faults_of_a_recording_are_those_of_its_replay(recording: Recording) -> None:
    force = recording.forces.force.copy()
    force[1500] = np.nan
    kept = np.ones(80, dtype=bool)
    kept[40] = False
    spoiled = changed(
        recording,
        forces=changed(recording.forces, force=force),
        pulses=recording.pulses[kept],
        pulse_received_ns=recording.pulse_received_ns[kept],
        samples_before_pulse=recording.samples_before_pulse[kept],
    )
    done = replay(spoiled)
    assert compare(done.expected, done.estimates).exact
    faults = done.estimates[-1].faults
    assert faults['force_not_finite'] == 1
    assert faults['pulse_lost'] == 1


def test_no_more_is_under_way_than_the_window_allows(
    graph, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, 'WINDOW', 100)
    heard = {'pulses': 0, 'force': 0}
    ear = graph.add(lambda **options: Node('ear', **options))

    def count(name: str) -> None:
        heard[name] += 1

    ear.create_subscription(PulseMessage, 'pulses', lambda _: count('pulses'), qos.PULSES)
    ear.create_subscription(WrenchStamped, 'force', lambda _: count('force'), qos.FORCE)
    answer = ear.create_publisher(MuscleEstimate, 'estimate', qos.ESTIMATE)
    player = graph.add(lambda **options: Replayer(recording, **options))
    graph.wait_for(lambda: player.ready)
    while player.step():
        pass
    assert player.sent == 100
    graph.wait_for(lambda: sum(heard.values()) == 100)
    # 100 messages: two pulses and the samples up to 97 ms
    assert heard == {'pulses': 2, 'force': 98}
    stamp_ns = START_NS + 49_000_000
    message = MuscleEstimate(header=messages.header_message(stamp_ns, '', MESSAGE_TYPES))
    answer.publish(message)
    graph.wait_for(lambda: bool(player.estimates))
    while player.step():
        pass
    # one pulse and 50 samples have been used
    assert player.sent == 100 + 51


def test_what_nobody_answers_is_sent_after_a_while(
    graph, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, 'WINDOW', 100)
    player = graph.add(lambda **options: Replayer(recording, **options))
    while player.step():
        pass
    graph.wait_for(lambda: player.step() > 0)
    assert 100 < player.sent <= 200
