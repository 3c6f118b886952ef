# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The twitch and the sum of many."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad

from rpms_ros.muscle import steady_mean, twitch, twitch_area

time_constants = st.floats(5e-3, 0.2)
orders = st.floats(1.0, 6.0)


@given(time_constants, st.floats(1.01, 6.0))
def test_the_peak_is_one_and_lies_after_n_minus_1_time_constants(
    time_constant: float, order: float
) -> None:
    peak_time = (order - 1.0) * time_constant
    # Rounding in exponent and power.
    assert twitch(peak_time, time_constant, order) == pytest.approx(1.0, rel=1e-13)
    around = twitch(peak_time * np.linspace(0.0, 5.0, 1001), time_constant, order)
    assert around.max() <= 1.0 + 1e-13


@given(time_constants, orders)
def test_area_is_the_integral(time_constant: float, order: float) -> None:
    integral = quad(
        lambda scaled: float(twitch(scaled * time_constant, time_constant, order)),
        0.0,
        60.0,
        epsabs=1e-12,
        epsrel=1e-12,
        limit=200,
    )[0]
    # The quadrature meets a root singularity at 0 if the order is not whole.
    area = twitch_area(time_constant, order)
    assert area == pytest.approx(integral * time_constant, rel=1e-7)
    assert steady_mean(20.0, time_constant, order) == 20.0 * area
    # rounding
    assert twitch_area(time_constant) == pytest.approx(time_constant * math.e**2 / 2, rel=1e-14)
