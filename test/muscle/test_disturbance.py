# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor adds, its faults, and force that the stimulation does not cause."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.muscle import Disturbances, Sensor
from rpms_ros.muscle.scenario import Spasm, Tremor, VoluntaryEffort
from rpms_ros.muscle.sensor import KINDS, FaultySensor, SensorFault
from rpms_ros.pulses import FloatArray, ForceTrace

SAMPLES = 2000
STAMP_NS = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(SAMPLES, dtype=np.int64)
FORCE = np.sin(np.arange(SAMPLES) / 100.0)
ONSET_NS = STAMP_NS[0] + 300_000 + 50_000_000 * np.arange(40, dtype=np.int64)
INTENSITY = np.linspace(0.0, 1.0, 40)
NO_PULSES = (np.empty(0, dtype=np.int64), np.empty(0))

EVERYTHING = Disturbances(
    noise=0.1, offset=0.2, drift=0.5, drift_period=3.0, artifact=2.0, saturation=1.5
)


def measured(disturbances, seed=0) -> FloatArray:
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
    noise = sensor.measure(stamp_ns, np.zeros(len(stamp_ns)), *NO_PULSES)
    # Five standard errors of the estimates, 1/sqrt(2 n), 1/sqrt(n) and 1/sqrt(n).
    assert noise.std() == pytest.approx(0.3, rel=5 / np.sqrt(2 * len(noise)))
    assert abs(noise.mean()) < 5 * 0.3 / np.sqrt(len(noise))
    assert abs(np.mean(noise[1:] * noise[:-1])) < 5 * 0.09 / np.sqrt(len(noise))


def test_drift_is_a_sine_that_begins_with_the_first_sample():
    drift = measured(Disturbances(drift=0.5, drift_period=2.0)) - FORCE
    # A difference of numbers of size 1.
    np.testing.assert_allclose(
        drift, 0.5 * np.sin(np.pi * np.arange(SAMPLES) / 1000.0), atol=1e-14
    )


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


def shown(*faults: SensorFault) -> ForceTrace:
    return FaultySensor(faults, START_NS)(FAULTY_NS, FAULTY)


def test_a_frozen_sensor_repeats_its_last_value():
    trace = shown(SensorFault('frozen', 1.0, 0.5))
    assert (trace.force[1000:1500] == FAULTY[999]).all()
    np.testing.assert_array_equal(trace.force[1500:], FAULTY[1500:])


def test_a_clipped_a_scaled_and_a_shifted_sensor():
    assert np.abs(shown(SensorFault('clipped', 0.0, 3.0, 0.4)).force).max() == 0.4
    np.testing.assert_array_equal(shown(SensorFault('scaled', 0.0, 3.0, -1.0)).force, -FAULTY)
    np.testing.assert_array_equal(shown(SensorFault('offset', 0.0, 3.0, 2.0)).force, FAULTY + 2.0)


def test_lost_and_doubled_samples():
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
