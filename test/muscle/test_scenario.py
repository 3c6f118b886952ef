# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenario files and what is refused in them; a simulated session and its true state."""

import re

import numpy as np
import pytest

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.muscle.scenario import (
    Scenario,
    Tremor,
    VoluntaryEffort,
    load_scenario,
    scenario_from_text,
    scenario_names,
)
from rpms_ros.muscle.sensor import Disturbances, SensorFault
from rpms_ros.muscle.simulation import Surroundings, simulate_session
from rpms_ros.muscle.time_varying import Change, Fatigue, LivingSettings, muscle_of
from rpms_ros.pulses import PulseTrain

TEXT = """\
name: example
description: everything once
fatigue: {force_loss: 0.02, slowing: 0.01}
potentiation: {largest: 0.1}
changes:
  - {at: 40, over: 2, gain: 0.8, threshold: 0.56}
efforts:
  - {kind: voluntary, at: 8.0, duration: 1.5, peak: 2.0, every: 12.0}
  - {kind: tremor, amplitude: 0.3, duration: null}
disturbances: {noise: 0.05}
sensor_faults:
  - {fault: clipped, at: 1.0, duration: 2.0, value: 6.0}
"""
NEEDED = """\
changes:
  - {at: 1.0, gain: 0.5}
efforts:
  - {kind: voluntary, at: 1.0, duration: 1.0, peak: 1.0}
  - {kind: spasm, at: 1.0, peak: 1.0}
  - {kind: tremor, amplitude: 1.0}
  - {kind: bump, at: 1.0, peak: 1.0}
sensor_faults:
  - {fault: lost, at: 1.0, duration: 1.0}
"""


def test_a_scenario_is_what_its_file_says():
    scenario = scenario_from_text(TEXT)
    assert scenario.name == 'example'
    assert scenario.living.fatigue == Fatigue(0.02, 0.01)
    assert scenario.living.potentiation.largest == 0.1
    assert scenario.living.changes == (Change(40.0, 2.0, gain=0.8, threshold=0.56),)
    assert scenario.efforts == (
        VoluntaryEffort(at=8.0, duration=1.5, peak=2.0, every=12.0),
        Tremor(0.3),
    )
    assert scenario.disturbances.noise == 0.05
    assert scenario.sensor_faults == (SensorFault('clipped', 1.0, 2.0, 6.0),)


def test_what_is_needed_is_enough():
    """As docs/scenarios.md states it."""
    scenario = scenario_from_text(NEEDED)
    assert len(scenario.efforts) == 4
    for line in NEEDED.splitlines():
        for key in re.findall(r'(\w+): [\w.]+[,}]', line):
            short = NEEDED.replace(
                line, re.sub(rf'{key}: [\w.]+(, )?', '', line).replace(', }', '}')
            )
            with pytest.raises(MuscleError, match='expected'):
                scenario_from_text(short)


def test_the_scenarios_of_the_package_can_be_loaded():
    assert scenario_names() == (
        'bad-sensor', 'coil-moved', 'fatigue', 'restless', 'steady', 'voluntary',
    )  # fmt: skip
    for name in scenario_names():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.description


@pytest.mark.parametrize(
    ('before', 'after', 'fault'),
    [
        (
            'name: example',
            'names: example',
            r'line 1, names: expected a key of name, .* got .names.',
        ),
        ('0.02', '-1', r'line 3, fatigue: expected a finite force_loss of at least 0, got -1'),
        ('0.02', 'yes', r'line 3, fatigue.force_loss: expected a number, got .yes.'),
        ('0.02', 'true', r'line 3, fatigue.force_loss: expected a number, got True'),
        ('0.02', '010', r'line 3, fatigue.force_loss: .*leading zeros'),
        ('at: 40, ', '', r'line 6, changes\[0\]: expected the key at, got over, gain, threshold'),
        ('voluntary', 'dance', r'line 8, efforts\[0\].kind: expected a kind of .* got .dance.'),
        ('kind: tremor, ', '', r'line 9, efforts\[1\]: expected a kind of .*, got None'),
        (
            'threshold: 0.56',
            'threshold: 0.56, saturation: 0.3',
            r'line 6, changes\[0\]: expected a saturation .*, got 0.3 and 0.56 at 42 s',
        ),
        ('clipped', '7', r'line 12, sensor_faults\[0\].fault: expected a text, got 7'),
        ('{noise: 0.05}', '[1]', r'line 10, disturbances: expected keys and values, got \[1\]'),
        ('name: example', 'name: example\nname: x', r'line 2, name: expected the key once'),
    ],
)
def test_faults_are_named_by_line_and_key(before, after, fault):
    with pytest.raises(MuscleError, match=fault):
        scenario_from_text(TEXT.replace(before, after, 1))


def test_faults_name_the_file(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('fatigue: 3')
    with pytest.raises(MuscleError, match=r'mine.yaml: line 1, fatigue: expected keys and values'):
        load_scenario(str(path))
    with pytest.raises(MuscleError, match=r'expected a scenario of bad-sensor, .*, got .nowhere.'):
        load_scenario('nowhere')


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


def session(scenario, truth_rate=0.0):
    muscle = muscle_of(simulation_subject(), scenario.living, 20.0)
    return simulate_session(muscle, Surroundings(scenario, 1), PULSES, STAMP_NS, truth_rate)


def test_a_steady_session_is_the_contraction():
    steady = Contraction(simulation_subject(), 20.0)
    steady.add_pulses(PULSES.onset_ns, PULSES.intensity)
    trace, truths = session(Scenario())
    np.testing.assert_array_equal(trace.force, steady.force(STAMP_NS))
    assert not truths


def test_noting_the_truth_changes_no_bit():
    alone, _ = session(SCENARIO)
    beside, truths = session(SCENARIO, truth_rate=10.0)
    np.testing.assert_array_equal(alone.stamp_ns, beside.stamp_ns)
    np.testing.assert_array_equal(alone.force, beside.force)
    assert len(truths) == 10 * SECONDS


def test_the_truth_tells_what_happened():
    _, truths = session(SCENARIO, truth_rate=10.0)
    at = {round((truth.stamp_ns - START_NS) / 1e9, 1): truth for truth in truths}
    assert (at[1.5].state.gain, at[1.5].state.threshold) == (1.0, 0.48)
    assert (at[2.5].state.gain, at[2.5].state.threshold) == (0.5, 0.55)
    # the peak of the effort lies 1 ms after this truth
    assert at[1.5].effort == pytest.approx(2.0, rel=1e-4)
    assert at[2.5].effort == 0.0
    assert at[1.5].curve_force[-1] == pytest.approx(10.0)
