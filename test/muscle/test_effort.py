# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force that the stimulation does not cause, and faults of the sensor."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.muscle.scenario import Spasm, Tremor, VoluntaryEffort
from rpms_ros.muscle.sensor import KINDS, FaultySensor, SensorFault
from rpms_ros.pulses import ForceTrace

START_NS = 1_700_000_000_000_000_000
TIME = np.arange(30_000) / 1000.0
STAMP_NS = START_NS + 1_000_000 * np.arange(3000, dtype=np.int64)
FORCE = np.sin(np.arange(3000) / 100.0)


def test_a_voluntary_effort_repeats() -> None:
    force = VoluntaryEffort(at=3.0, duration=1.5, peak=2.0, every=12.0).force(TIME)
    assert not force[:3000].any()
    assert force[3750] == pytest.approx(2.0)
    assert not force[4500:15_000].any()
    # the same but for the rounding of the remainder
    np.testing.assert_allclose(force[15_000:16_500], force[3000:4500], atol=1e-12)


def test_a_spasm_rises_fast_and_decays() -> None:
    force = Spasm(1.0, 4.0, rise=0.2, decay=1.0).force(TIME)
    assert not force[:1000].any()
    assert force.max() == pytest.approx(4.0)
    assert np.argmax(force) == 1200
    assert force[2200] == pytest.approx(4.0 * np.exp(-1.0))


def test_a_tremor_has_its_frequency_and_ends() -> None:
    force = Tremor(0.3, 8.0, at=1.0, duration=2.0).force(TIME)
    assert force.max() == pytest.approx(0.3, rel=1e-3)
    assert not force[3000:].any()
    crossings = np.count_nonzero(np.diff(np.sign(force[1001:2999])) > 0)
    # 16 periods in two seconds
    assert crossings in (15, 16)


def shown(*faults: SensorFault) -> ForceTrace:
    return FaultySensor(faults, START_NS)(STAMP_NS, FORCE)


def test_a_frozen_sensor_repeats_its_last_value() -> None:
    trace = shown(SensorFault('frozen', 1.0, 0.5))
    assert (trace.force[1000:1500] == FORCE[999]).all()
    np.testing.assert_array_equal(trace.force[1500:], FORCE[1500:])


def test_a_clipped_a_scaled_and_a_shifted_sensor() -> None:
    assert np.abs(shown(SensorFault('clipped', 0.0, 3.0, 0.4)).force).max() == 0.4
    np.testing.assert_array_equal(shown(SensorFault('scaled', 0.0, 3.0, -1.0)).force, -FORCE)
    np.testing.assert_array_equal(shown(SensorFault('offset', 0.0, 3.0, 2.0)).force, FORCE + 2.0)


def test_lost_and_doubled_samples() -> None:
    assert len(shown(SensorFault('lost', 1.0, 0.5)).stamp_ns) == 2500
    trace = shown(SensorFault('doubled', 1.0, 0.5))
    assert len(trace.stamp_ns) == 3500
    np.testing.assert_array_equal(trace.stamp_ns[1000:1004], STAMP_NS[[1000, 1000, 1001, 1001]])


@settings(max_examples=50)
@given(st.lists(st.integers(0, 3000), max_size=6), st.sampled_from(KINDS))
def test_block_length_changes_no_bit(cuts: list[int], kind: str) -> None:
    faults = (SensorFault(kind, 0.7, 1.1, 0.3), SensorFault('frozen', 0.2, 0.1))
    whole = shown(*faults)
    sensor = FaultySensor(faults, START_NS)
    edges = [0, *sorted(cuts), 3000]
    parts = [sensor(STAMP_NS[low:high], FORCE[low:high]) for low, high in pairwise(edges)]
    stamps = np.concatenate([part.stamp_ns for part in parts])
    np.testing.assert_array_equal(stamps, whole.stamp_ns)
    np.testing.assert_array_equal(np.concatenate([part.force for part in parts]), whole.force)
