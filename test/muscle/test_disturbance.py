# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor adds, its faults, efforts, scenario files, and a simulated session."""

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import Contraction, Disturbances, Sensor, simulation_subject
from rpms_ros.muscle.scenario import (
    Scenario,
    Spasm,
    Tremor,
    VoluntaryEffort,
    load_scenario,
    scenario_from_text,
    scenario_names,
)
from rpms_ros.muscle.sensor import KINDS, FaultySensor, SensorFault
from rpms_ros.muscle.simulation import SampledPlant, Surroundings, simulate_session
from rpms_ros.muscle.time_varying import Change, Fatigue, LivingSettings
from rpms_ros.pulses import Pulse, PulseTrain

SAMPLES = 2000
STAMP_NS = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(SAMPLES, dtype=np.int64)
FORCE = np.sin(np.arange(SAMPLES) / 100.0)
ONSET_NS = STAMP_NS[0] + 300_000 + 50_000_000 * np.arange(40, dtype=np.int64)
INTENSITY = np.linspace(0.0, 1.0, 40)

EVERYTHING = Disturbances(
    noise=0.1, offset=0.2, drift=0.5, drift_period=3.0, artifact=2.0, saturation=1.5
)


def measured(disturbances, seed=0):
    return Sensor(disturbances, seed).measure(STAMP_NS, FORCE, ONSET_NS, INTENSITY)


@given(st.lists(st.integers(0, SAMPLES), max_size=6))
def test_block_length_changes_no_bit(cuts):
    sensor = Sensor(EVERYTHING, seed=7)
    edges = [0, *sorted(cuts), SAMPLES]
    pieces = [
        sensor.measure(STAMP_NS[low:high], FORCE[low:high], ONSET_NS, INTENSITY)
        for low, high in pairwise(edges)
    ]
    np.testing.assert_array_equal(np.concatenate(pieces), measured(EVERYTHING, seed=7))


def test_noise_is_white_and_has_its_size():
    stamp_ns = np.arange(100_000, dtype=np.int64)
    sensor = Sensor(Disturbances(noise=0.3), seed=5)
    noise = sensor.measure(stamp_ns, np.zeros(len(stamp_ns)), STAMP_NS[:0], FORCE[:0])
    # Five standard errors of the estimates, 1/sqrt(2 n), 1/sqrt(n) and 1/sqrt(n).
    assert noise.std() == pytest.approx(0.3, rel=5 / np.sqrt(2 * len(noise)))
    assert abs(noise.mean()) < 5 * 0.3 / np.sqrt(len(noise))
    assert abs(np.mean(noise[1:] * noise[:-1])) < 5 * 0.09 / np.sqrt(len(noise))


def test_drift_is_a_sine_that_begins_with_the_first_sample():
    drift = measured(Disturbances(drift=0.5, drift_period=2.0)) - FORCE
    # A difference of numbers of size 1.
    sine = np.sin(np.pi * np.arange(SAMPLES) / 1000.0)
    np.testing.assert_allclose(drift, 0.5 * sine, atol=1e-14)


def test_artifact_follows_its_pulse_and_grows_with_the_intensity():
    settings = Disturbances(artifact=2.0, artifact_decay=0.5e-3)
    artifact = Sensor(settings).measure(STAMP_NS, np.zeros(SAMPLES), ONSET_NS, INTENSITY)
    assert artifact[0] == 0.0
    # The first sample after each pulse comes 0.7 ms later.
    np.testing.assert_allclose(artifact[1::50], 2.0 * INTENSITY * np.exp(-0.7 / 0.5), rtol=1e-12)
    np.testing.assert_allclose(artifact[2::50], artifact[1::50] * np.exp(-2.0), rtol=1e-12)


START_NS = 1_700_000_000_000_000_000
TIME = np.arange(30_000) / 1000.0
FAULTY_NS = START_NS + 1_000_000 * np.arange(3000, dtype=np.int64)
FAULTY = np.sin(np.arange(3000) / 100.0)


def test_a_voluntary_effort_repeats():
    force = VoluntaryEffort(at=3.0, duration=1.5, peak=2.0, every=12.0).force(TIME)
    assert not force[:3000].any()
    assert force[3750] == pytest.approx(2.0)
    assert not force[4500:15_000].any()
    # the same but for the rounding of the remainder
    np.testing.assert_allclose(force[15_000:16_500], force[3000:4500], atol=1e-12)


def test_a_spasm_rises_fast_and_decays():
    force = Spasm(1.0, 4.0, rise=0.2, decay=1.0).force(TIME)
    assert not force[:1000].any()
    assert force.max() == pytest.approx(4.0)
    assert np.argmax(force) == 1200
    assert force[2200] == pytest.approx(4.0 * np.exp(-1.0))


def test_a_tremor_has_its_frequency_and_ends():
    force = Tremor(0.3, 8.0, at=1.0, duration=2.0).force(TIME)
    assert force.max() == pytest.approx(0.3, rel=1e-3)
    assert not force[3000:].any()
    crossings = np.count_nonzero(np.diff(np.sign(force[1001:2999])) > 0)
    # 16 periods in two seconds
    assert crossings in (15, 16)


def shown(*faults):
    return FaultySensor(faults, START_NS)(FAULTY_NS, FAULTY)


