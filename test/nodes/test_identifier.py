# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The identifier on real rclpy: the off-line answer, and bad input that it must survive."""

from collections.abc import Sequence

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter

import rpms_ros
from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.errors import NodeError
from rpms_ros.identification import Estimate, identify
from rpms_ros.identification.estimation.tracking import TrackingEstimator
from rpms_ros.identification.model.summation import TemporalSummation
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import (
    Identifier,
    IdentifierParameters,
    build_estimator,
    stream_settings,
)
from rpms_ros.pulses import ForceTrace, PulseTrain

START_NS = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000


def recording(seconds: float = 2.0, start_ns: int = START_NS) -> tuple[PulseTrain, ForceTrace]:
    """A muscle under random pulses at 20 Hz, sampled at 1 kHz, without noise."""
    intensity = np.random.default_rng(1).uniform(0.4, 1.0, int(20 * seconds))
    pulses = PulseTrain.regular(intensity, 20.0, start_ns)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = start_ns + np.arange(int(1000 * seconds)) * MILLISECOND
    return pulses, ForceTrace(stamps, muscle.force(stamps))


class Bench:
    """An identifier, and somebody who feeds it and hears its estimates."""

    def __init__(self, graph, **parameters: object) -> None:
        self.graph = graph
        self.estimates: list[Estimate] = []
        probe = graph.node('probe')
        self._pulses = probe.create_publisher(PulseMessage, 'pulses', qos.PULSES)
        self._forces = probe.create_publisher(WrenchStamped, 'force', qos.FORCE)
        probe.create_subscription(MuscleEstimate, 'estimate', self._on_estimate, qos.ESTIMATE)
        self.identifier = graph.add(Identifier, **parameters)
        self._publishers = (self._pulses, self._forces)
        graph.wait_for(lambda: all(one.get_subscription_count() == 1 for one in self._publishers))

    def _on_estimate(self, message: MuscleEstimate) -> None:
        self.estimates.append(estimate_messages.estimate_of(message))

    def send_pulses(self, train: PulseTrain, kept: Sequence[int] | None = None) -> None:
        for index in range(len(train)) if kept is None else kept:
            columns = (train.onset_ns, train.intensity, train.sequence, train.width)
            pulse = messages.Pulse(*(column[index] for column in columns))
            self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))

    def send_forces(self, trace: ForceTrace) -> None:
        for stamp_ns, force in zip(trace.stamp_ns, trace.force, strict=True):
            self._forces.publish(
                messages.force_message(stamp_ns, force, messages.AXES['z'], MESSAGE_TYPES)
            )

    def wait_until(self, stamp_ns: int) -> Estimate:
        """Wait for the last estimate whose stamp is due by then; return it."""
        self.graph.wait_for(
            lambda: bool(self.estimates) and self.estimates[-1].stamp_ns >= stamp_ns, 20.0
        )
        return self.estimates[-1]


def offline(
    pulses: PulseTrain, forces: ForceTrace, settings: IdentifierParameters
) -> list[Estimate]:
    return identify(build_estimator(settings), pulses, forces, stream_settings(settings)).estimates


def same(first: Estimate, second: Estimate) -> list[str]:
    """Names of the fields that differ in any bit."""
    return [
        name
        for name, value in vars(first).items()
        if np.asarray(value).tobytes() != np.asarray(getattr(second, name)).tobytes()
        and value != getattr(second, name)
    ]


def test_the_estimates_are_those_of_the_recording_bit_for_bit(graph) -> None:
    pulses, forces = recording()
    bench = Bench(graph)
    bench.send_pulses(pulses)
    bench.send_forces(forces)
    # the newest cell of the estimates' grid that lies before the reorder delay
    bench.wait_until(START_NS + 1_699 * MILLISECOND)
    expected = offline(pulses, forces, bench.identifier.settings)
    assert len(bench.estimates) >= 17
    for live, replayed in zip(bench.estimates, expected, strict=False):
        assert same(live, replayed) == []
    assert bench.estimates[-1].faults == {}


def test_a_lost_pulse_shows_in_the_sequence(graph) -> None:
    pulses, forces = recording()
    bench = Bench(graph)
    bench.send_pulses(pulses, [index for index in range(len(pulses)) if index != 10])
    bench.send_forces(forces)
    last = bench.wait_until(START_NS + 1_699 * MILLISECOND)
    assert last.faults['pulse_lost'] == 1
    assert last.faults['samples_excluded'] >= 350
    assert np.isfinite(last.linear).all()


def test_a_best_effort_sensor_is_heard(graph, capfd: pytest.CaptureFixture[str]) -> None:
    probe = graph.node('probe')
    sensor = probe.create_publisher(WrenchStamped, 'force', qos.FORCE_BEST_EFFORT)
    identifier = graph.add(Identifier)
    graph.wait_for(lambda: sensor.get_subscription_count() == 1)
    sample = messages.force_message(START_NS, 1.0, messages.AXES['z'], MESSAGE_TYPES)
    before = identifier._heard

    def heard() -> bool:
        sensor.publish(sample)
        return identifier._heard > before

    graph.wait_for(heard)
    assert '/force is published best effort' in ''.join(capfd.readouterr())


