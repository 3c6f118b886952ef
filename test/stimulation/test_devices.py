# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The interface of a device, and the simulated one behind it."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.stimulation.devices import (
    SimulatedDevice,
    TooLate,
)
from rpms_ros.stimulation.devices.registry import quantized_down

WIDTH = 100e-6


@given(st.floats(0.0, 1.0), st.sampled_from([1, 3, 7, 100, 255]))
def test_a_quantized_intensity_is_the_largest_step_not_above(intensity, steps):
    found = quantized_down(intensity, steps)
    assert found in [step / steps for step in range(steps + 1)]
    assert found <= intensity
    assert quantized_down(np.array([intensity]), steps).tolist() == [found]
    assert found == 1.0 or round(found * steps + 1) / steps > intensity


def test_every_percent_stays_what_it_is():
    assert [quantized_down(percent / 100, 100) for percent in range(101)] == [
        percent / 100 for percent in range(101)
    ]
    assert quantized_down(0.455, 100) == 0.45
    assert quantized_down(0.555, 100) == 0.55


def ready(**options):
    now = [0]

    def wait(seconds):
        now[0] += round(seconds * 1e9)

    device = SimulatedDevice(clock=lambda: now[0], wait=wait, **options)
    device.open()
    device.arm()
    device.prepare(0.5)
    return device, now


def test_trigger_after_its_latest_time_is_not_given():
    device, now = ready()
    assert device.fire(0.5, WIDTH, now[0]) is not None
    with pytest.raises(TooLate, match='expected a trigger until -1 ns, got one at 0'):
        device.fire(0.5, WIDTH, now[0] - 1)
    assert len(device.fired) == 1