def test_what_faulty_sensors_show():
    # a frozen one repeats its last value
    trace = shown(SensorFault('frozen', 1.0, 0.5))
    assert (trace.force[1000:1500] == FAULTY[999]).all()
    np.testing.assert_array_equal(trace.force[1500:], FAULTY[1500:])
    assert np.abs(shown(SensorFault('clipped', 0.0, 3.0, 0.4)).force).max() == 0.4
    np.testing.assert_array_equal(shown(SensorFault('scaled', 0.0, 3.0, -1.0)).force, -FAULTY)
    np.testing.assert_array_equal(shown(SensorFault('offset', 0.0, 3.0, 2.0)).force, FAULTY + 2.0)
    assert len(shown(SensorFault('lost', 1.0, 0.5)).stamp_ns) == 2500
    trace = shown(SensorFault('doubled', 1.0, 0.5))
    assert len(trace.stamp_ns) == 3500
    np.testing.assert_array_equal(trace.stamp_ns[1000:1004], FAULTY_NS[[1000, 1000, 1001, 1001]])


@settings(max_examples=50)
@given(st.lists(st.integers(0, 3000), max_size=6), st.sampled_from(KINDS))
def test_faults_do_not_depend_on_the_blocks(cuts, kind):
    faults = (SensorFault(kind, 0.7, 1.1, 0.3), SensorFault('frozen', 0.2, 0.1))
    whole = shown(*faults)
    sensor = FaultySensor(faults, START_NS)
    edges = [0, *sorted(cuts), 3000]
    parts = [sensor(FAULTY_NS[low:high], FAULTY[low:high]) for low, high in pairwise(edges)]
    stamps = np.concatenate([part.stamp_ns for part in parts])
    np.testing.assert_array_equal(stamps, whole.stamp_ns)
    np.testing.assert_array_equal(np.concatenate([part.force for part in parts]), whole.force)


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
            short = re.sub(rf'{key}: [\w.]+(, )?', '', line).replace(', }', '}')
            with pytest.raises(MuscleError, match='expected'):
                scenario_from_text(NEEDED.replace(line, short))


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
        ('name:', 'names:', r'line 1, names: expected a key of name, .* got .names.'),
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


SECONDS = 4
SESSION_NS = START_NS + 1_000_000 * np.arange(1000 * SECONDS, dtype=np.int64)
PULSES = PulseTrain.regular(np.linspace(0.2, 1.0, 20 * SECONDS), 20.0, START_NS)
SCENARIO = Scenario(
    living=LivingSettings(changes=(Change(2.0, gain=0.5, threshold=0.55),)),
    efforts=(VoluntaryEffort(at=1.0, duration=1.0, peak=2.0),),
    disturbances=Disturbances(noise=0.02, artifact=0.5),
    sensor_faults=(SensorFault('lost', 3.0, 0.1), SensorFault('frozen', 3.5, 0.2)),
)


def session(scenario, truth_rate=0.0):
    muscle = Contraction(simulation_subject(), 20.0, scenario.living)
    return simulate_session(muscle, Surroundings(scenario, 1), PULSES, SESSION_NS, truth_rate)


def test_a_steady_session_is_the_contraction():
    steady = Contraction(simulation_subject(), 20.0)
    steady.add_pulses(PULSES.onset_ns, PULSES.intensity)
    trace, truths = session(Scenario())
    np.testing.assert_array_equal(trace.force, steady.force(SESSION_NS))
    assert not truths


def test_the_truth_tells_what_happened_and_noting_it_changes_no_bit():
    alone, _ = session(SCENARIO)
    beside, truths = session(SCENARIO, truth_rate=10.0)
    np.testing.assert_array_equal(alone.stamp_ns, beside.stamp_ns)
    np.testing.assert_array_equal(alone.force, beside.force)
    assert len(truths) == 10 * SECONDS
    at = {round((truth.stamp_ns - START_NS) / 1e9, 1): truth for truth in truths}
    assert (at[1.5].state.gain, at[1.5].state.threshold) == (1.0, 0.48)
    assert (at[2.5].state.gain, at[2.5].state.threshold) == (0.5, 0.55)
    # the peak of the effort lies 1 ms after this truth
    assert at[1.5].effort == pytest.approx(2.0, rel=1e-4)
    assert at[2.5].effort == 0.0
    assert at[1.5].curve_force[-1] == pytest.approx(10.0)


@pytest.mark.parametrize(('latency', 'late_ms'), [(0.0, 5), (0.03, 40)])
def test_a_pulse_is_late_by_the_latency_of_now(latency, late_ms):
    """It was by that of the subject, whatever a scenario said."""
    scenario = scenario_from_text(f'changes:\n  - {{at: 0.0, latency: {latency}}}\n')
    muscle = Contraction(simulation_subject(), 20.0, scenario.living)
    plant = SampledPlant(muscle, Surroundings(scenario, 1), 1000.0)
    plant.begin(START_NS)
    plant.sample(1000)
    assert plant.add(Pulse(plant.newest_ns - (late_ms - 20) * 1_000_000, 1.0, 0)) is None
    assert plant.add(Pulse(plant.newest_ns - late_ms * 1_000_000, 1.0, 1)) == 'pulse_late'