def test_a_second_publisher_on_the_graph_is_a_fault_and_a_doubt(graph, capfd) -> None:
    pulses, forces = recording()
    bench = Bench(graph)
    other = graph.node('other')
    other.create_publisher(WrenchStamped, 'force', qos.FORCE)
    other.create_publisher(PulseMessage, 'pulses', qos.PULSES)
    crowded = bench.identifier._senders._recent
    graph.wait_for(lambda: ('force_publishers', 'pulse_publishers') in crowded)
    bench.send_pulses(pulses)
    bench.send_forces(forces)
    last = bench.wait_until(START_NS + 1_699 * MILLISECOND)
    assert last.faults == {'force_publishers': 1, 'pulse_publishers': 1}
    assert {'force_publishers', 'pulse_publishers'} <= set(last.doubts)
    graph.wait_for(lambda: 'force_publishers: 1 so far' in ''.join(capfd.readouterr()))


def test_reset_begins_anew(graph) -> None:
    pulses, forces = recording()
    bench = Bench(graph)
    bench.send_pulses(pulses)
    bench.send_forces(forces)
    before = bench.wait_until(START_NS + 1_699 * MILLISECOND)
    bench.identifier._reset()
    (refused,) = bench.identifier.set_parameters([Parameter('estimator', value='tracking')])
    assert not refused.successful
    assert 'read-only' in refused.reason
    count = len(bench.estimates)
    later, force = recording(start_ns=START_NS + 10**10)
    bench.send_pulses(later)
    bench.send_forces(force)
    last = bench.wait_until(START_NS + 10**10 + 1_499 * MILLISECOND)
    assert len(bench.estimates) > count
    assert last.samples < before.samples


def test_diagnostics_say_what_is_in_doubt(graph) -> None:
    messages_heard = graph.heard(DiagnosticArray, '/diagnostics')

    def heard() -> list[DiagnosticStatus]:
        return [status for message in messages_heard for status in message.status]

    pulses, forces = recording(4.0)
    bench = Bench(graph)
    bench.send_pulses(pulses)
    bench.send_forces(ForceTrace(forces.stamp_ns, np.zeros(len(forces))))
    graph.wait_for(lambda: any(one.level == DiagnosticStatus.WARN for one in heard()))
    status = next(one for one in heard() if one.level == DiagnosticStatus.WARN)
    assert status.name == '/identifier: identification'
    assert status.message.startswith('in doubt: force_constant')
    assert {'estimator', 'fault force_constant'} <= {value.key for value in status.values}
    bench.identifier._heard -= 6.0
    graph.wait_for(lambda: heard()[-1].level == DiagnosticStatus.STALE)


@pytest.mark.long
def test_the_log_says_when_the_estimate_is_not_to_be_trusted(
    graph, capfd: pytest.CaptureFixture[str]
) -> None:
    """A force of the wrong sign: the curve comes out below zero."""
    said: list[str] = []

    def heard(text: str) -> bool:
        said.append(capfd.readouterr().err)
        return text in ''.join(said)

    pulses, forces = recording(4.0)
    bench = Bench(graph)
    bench.send_pulses(pulses)
    bench.send_forces(ForceTrace(forces.stamp_ns, -forces.force))
    assert 'curve_negative' in bench.wait_until(START_NS + 3_699 * MILLISECOND).doubts
    graph.wait_for(lambda: heard('curve_negative: the curve is negative: a muscle does not push'))
    assert 'the estimate is not to be trusted: ' in ''.join(said)
    bench.identifier._reset()
    graph.wait_for(lambda: heard('nothing speaks against the estimate any more'))


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'axis': 'up'}, "expected axis x, y, z, .* got 'up'"),
        ({'reorder_delay': 0.05}, r'reorder_delay: expected .* 0\.1 .*, got 0\.05'),
        ({'estimator': 'batch'}, 'works on line, got batch, .*: use tracking here'),
        ({'monitors': ('pish',)}, "expected monitors of .*, got 'pish'"),
        ({'preset': 'table_9'}, "preset: expected a preset of people, .* got 'table_9'"),
    ],
)
def test_bad_parameters_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(NodeError, match=message):
        IdentifierParameters(**values)


def test_a_history_law_and_an_earlier_session_are_parameters(tmp_path) -> None:
    law = tmp_path / 'law.json'
    law.write_text('{"facilitation": 0.5}')
    settings = IdentifierParameters(estimator='tracking', temporal_summation=str(law))
    estimator = build_estimator(settings)
    assert isinstance(estimator, TrackingEstimator)
    assert estimator.settings.history == TemporalSummation(facilitation=0.5)
    earlier = tmp_path / 'earlier.json'
    rpms_ros.simulate(duration=2.0).identify('tracking').to_json(earlier)
    warm = build_estimator(IdentifierParameters(estimator='tracking', start_from=str(earlier)))
    assert isinstance(warm, TrackingEstimator)
    assert warm._window.point.linear.any()
    for wrong, message in (
        ({'temporal_summation': str(tmp_path)}, 'expected a JSON file with a history law'),
        ({'start_from': str(law)}, 'of a session with a recruitment curve'),
        (
            {'estimator': 'recursive', 'start_from': str(earlier)},
            'such as tracking, got recursive',
        ),
    ):
        with pytest.raises(NodeError, match=message):
            IdentifierParameters(**{'estimator': 'tracking', **wrong})
