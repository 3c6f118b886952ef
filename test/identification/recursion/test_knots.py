# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recruitment between knots."""

import numpy as np
import pytest

from rpms_ros.identification.recursion.people_kernel import (
    KNOTS,
    interpolate,
    recruitment_at_knots,
)
from rpms_ros.muscle import random_subject
from rpms_ros.muscle.recruitment import (
    RecruitmentParameters,
    identified_recruitment,
    identified_recruitment_with_gradient,
)

INTENSITY = np.linspace(0.0, 1.0, 301)


def weights() -> np.ndarray:
    rows = np.empty((len(INTENSITY), KNOTS))
    for row, intensity in zip(rows, INTENSITY, strict=True):
        interpolate(intensity, row)
    return rows


def test_cubics_through_zero_are_met_exactly() -> None:
    knots = np.arange(1, KNOTS + 1) / KNOTS
    cubic = knots - 3.0 * knots**2 + 1.7 * knots**3
    expected = INTENSITY - 3.0 * INTENSITY**2 + 1.7 * INTENSITY**3
    # Rounding.
    np.testing.assert_allclose(weights() @ cubic, expected, atol=1e-13)


def test_intensities_beyond_the_range_count_as_its_ends() -> None:
    beyond, end = np.empty(KNOTS), np.empty(KNOTS)
    interpolate(1.3, beyond)
    interpolate(1.0, end)
    np.testing.assert_array_equal(beyond, end)
    interpolate(-0.2, beyond)
    np.testing.assert_array_equal(beyond, 0.0)


def test_curves_of_people_are_met() -> None:
    rows = weights()
    errors = []
    for seed in range(200):
        shape = random_subject(np.random.default_rng(seed)).recruitment
        theta = np.array(
            [shape.threshold, shape.saturation, shape.saturation_slope, shape.threshold_slope]
        )
        values = np.empty((5, KNOTS))
        recruitment_at_knots(theta, values)
        curve = identified_recruitment(RecruitmentParameters(*theta), INTENSITY)
        errors.append(np.abs(rows @ values[0] - curve).max() / curve.max())
    # As the module says.
    assert max(errors) < 2.5e-3
    assert np.median(errors) < 4e-4


@pytest.mark.parametrize('theta', [(0.48, 0.98, 4.0, 6.0), (0.6, 0.8, 15.0, 4.0)])
def test_values_at_knots_are_those_of_the_curve(theta: tuple[float, ...]) -> None:
    values = np.empty((5, KNOTS))
    recruitment_at_knots(np.array(theta), values)
    knots = np.arange(1, KNOTS + 1) / KNOTS
    rho, slopes = identified_recruitment_with_gradient(RecruitmentParameters(*theta), knots)
    # Rounding.
    np.testing.assert_allclose(values[0], rho, atol=1e-14)
    by_logarithm = slopes * np.array([1.0, 1.0, theta[2], theta[3]])
    np.testing.assert_allclose(values[1:].T, by_logarithm, atol=1e-13)
