# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What an identifier offers beside estimates: services, disturbance, a late look, torque."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.identification import Estimate
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.pulses import Pulse

START_NS = 1_700_000_000_000_000_000
MILLISECOND = 1_000_000


class Sensor:
    """Sends pulses and samples of a sensor with chosen stamps; hears what an identifier says."""

    def __init__(self, graph, quantity: str = 'force', **parameters: object) -> None:
        self.graph, self.quantity, self.sent = graph, quantity, 0
        self.node = graph.node('sensor')
        self.estimates = graph.heard(MuscleEstimate, 'estimate', qos.ESTIMATE)
        self.disturbances = graph.heard(WrenchStamped, 'disturbance', qos.DISTURBANCE)
        self.pulses = self.node.create_publisher(PulseMessage, 'pulses', qos.PULSES)
        self.forces = self.node.create_publisher(WrenchStamped, 'force', qos.FORCE)
        self.identifier = graph.add(Identifier, quantity=quantity, **parameters)
        both = (self.pulses, self.forces)
        graph.wait_for(lambda: all(one.get_subscription_count() == 1 for one in both))

    def send(self, milliseconds: int) -> None:
        """Send the next samples, of which every fiftieth comes with a pulse."""
        for index in range(self.sent, self.sent + milliseconds):
            stamp_ns = START_NS + index * MILLISECOND
            if index % 50 == 0:
                pulse = Pulse(stamp_ns, 0.5 + 0.01 * (index % 40), index // 50)
                self.pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
            self.forces.publish(
                messages.force_message(
                    stamp_ns,
                    1.0 + 0.001 * (index % 50),
                    messages.AXES['z'],
                    MESSAGE_TYPES,
                    'cell',
                    self.quantity,
                )
            )
        self.sent += milliseconds
        # the last estimate on the grid of 100 ms before the 200 ms in which samples wait
        newest_ns = START_NS + (self.sent - 302) * MILLISECOND
        self.graph.wait_for(
            lambda: (
                bool(self.estimates)
                and messages.nanoseconds(self.estimates[-1].header.stamp) >= newest_ns
            )
        )

    def call(self, name: str) -> str:
        client = self.node.create_client(Trigger, f'identifier/{name}')
        self.graph.wait_for(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.graph.wait_for(future.done)
        assert future.result().success
        return future.result().message


def test_hold_predicts_and_resume_learns(graph, capfd: pytest.CaptureFixture[str]) -> None:
    sensor = Sensor(graph)
    sensor.send(1000)
    learnt = sensor.identifier.stream.estimate().samples
    assert sensor.call('hold') == 'held: predicts, does not learn'
    sensor.send(1000)
    held = sensor.estimates[-1]
    assert held.fault_names == ['samples_excluded']
    # those up to the newest one are still learnt from, and no other
    assert learnt < held.samples <= 1000
    assert held.samples == sensor.estimates[-2].samples
    before = list(held.nonlinear)
    assert before == list(sensor.estimates[-2].nonlinear)
    assert sensor.call('resume') == 'resumed: learns'
    sensor.send(1500)
    assert before != list(sensor.estimates[-1].nonlinear)
    said = ''.join(capfd.readouterr())
    assert 'identifying with recursive: force [N] on /force along z' in said
    assert 'held: predicts, does not learn' in said


def test_a_reset_forgets_everything(graph) -> None:
    sensor = Sensor(graph)
    sensor.send(1000)
    assert sensor.call('reset') == 'reset: the identification starts again'
    assert sensor.identifier.stream.estimate().samples == 0


def test_the_disturbance_is_published_where_an_estimator_tells_it(graph) -> None:
    sensor = Sensor(graph)
    sensor.send(600)
    assert sensor.disturbances == []
    estimator = sensor.identifier.stream.estimator
    estimate = estimator.estimate

    def telling(stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        known = estimate(stamp_ns, faults)
        return replace(known, disturbance=-0.7, disturbance_deviation=0.1)

    estimator.estimate = telling
    sensor.send(600)
    graph.wait_for(lambda: bool(sensor.disturbances))
    heard = sensor.disturbances[-1]
    assert (heard.wrench.force.x, heard.wrench.force.z) == (0.0, -0.7)
    assert heard.header.frame_id == 'cell'
    stamps = [messages.nanoseconds(one.header.stamp) for one in sensor.estimates]
    assert messages.nanoseconds(heard.header.stamp) in stamps


def test_who_comes_late_gets_the_newest_estimate(graph) -> None:
    sensor = Sensor(graph)
    sensor.send(1000)
    durable = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late = graph.heard(MuscleEstimate, 'estimate', durable)
    graph.wait_for(lambda: bool(late) and late[-1] == sensor.estimates[-1])


def test_a_torque_is_said_to_be_one(graph) -> None:
    sensor = Sensor(graph, 'torque')
    sensor.send(1000)
    assert {one.unit for one in sensor.estimates} == {'N m'}
    assert estimate_messages.estimate_of(sensor.estimates[-1]).unit == 'N m'
    assert np.isfinite(sensor.estimates[-1].linear).all()
    assert sensor.estimates[-1].samples > 500
