# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recruitment: Table 3, its limits, the weight of a pulse; Eq. (30) and its derivatives."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.muscle import (
    IntensityRecruitment,
    RateRecruitment,
    RecruitmentParameters,
    identified_recruitment,
    identified_recruitment_with_gradient,
)

EVERY_INTENSITY = np.linspace(0.0, 1.0, 1001)

shapes = st.builds(
    IntensityRecruitment,
    threshold=st.floats(0.05, 0.7),
    saturation=st.floats(0.75, 1.2),
    threshold_slope=st.floats(1.0, 10.0),
    saturation_slope=st.floats(3.0, 50.0),
)


def test_table_3_by_rate():
    # Four digits, as the expected values are given.
    expected = [-0.0004, 0.7849, 0.9990, 1.3819]
    np.testing.assert_allclose(RateRecruitment()([0.0, 15.0, 20.0, 35.0]), expected, atol=5e-5)


@given(shapes)
def test_the_ends_tell_whether_a_curve_rises(shape):
    steps = np.diff(shape(EVERY_INTENSITY))
    if shape.rises:
        # Rounding of values of size 1 where the curve is flat.
        assert (steps >= -1e-14).all()
    # The slope has one change of sign at most, in its first or its last part.
    falls = np.flatnonzero(steps < -1e-14)
    if len(falls):
        assert not shape.rises
        assert 0 in falls or len(steps) - 1 in falls


@given(shapes, st.floats(0.0, 1.0))
def test_normalising_fixes_both_ends_and_keeps_the_shape(shape, intensity):
    unit = shape.normalised()
    assert unit(0.0) == 0.0
    # One subtraction of numbers of which the larger is a few times their difference.
    assert unit(1.0) == pytest.approx(1.0, rel=1e-12)
    low, value, high = shape([0.0, intensity, 1.0])
    assert unit(intensity) == pytest.approx((value - low) / (high - low), rel=1e-10, abs=1e-12)


def test_a_pulse_weighs_no_more_below_the_lowest_measured_rate():
    rates = np.array([0.0, 1e-9, 1.0, 14.999, 15.0])
    weights = RateRecruitment().per_pulse(rates)
    np.testing.assert_array_equal(weights, weights[-1])
    assert weights[-1] == RateRecruitment()(15.0) / 15.0


parameters = st.builds(
    RecruitmentParameters,
    u_thr=st.floats(0.0, 1.0),
    u_sat=st.floats(0.05, 1.5),
    alpha_sat=st.floats(0.5, 50.0),
    alpha_thr=st.floats(0.5, 50.0),
)


@given(parameters)
def test_derivatives_agree_with_central_differences(theta):
    _, gradient = identified_recruitment_with_gradient(theta, EVERY_INTENSITY)
    for place, value in enumerate(theta):
        step = 1e-5
        above = list(theta)
        below = list(theta)
        above[place] = value + step
        below[place] = value - step
        difference = identified_recruitment(
            RecruitmentParameters(*above), EVERY_INTENSITY
        ) - identified_recruitment(RecruitmentParameters(*below), EVERY_INTENSITY)
        # Third derivatives reach 4 alpha^2 = 1e4, times step^2 / 6; rounding is 1e-16 / step.
        np.testing.assert_allclose(
            gradient[:, place], difference / (2.0 * step), rtol=0.0, atol=1e-6
        )


@given(parameters)
def test_no_intensity_recruits_nothing(theta):
    rho, gradient = identified_recruitment_with_gradient(theta, 0.0)
    assert rho == 0.0
    np.testing.assert_array_equal(gradient, 0.0)


@given(st.floats(0.0, 0.7), st.floats(0.75, 1.5), st.floats(0.5, 50.0), st.floats(0.5, 50.0))
def test_it_is_the_recruitment_by_intensity_less_its_value_at_zero(
    u_thr, u_sat, alpha_sat, alpha_thr
):
    curve = IntensityRecruitment(u_thr, u_sat, alpha_thr, alpha_sat, gain=1.0, offset=0.0)
    theta = RecruitmentParameters(u_thr, u_sat, alpha_sat, alpha_thr)
    # The same formula, written twice.
    np.testing.assert_allclose(
        identified_recruitment(theta, EVERY_INTENSITY),
        curve(EVERY_INTENSITY) - curve(0.0),
        rtol=0.0,
        atol=1e-14,
    )
