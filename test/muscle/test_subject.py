# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subjects, what one pulse adds to the force, the twitch and the sum of many."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.muscle import (
    SUBJECTS,
    RecruitmentParameters,
    average_subject,
    identified_recruitment,
    simulation_subject,
    steady_mean,
    subject_by_name,
)

EVERY_INTENSITY = np.linspace(0.0, 1.0, 101)


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
