# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The identifier on real rclpy: the off-line answer, bad input, services, disturbance, torque."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

import rpms_ros
from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.errors import NodeError
from rpms_ros.identification import identify
from rpms_ros.identification.estimation.tracking import TrackingEstimator
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import (
    Identifier,
    IdentifierParameters,
    build_estimator,
    stream_settings,
)
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.report.recorded import differences

START_NS = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000


def recording(seconds=2.0, start_ns=START_NS):
    """A muscle under random pulses at 20 Hz, sampled at 1 kHz, without noise."""
    intensity = np.random.default_rng(1).uniform(0.4, 1.0, int(20 * seconds))
    pulses = PulseTrain.regular(intensity, 20.0, start_ns)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = start_ns + np.arange(int(1000 * seconds)) * MILLISECOND
    return pulses, ForceTrace(stamps, muscle.force(stamps))


def part(pulses, forces, first, last):
    """Milliseconds of a recording."""
    stamp_ns, force = forces.stamp_ns[first:last], forces.force[first:last]
    return pulses[first // 50 : last // 50], ForceTrace(stamp_ns, force)


class Bench:
    """An identifier, and somebody who feeds it and hears its estimates."""

    def __init__(self, graph, **parameters):
        self.graph, self.probe = graph, graph.node('probe')
        self.identifier = graph.add(Identifier, **parameters)
        self.messages = graph.heard(MuscleEstimate, 'estimate', qos.ESTIMATE)
        self.disturbances = graph.heard(WrenchStamped, 'disturbance', qos.DISTURBANCE)
        self._pulses = graph.publisher(PulseMessage, 'pulses', qos.PULSES)
        self._forces = graph.publisher(WrenchStamped, 'force', qos.FORCE)

    @property
    def estimates(self):
        return [estimate_messages.estimate_of(one) for one in self.messages]

    def send(self, pulses, forces):
        """Send them; return the last estimate that is due."""
        for columns in zip(
            pulses.onset_ns, pulses.intensity, pulses.sequence, pulses.width, strict=True
        ):
            pulse = messages.Pulse(*columns)
            self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
        how = messages.AXES['z'], MESSAGE_TYPES, 'cell', self.identifier.settings.quantity
        for stamp_ns, force in zip(forces.stamp_ns, forces.force, strict=True):
            self._forces.publish(messages.force_message(stamp_ns, force, *how))
        # the newest of the grid of 100 ms before the 200 ms in which samples wait
        due_ns = int(forces.stamp_ns[-1]) - 300 * MILLISECOND
        self.graph.wait_for(
            lambda: (
                bool(self.messages)
                and messages.nanoseconds(self.messages[-1].header.stamp) >= due_ns
            )
        )
        return self.estimates[-1]

    def call(self, name):
        client = self.probe.create_client(Trigger, f'identifier/{name}')
        self.graph.wait_for(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.graph.wait_for(future.done)
        assert future.result().success
        return future.result().message


def test_the_estimates_are_those_of_the_recording_bit_for_bit(graph):
    bench, heard = Bench(graph), recording()
    bench.send(*heard)
    settings = bench.identifier.settings
    estimator = build_estimator(settings)
    assert type(estimator).__name__ == 'FixedSizeRecursion'
    expected = identify(estimator, *heard, stream_settings(settings)).estimates
    assert len(bench.estimates) >= 17
    for live, replayed in zip(bench.estimates, expected, strict=False):
        assert differences(live, replayed) == []
    assert bench.estimates[-1].faults == {}
    # who comes late gets the newest estimate
    durable = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late = graph.heard(MuscleEstimate, 'estimate', durable)
    graph.wait_for(lambda: bool(late) and late[-1] == bench.messages[-1])


def test_a_lost_pulse_shows_in_the_sequence(graph):
    pulses, forces = recording()
    last = Bench(graph).send(pulses[np.arange(len(pulses)) != 10], forces)
    assert last.faults['pulse_lost'] == 1
    assert last.faults['samples_excluded'] >= 350
    assert np.isfinite(last.linear).all()


def test_messages_of_another_definition_are_lost_and_nothing_else(graph, capfd):
    """A pulse without the newest field, as of an older recording, ended the node."""
    bench, (pulses, forces) = Bench(graph), recording()
    pulse = messages.Pulse(int(pulses.onset_ns[0]), 0.5)
    message = messages.pulse_message(pulse, MESSAGE_TYPES)
    message.header.frame_id = 'coil'
    bench._pulses.publish(serialize_message(message)[:44])
    bench._forces.publish(serialize_message(WrenchStamped())[:30])
    last = bench.send(pulses, forces)
    assert last.faults['force_queue_full'] == 1
    assert np.isfinite(last.linear).all()
    log = capfd.readouterr().err
    for kind in ('Pulse', 'WrenchStamped'):
        assert f'expected a {kind} on' in log


def test_a_best_effort_sensor_is_heard(graph, capfd):
    identifier = graph.add(Identifier)
    sensor = graph.publisher(WrenchStamped, 'force', qos.FORCE_BEST_EFFORT)
    sample = messages.force_message(START_NS, 1.0, messages.AXES['z'], MESSAGE_TYPES)
    before = identifier._heard

    def heard():
        sensor.publish(sample)
        return identifier._heard > before

    graph.wait_for(heard)
    assert '/force is published best effort' in ''.join(capfd.readouterr())


def test_what_a_full_queue_loses_is_a_fault_of_the_estimate(graph):
    bench, (pulses, forces) = Bench(graph), recording()
    assert bench.send(*part(pulses, forces, 0, 1000)).faults == {}
    # the identifier does not look meanwhile, as where a callback beside it blocks
    depth = qos.FORCE.depth
    for stamp_ns in range(100):
        early = messages.force_message(stamp_ns, 0.0, messages.AXES['z'], MESSAGE_TYPES)
        bench._forces.publish(early)
    sample = messages.force_message(
        int(forces.stamp_ns[999]), float(forces.force[999]), messages.AXES['z'], MESSAGE_TYPES
    )
    for _ in range(depth):
        bench._forces.publish(sample)
    last = bench.send(*part(pulses, forces, 1000, 2000))
    assert last.faults['force_queue_full'] >= 100


def test_pulses_that_are_published_best_effort_are_heard(graph, capfd):
    identifier = graph.add(Identifier)
    driver = graph.publisher(PulseMessage, 'pulses', qos.VIEW)
    heard = []
    taken = identifier._pulses.taken
    identifier._pulses.taken = lambda: heard.extend(taken()) or []

    def hears():
        driver.publish(messages.pulse_message(messages.Pulse(START_NS, 0.5), MESSAGE_TYPES))
        return bool(heard)

    graph.wait_for(hears)
    assert '/pulses is published best effort' in ''.join(capfd.readouterr())


def test_a_second_publisher_on_the_graph_is_a_fault_and_a_doubt(graph, capfd):
    bench = Bench(graph)
    other = graph.node('other')
    other.create_publisher(WrenchStamped, 'force', qos.FORCE)
    other.create_publisher(PulseMessage, 'pulses', qos.PULSES)
    crowded = bench.identifier._senders._recent
    graph.wait_for(lambda: ('force_publishers', 'pulse_publishers') in crowded)
    last = bench.send(*recording())
    assert last.faults == {'force_publishers': 1, 'pulse_publishers': 1}
    assert {'force_publishers', 'pulse_publishers'} <= set(last.doubts)
    graph.wait_for(lambda: 'force_publishers: 1 so far' in ''.join(capfd.readouterr()))


def test_a_reset_forgets_everything_and_begins_anew(graph):
    bench = Bench(graph)
    before = bench.send(*recording())
    assert bench.call('reset') == 'reset: the identification starts again'
    assert bench.identifier.stream.estimate().samples == 0
    (refused,) = bench.identifier.set_parameters([Parameter('estimator', value='tracking')])
    assert not refused.successful
    assert 'read-only' in refused.reason
    last = bench.send(*recording(1.8, START_NS + 10**10))
    assert last.samples < before.samples


def test_hold_predicts_and_resume_learns(graph, capfd):
    bench, whole = Bench(graph), recording(3.5)
    bench.send(*part(*whole, 0, 1000))
    learnt = bench.identifier.stream.estimate().samples
    assert bench.call('hold') == 'held: predicts, does not learn'
    held = bench.send(*part(*whole, 1000, 2000))
    assert set(held.faults) == {'samples_excluded'}
    # those up to the newest one are still learnt from, and no other
    assert learnt < held.samples <= 1000
    before = bench.estimates[-2]
    assert held.samples == before.samples
    assert held.nonlinear.tolist() == before.nonlinear.tolist()
    assert bench.call('resume') == 'resumed: learns'
    assert bench.send(*part(*whole, 2000, 3500)).nonlinear.tolist() != held.nonlinear.tolist()
    bench.call('hold')
    # who begins anew while the coil is moved does not learn before that is over
    assert bench.call('reset') == 'reset: the identification starts again, held'
    assert bench.identifier.stream.held
    said = ''.join(capfd.readouterr())
    assert 'identifying with recursive: force [N] on /force along z' in said
    assert 'held: predicts, does not learn' in said


def test_the_disturbance_is_published_where_an_estimator_tells_it(graph):
    bench, whole = Bench(graph), recording(1.2)
    bench.send(*part(*whole, 0, 600))
    assert bench.disturbances == []
    estimator = bench.identifier.stream.estimator
    estimate = estimator.estimate

    def telling(stamp_ns, faults):
        return replace(estimate(stamp_ns, faults), disturbance=-0.7, disturbance_deviation=0.1)

    estimator.estimate = telling
    bench.send(*part(*whole, 600, 1200))
    graph.wait_for(lambda: bool(bench.disturbances))
    heard = bench.disturbances[-1]
    assert (heard.wrench.force.x, heard.wrench.force.z) == (0.0, -0.7)
    assert heard.header.frame_id == 'cell'
    assert heard.header.stamp in [one.header.stamp for one in bench.messages]


def test_a_torque_is_said_to_be_one(graph):
    last = Bench(graph, quantity='torque').send(*recording(1.0))
    assert last.unit == 'N m'
    assert np.isfinite(last.linear).all()
    assert last.samples > 500


def diagnosed(graph):
    """Return a function that tells the statuses of all nodes as they come from now on."""
    heard = graph.heard(DiagnosticArray, '/diagnostics')
    return lambda: [status for message in heard for status in message.status]


def test_diagnostics_say_what_is_in_doubt(graph):
    heard = diagnosed(graph)
    pulses, forces = recording(4.0)
    bench = Bench(graph)
    bench.send(pulses, ForceTrace(forces.stamp_ns, np.zeros(len(forces))))
    graph.wait_for(lambda: any(one.level == DiagnosticStatus.WARN for one in heard()))
    status = next(one for one in heard() if one.level == DiagnosticStatus.WARN)
    assert status.name == '/identifier: identification'
    assert status.message.startswith('in doubt: force_constant')
    assert {'estimator', 'fault force_constant'} <= {value.key for value in status.values}
    bench.identifier._heard -= 6.0
    graph.wait_for(lambda: heard()[-1].level == DiagnosticStatus.STALE)


@pytest.mark.long
def test_two_legs_have_six_statuses_of_different_names_and_hardware(graph, tmp_path):
    heard = diagnosed(graph)
    kinds = {'stimulator': StimulatorDriver, 'identification': Identifier, 'recording': Recorder}
    nodes = {}
    for leg in ('left', 'right'):
        for task, kind in kinds.items():
            path = {'path': str(tmp_path / leg)} if kind is Recorder else {}
            node = graph.add(partial(kind, namespace=leg), **path)
            nodes[f'/{leg}/{node.get_name()}: {task}'] = node
    graph.wait_for(lambda: len({status.name for status in heard()}) == 6)
    newest = {status.name: status for status in heard()}
    assert set(newest) == set(nodes)
    hardware = {status.hardware_id for status in newest.values()}
    assert len(hardware) == 6
    assert all(hardware)


@pytest.mark.long
def test_the_log_says_when_the_estimate_is_not_to_be_trusted(graph, capfd):
    """A force of the wrong sign: the curve comes out below zero."""
    said = []

    def heard(text):
        said.append(capfd.readouterr().err)
        return text in ''.join(said)

    pulses, forces = recording(4.0)
    bench = Bench(graph)
    last = bench.send(pulses, ForceTrace(forces.stamp_ns, -forces.force))
    assert 'curve_negative' in last.doubts
    graph.wait_for(lambda: heard('curve_negative: the curve is negative: a muscle does not push'))
    assert 'the estimate is not to be trusted: ' in ''.join(said)
    bench.identifier._reset()
    bench.identifier._report()
    assert not heard('nothing speaks against the estimate any more')
    for doubts in (('curve_negative',), ()):
        bench.identifier._last = replace(last, doubts=doubts)
        bench.identifier._report()
    assert heard('nothing speaks against the estimate any more')


def test_the_log_asks_for_the_unit_of_an_impossible_force(graph, capfd):
    pulses, forces = recording(4.0)
    bench = Bench(graph)
    bench.send(pulses, ForceTrace(forces.stamp_ns, 1e3 * forces.force))
    bench.identifier._report()
    graph.wait_for(lambda: 'does the sensor tell grams or millinewtons?' in capfd.readouterr().err)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'axis': 'up'}, "expected axis x, y, z, .* got 'up'"),
        ({'reorder_delay': 0.05}, r'reorder_delay: expected .* 0\.1 .*, got 0\.05'),
        ({'estimator': 'batch'}, 'works on line, got batch, .*: use tracking here'),
        ({'monitors': ('pish',)}, "expected monitors of .*, got 'pish'"),
        ({'preset': 'table_9'}, "preset: expected one of people, .* got 'table_9'"),
    ],
)
def test_bad_parameters_are_refused(values, message):
    with pytest.raises(NodeError, match=message):
        IdentifierParameters(**values)


def test_a_history_law_and_an_earlier_session_are_parameters(tmp_path):
    law = tmp_path / 'law.json'
    law.write_text('{"facilitation": 0.5}')
    settings = IdentifierParameters(estimator='tracking', temporal_summation=str(law))
    estimator = build_estimator(settings)
    assert isinstance(estimator, TrackingEstimator)
    assert estimator.settings.history == TemporalSummation(facilitation=0.5)
    earlier = tmp_path / 'earlier.json'
    rpms_ros.simulate(duration=10.0).identify('tracking').to_json(earlier)
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
        ({'quantity': 'torque', 'start_from': str(earlier)}, 'a result in N m, got one in N in'),
    ):
        with pytest.raises(NodeError, match=message):
            IdentifierParameters(**{'estimator': 'tracking', **wrong})
