# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recruitment by intensity and by rate: Table 3, its limits, and the weight of one pulse."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.muscle import IntensityRecruitment, RateRecruitment

EVERY_INTENSITY = np.linspace(0.0, 1.0, 1001)

shapes = st.builds(
    IntensityRecruitment,
    threshold=st.floats(0.05, 0.7),
    saturation=st.floats(0.75, 1.2),
    threshold_slope=st.floats(1.0, 10.0),
    saturation_slope=st.floats(3.0, 50.0),
)


def test_table_3_by_rate() -> None:
    # Four digits, as the expected values are given.
    expected = [-0.0004, 0.7849, 0.9990, 1.3819]
    np.testing.assert_allclose(RateRecruitment()([0.0, 15.0, 20.0, 35.0]), expected, atol=5e-5)


@given(shapes)
def test_the_ends_tell_whether_a_curve_rises(shape: IntensityRecruitment) -> None:
    steps = np.diff(shape(EVERY_INTENSITY))
    if shape.rises:
        # Rounding of values of size 1 where the curve is flat.
        assert (steps >= -1e-14).all()
    # The slope has one change of sign at most, in its first or its last part.
    falls = np.flatnonzero(steps < -1e-14)
    if len(falls):
        assert not shape.rises
        assert 0 in falls or len(steps) - 1 in falls


def test_a_curve_may_dip_below_zero_or_fall_towards_full_intensity() -> None:
    dipping = IntensityRecruitment(0.662, 0.874, 6.0, 3.8).normalised()
    falling = IntensityRecruitment(0.7, 0.8, 4.5, 17.0).normalised()
    assert not dipping.rises
    assert not falling.rises
    assert dipping(0.1) < 0.0
    assert falling(0.9) > 1.0


@given(shapes, st.floats(0.0, 1.0))
def test_normalising_fixes_both_ends_and_keeps_the_shape(
    shape: IntensityRecruitment, intensity: float
) -> None:
    unit = shape.normalised()
    assert unit(0.0) == 0.0
    # One subtraction of numbers of which the larger is a few times their difference.
    assert unit(1.0) == pytest.approx(1.0, rel=1e-12)
    low, value, high = shape([0.0, intensity, 1.0])
    assert unit(intensity) == pytest.approx((value - low) / (high - low), rel=1e-10, abs=1e-12)


def test_a_pulse_weighs_no_more_below_the_lowest_measured_rate() -> None:
    rates = np.array([0.0, 1e-9, 1.0, 14.999, 15.0])
    weights = RateRecruitment().per_pulse(rates)
    np.testing.assert_array_equal(weights, weights[-1])
    assert weights[-1] == RateRecruitment()(15.0) / 15.0
