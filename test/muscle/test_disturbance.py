# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor adds: reproducible, and the same in blocks of any length."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.muscle import Disturbances, Sensor
from rpms_ros.pulses import FloatArray

SAMPLES = 2000
STAMP_NS = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(SAMPLES, dtype=np.int64)
FORCE = np.sin(np.arange(SAMPLES) / 100.0)
ONSET_NS = STAMP_NS[0] + 300_000 + 50_000_000 * np.arange(40, dtype=np.int64)
INTENSITY = np.linspace(0.0, 1.0, 40)
NO_PULSES = (np.empty(0, dtype=np.int64), np.empty(0))

EVERYTHING = Disturbances(
    noise=0.1, offset=0.2, drift=0.5, drift_period=3.0, artifact=2.0, saturation=1.5
)


def measured(disturbances: Disturbances, seed: int = 0) -> FloatArray:
    return Sensor(disturbances, seed).measure(STAMP_NS, FORCE, ONSET_NS, INTENSITY)


@given(st.lists(st.integers(0, SAMPLES), max_size=6))
def test_block_length_changes_no_bit(cuts: list[int]) -> None:
    sensor = Sensor(EVERYTHING, seed=7)
    edges = [0, *sorted(cuts), SAMPLES]
    pieces = [
        sensor.measure(STAMP_NS[low:high], FORCE[low:high], ONSET_NS, INTENSITY)
        for low, high in pairwise(edges)
    ]
    np.testing.assert_array_equal(np.concatenate(pieces), measured(EVERYTHING, seed=7))


def test_noise_is_white_and_has_its_size() -> None:
    stamp_ns = np.arange(100_000, dtype=np.int64)
    sensor = Sensor(Disturbances(noise=0.3), seed=5)
    noise = sensor.measure(stamp_ns, np.zeros(len(stamp_ns)), *NO_PULSES)
    # Five standard errors of the estimates, 1/sqrt(2 n), 1/sqrt(n) and 1/sqrt(n).
    assert noise.std() == pytest.approx(0.3, rel=5 / np.sqrt(2 * len(noise)))
    assert abs(noise.mean()) < 5 * 0.3 / np.sqrt(len(noise))
    assert abs(np.mean(noise[1:] * noise[:-1])) < 5 * 0.09 / np.sqrt(len(noise))


def test_drift_is_a_sine_that_begins_with_the_first_sample() -> None:
    drift = measured(Disturbances(drift=0.5, drift_period=2.0)) - FORCE
    # A difference of numbers of size 1.
    np.testing.assert_allclose(
        drift, 0.5 * np.sin(np.pi * np.arange(SAMPLES) / 1000.0), atol=1e-14
    )


def test_artifact_follows_its_pulse_and_grows_with_the_intensity() -> None:
    settings = Disturbances(artifact=2.0, artifact_decay=0.5e-3)
    artifact = Sensor(settings).measure(STAMP_NS, np.zeros(SAMPLES), ONSET_NS, INTENSITY)
    assert artifact[0] == 0.0
    # The first sample after each pulse comes 0.7 ms later.
    np.testing.assert_allclose(artifact[1::50], 2.0 * INTENSITY * np.exp(-0.7 / 0.5), rtol=1e-12)
    np.testing.assert_allclose(artifact[2::50], artifact[1::50] * np.exp(-2.0), rtol=1e-12)
