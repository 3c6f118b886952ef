# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recruitment: its limits, Eq. (30) and its derivatives; subjects."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification.model.recruitment import recruitment_curve
from rpms_ros.muscle import (
    SUBJECTS,
    IntensityRecruitment,
    RateRecruitment,
    RecruitmentParameters,
    average_subject,
    identified_recruitment,
    simulation_subject,
    steady_mean,
    subject_by_name,
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


parameters = st.builds(
    RecruitmentParameters,
    u_thr=st.floats(0.0, 1.0),
    u_sat=st.floats(0.05, 1.5),
    alpha_sat=st.floats(0.5, 50.0),
    alpha_thr=st.floats(0.5, 50.0),
)


@given(parameters)
def test_derivatives_agree_with_central_differences(theta):
    _, gradient = recruitment_curve(EVERY_INTENSITY, np.array(theta))
    gradient[:, 2:] /= theta[2:]
    for place, value in enumerate(theta):
        step, name = 1e-5, theta._fields[place]
        above, below = (
            identified_recruitment(theta._replace(**{name: end}), EVERY_INTENSITY)
            for end in (value + step, value - step)
        )
        # Third derivatives reach 4 alpha^2 = 1e4, times step^2 / 6; rounding is 1e-16 / step.
        np.testing.assert_allclose(
            gradient[:, place], (above - below) / (2.0 * step), rtol=0.0, atol=1e-6
        )


@given(parameters)
def test_no_intensity_recruits_nothing(theta):
    rho, gradient = recruitment_curve(np.zeros(1), np.array(theta))
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


def test_the_simulation_is_a_plant_of_the_identified_form():
    theta = RecruitmentParameters(0.48, 0.98, 4.0, 6.0)
    form = identified_recruitment(theta, EVERY_INTENSITY)
    # Two ways to compute one curve: rounding only.
    np.testing.assert_allclose(
        simulation_subject().recruitment(EVERY_INTENSITY), form / form[-1], atol=1e-14
    )


@pytest.mark.parametrize('name', list(SUBJECTS))
def test_full_intensity_gives_the_maximum_force(name):
    # rho_u(1) is 0.9997 with Table 3; the others are exact.
    assert subject_by_name(name).steady_force(1.0, 20.0) == pytest.approx(10.0, rel=3e-4)


@given(st.floats(0.0, 1.0), st.floats(15.0, 100.0))
def test_a_pulse_weighs_what_eq_11_says(intensity, rate_hz):
    subject = average_subject()
    share = subject.recruitment(intensity) * subject.rate_recruitment(rate_hz)
    expected = share * 10.0 / subject.rate_recruitment(20.0) / steady_mean(rate_hz, 38.44e-3)
    # Products in another order.
    assert subject.pulse_weight(intensity, rate_hz) == pytest.approx(expected, rel=1e-13)


@given(st.floats(0.0, 15.0))
def test_slow_pulses_weigh_all_the_same(rate_hz):
    subject = average_subject()
    assert subject.pulse_weight(0.8, rate_hz) == subject.pulse_weight(0.8, 15.0)
    # Then the mean force is proportional to the rate; products in another order.
    assert subject.steady_force(0.8, rate_hz) == pytest.approx(
        float(subject.steady_force(0.8, 15.0)) * rate_hz / 15.0, rel=1e-13
    )
