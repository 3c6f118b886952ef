# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Eq. (30) and its derivatives."""

import numpy as np
from hypothesis import given, strategies as st

from rpms_ros.muscle import (
    IntensityRecruitment,
    RecruitmentParameters,
    identified_recruitment,
    identified_recruitment_with_gradient,
)

EVERY_INTENSITY = np.linspace(0.0, 1.0, 101)

parameters = st.builds(
    RecruitmentParameters,
    u_thr=st.floats(0.0, 1.0),
    u_sat=st.floats(0.05, 1.5),
    alpha_sat=st.floats(0.5, 50.0),
    alpha_thr=st.floats(0.5, 50.0),
)


@given(parameters)
def test_derivatives_agree_with_central_differences(theta: RecruitmentParameters) -> None:
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
def test_no_intensity_recruits_nothing(theta: RecruitmentParameters) -> None:
    rho, gradient = identified_recruitment_with_gradient(theta, 0.0)
    assert rho == 0.0
    np.testing.assert_array_equal(gradient, 0.0)


@given(st.floats(0.0, 0.7), st.floats(0.75, 1.5), st.floats(0.5, 50.0), st.floats(0.5, 50.0))
def test_it_is_the_recruitment_by_intensity_less_its_value_at_zero(
    u_thr: float, u_sat: float, alpha_sat: float, alpha_thr: float
) -> None:
    curve = IntensityRecruitment(u_thr, u_sat, alpha_thr, alpha_sat, gain=1.0, offset=0.0)
    theta = RecruitmentParameters(u_thr, u_sat, alpha_sat, alpha_thr)
    # The same formula, written twice.
    np.testing.assert_allclose(
        identified_recruitment(theta, EVERY_INTENSITY),
        curve(EVERY_INTENSITY) - curve(0.0),
        rtol=0.0,
        atol=1e-14,
    )
