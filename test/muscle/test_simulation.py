# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated session: samples of the muscle and its surroundings, and the true state."""

import numpy as np
import pytest

from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.muscle.scenario import Scenario, VoluntaryEffort
from rpms_ros.muscle.sensor import Disturbances, SensorFault
from rpms_ros.muscle.simulation import Surroundings, simulate_session
from rpms_ros.muscle.time_varying import Change, LivingSettings, muscle_of
from rpms_ros.pulses import PulseTrain

START_NS = 1_700_000_000_000_000_000
SECONDS = 4
STAMP_NS = START_NS + 1_000_000 * np.arange(1000 * SECONDS, dtype=np.int64)
PULSES = PulseTrain.regular(np.linspace(0.2, 1.0, 20 * SECONDS), 20.0, START_NS)
SCENARIO = Scenario(
    living=LivingSettings(changes=(Change(2.0, gain=0.5, threshold=0.55),)),
    efforts=(VoluntaryEffort(at=1.0, duration=1.0, peak=2.0),),
    disturbances=Disturbances(noise=0.02, artifact=0.5),
    sensor_faults=(SensorFault('lost', 3.0, 0.1), SensorFault('frozen', 3.5, 0.2)),
)


def session(scenario: Scenario, truth_rate: float = 0.0):
    muscle = muscle_of(simulation_subject(), scenario.living, 20.0)
    return simulate_session(muscle, Surroundings(scenario, 1), PULSES, STAMP_NS, truth_rate)


def test_a_steady_session_is_the_contraction() -> None:
    steady = Contraction(simulation_subject(), 20.0)
    steady.add_pulses(PULSES.onset_ns, PULSES.intensity)
    trace, truths = session(Scenario())
    np.testing.assert_array_equal(trace.force, steady.force(STAMP_NS))
    assert not truths


def test_noting_the_truth_changes_no_bit() -> None:
    alone, _ = session(SCENARIO)
    beside, truths = session(SCENARIO, truth_rate=10.0)
    np.testing.assert_array_equal(alone.stamp_ns, beside.stamp_ns)
    np.testing.assert_array_equal(alone.force, beside.force)
    assert len(truths) == 10 * SECONDS


def test_the_truth_tells_what_happened() -> None:
    _, truths = session(SCENARIO, truth_rate=10.0)
    at = {round((truth.stamp_ns - START_NS) / 1e9, 1): truth for truth in truths}
    assert (at[1.5].state.gain, at[1.5].state.threshold) == (1.0, 0.48)
    assert (at[2.5].state.gain, at[2.5].state.threshold) == (0.5, 0.55)
    # the peak of the effort lies 1 ms after this truth
    assert at[1.5].effort == pytest.approx(2.0, rel=1e-4)
    assert at[2.5].effort == 0.0
    assert at[1.5].curve_force[-1] == pytest.approx(10.0)
