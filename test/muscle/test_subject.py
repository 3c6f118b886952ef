# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Presets, random subjects, and what one pulse adds to the force."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.muscle import (
    SUBJECTS,
    Modality,
    RecruitmentParameters,
    average_subject,
    identified_recruitment,
    random_subject,
    simulation_subject,
    steady_mean,
    subject_by_name,
)

EVERY_INTENSITY = np.linspace(0.0, 1.0, 101)


@pytest.mark.parametrize(
    ('name', 'time_constant', 'latency'),
    [('rpms', 38.44e-3, 9.45e-3), ('fes', 36.62e-3, 24.4e-3), ('simulation', 38.44e-3, 0.0)],
)
def test_presets(name: str, time_constant: float, latency: float) -> None:
    subject = subject_by_name(name)
    assert subject.time_constant == time_constant
    assert subject.latency == latency
    assert subject.order == 3
    assert subject_by_name(name) == subject


def test_the_simulation_is_a_plant_of_the_identified_form() -> None:
    theta = RecruitmentParameters(0.48, 0.98, 4.0, 6.0)
    form = identified_recruitment(theta, EVERY_INTENSITY)
    # Two ways to compute one curve: rounding only.
    np.testing.assert_allclose(
        simulation_subject().recruitment(EVERY_INTENSITY), form / form[-1], atol=1e-14
    )


@pytest.mark.parametrize('name', list(SUBJECTS))
def test_full_intensity_gives_the_maximum_force(name: str) -> None:
    # rho_u(1) is 0.9997 with Table 3; the others are exact.
    assert subject_by_name(name).steady_force(1.0, 20.0) == pytest.approx(10.0, rel=3e-4)


@given(st.floats(0.0, 1.0), st.floats(15.0, 100.0))
def test_a_pulse_weighs_what_eq_11_says(intensity: float, rate_hz: float) -> None:
    subject = average_subject()
    share = subject.recruitment(intensity) * subject.rate_recruitment(rate_hz)
    expected = share * 10.0 / subject.rate_recruitment(20.0) / steady_mean(rate_hz, 38.44e-3)
    # Products in another order.
    assert subject.pulse_weight(intensity, rate_hz) == pytest.approx(expected, rel=1e-13)


@given(st.floats(0.0, 15.0))
def test_slow_pulses_weigh_all_the_same(rate_hz: float) -> None:
    subject = average_subject()
    assert subject.pulse_weight(0.8, rate_hz) == subject.pulse_weight(0.8, 15.0)
    # Then the mean force is proportional to the rate; products in another order.
    assert subject.steady_force(0.8, rate_hz) == pytest.approx(
        float(subject.steady_force(0.8, 15.0)) * rate_hz / 15.0, rel=1e-13
    )


@pytest.mark.parametrize(
    ('modality', 'latency', 'time_constant'),
    [
        (Modality.MAGNETIC, (6.28e-3, 14.63e-3), (26.71e-3, 49.81e-3)),
        (Modality.ELECTRICAL, (20.83e-3, 28.24e-3), (22.58e-3, 53.22e-3)),
    ],
)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_subjects_stay_within_the_tables(
    seed: int,
    modality: Modality,
    latency: tuple[float, float],
    time_constant: tuple[float, float],
) -> None:
    subject = random_subject(np.random.default_rng(seed), modality)
    assert latency[0] <= subject.latency <= latency[1]
    assert time_constant[0] <= subject.time_constant <= time_constant[1]
    assert 0.45 <= subject.recruitment.threshold <= 0.70
    assert 0.80 <= subject.recruitment.saturation <= 1.00
    assert 4.5 <= subject.recruitment.threshold_slope <= 7.0
    assert 3.5 <= subject.recruitment.saturation_slope <= 17.0
    assert 5.0 <= subject.maximum_force <= 50.0
