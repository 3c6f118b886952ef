# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The plant simulator on real rclpy: exact stamps, exact force, late and malformed pulses."""

import math
from itertools import count

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock

from rpms_msgs.msg import MuscleTruth, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.muscle import Contraction, average_subject
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.plant_simulator import PlantParameters, PlantSimulator, scenario_of
from rpms_ros.pulses import Pulse


class Laboratory:
    """A plant, somebody who listens to its force and somebody who sends it pulses."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        self.stamps = []
        self.forces = []
        probe = graph.node('probe')
        probe.create_subscription(WrenchStamped, 'force', self._on_force, qos.FORCE)
        self.plant = graph.add(PlantSimulator, minimum_subscribers=1, **parameters)
        self.pulses = graph.publisher(PulseMessage, 'pulses', qos.PULSES)

    def _on_force(self, message):
        stamp_ns, force = messages.force_of(message, messages.AXES['z'])
        self.stamps.append(stamp_ns)
        self.forces.append(force)

    def send(self, pulse):
        self.pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))

    def wait_for_samples(self, count):
        self.graph.wait_for(lambda: len(self.stamps) >= count)

    def wait_until(self, stamp_ns):
        self.graph.wait_for(lambda: bool(self.stamps) and self.stamps[-1] >= stamp_ns)


@pytest.fixture
def laboratory(graph):
    return Laboratory(graph, noise=0.0)


def test_the_force_is_that_of_the_contraction_bit_for_bit_on_an_exact_grid(laboratory):
    laboratory.wait_for_samples(1)
    # in the future, so that no sample is out before the pulse is known, on a busy machine either
    onset_ns = laboratory.stamps[-1] + 5_000_000_000
    laboratory.send(Pulse(onset_ns, 0.9))
    laboratory.wait_until(onset_ns + 300_000_000)
    assert laboratory.stamps[0] % 1_000_000 == 0
    assert set(np.diff(laboratory.stamps).tolist()) == {1_000_000}
    muscle = Contraction(average_subject())
    muscle.add_pulses(onset_ns, 0.9)
    expected = muscle.force(laboratory.stamps)
    assert max(laboratory.forces) > 1.0
    np.testing.assert_array_equal(laboratory.forces, expected)


def test_a_late_pulse_acts_exactly_on_the_samples_still_to_come(laboratory):
    laboratory.wait_for_samples(200)
    onset_ns = laboratory.stamps[0]
    laboratory.send(Pulse(onset_ns, 0.9))
    laboratory.graph.wait_for(lambda: laboratory.plant.plant.faults['pulse_late'] == 1)
    # what is on its way may be from before the pulse was known
    laboratory.wait_until(laboratory.plant.plant.newest_ns + 100_000_000)
    muscle = Contraction(average_subject())
    muscle.add_pulses(onset_ns, 0.9)
    expected = muscle.force(laboratory.stamps[-50:])
    assert laboratory.forces[0] == 0.0
    # the moments are moved on by other steps here: rounding only
    np.testing.assert_allclose(laboratory.forces[-50:], expected, rtol=1e-9)


def test_a_pulse_that_cannot_be_is_counted_and_has_no_effect(laboratory):
    laboratory.wait_for_samples(1)
    onset_ns, faults = laboratory.stamps[-1], laboratory.plant.plant.faults
    for intensity in (math.nan, 1.01, -0.01):
        laboratory.send(Pulse(onset_ns, intensity))
    for width in (math.nan, -1e-4):
        laboratory.send(Pulse(onset_ns, 0.5, width=width))
    laboratory.graph.wait_for(lambda: faults['pulse_width_out_of_range'] == 2)
    assert faults['pulse_intensity_out_of_range'] == 3
    laboratory.wait_for_samples(len(laboratory.stamps) + 100)
    assert not any(laboratory.forces)


def test_the_truth_of_a_scenario_is_published(graph, tmp_path):
    path = tmp_path / 'scenario.yaml'
    path.write_text('changes: [{at: 0.5, gain: 0.5, threshold: 0.6}]\n')
    laboratory = Laboratory(graph, scenario=str(path), subject='simulation')
    truths = graph.heard(MuscleTruth, 'truth', qos.TRUTH)
    graph.wait_for(lambda: bool(truths) and truths[-1].gain == 0.5)
    before, after = estimate_messages.truth_of(truths[0]), estimate_messages.truth_of(truths[-1])
    assert (before.state.gain, before.state.threshold) == (1.0, 0.48)
    assert (after.state.gain, after.state.threshold) == (0.5, 0.6)
    assert before.curve_force[-1] == pytest.approx(10.0)
    assert after.curve_force[-1] < 5.0
    laboratory.wait_until(after.stamp_ns)
    assert after.stamp_ns in laboratory.stamps


def test_a_simulated_sensor_has_the_noise_of_an_ordinary_one_at_rest_too(graph):
    laboratory = Laboratory(graph)
    laboratory.wait_for_samples(300)
    # 0.5 % of 10 N, five standard errors
    assert np.std(laboratory.forces) == pytest.approx(0.05, rel=0.2)


def test_it_begins_with_the_clock_of_a_simulation(graph):
    laboratory = Laboratory(graph, use_sim_time=True)
    clock = graph.publisher(Clock, '/clock')
    now_ns = count(1000 * 10**9, 10**7)

    def go_on():
        seconds, rest = divmod(next(now_ns), 10**9)
        clock.publish(Clock(clock=Time(sec=seconds, nanosec=rest)))

    ticks = graph.node('ticks').create_timer(0.01, go_on)
    laboratory.wait_for_samples(100)
    assert laboratory.stamps[0] >= 1000 * 10**9
    ticks.cancel()


def test_parameters_replace_the_disturbances_of_a_scenario():
    steady = {'scenario': 'steady'}
    for given, noise in (({'noise': 0.0}, 0.0), (steady, 0.05), ({**steady, 'noise': 0.2}, 0.2)):
        assert scenario_of(PlantParameters(**given)).disturbances.noise == noise
