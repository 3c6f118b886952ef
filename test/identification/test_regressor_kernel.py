# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Regressors of Eqs. (15) and (16) against dense and direct sums."""

import numpy as np
from hypothesis import given, settings, strategies as st

from rpms_ros.identification import DistortedSineBasis
from rpms_ros.identification.recursion.paper_kernel import (
    basis_of_pulses,
    mix,
    regress,
    regress_with_gradient,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment

BASIS = DistortedSineBasis()
SHAPE = np.array([1e6, 350.0, 120.0])
MILLISECOND = 1_000_000
PARAMETERS = RecruitmentParameters(0.45, 0.95, 4.0)


def sums(stamp_ns: int, onset_ns: np.ndarray, intensity: np.ndarray, theta: np.ndarray):
    """Mixed regressor (8,) and raw gradient (3, 8), and whether any pulse recruits."""
    values = np.full((len(onset_ns), 8), np.nan)
    raw, gradient, phi = np.empty(8), np.empty((3, 8)), np.empty(8)
    basis_of_pulses(stamp_ns, onset_ns, 0, len(onset_ns), SHAPE, values)
    recruits = regress_with_gradient(
        intensity, 0, len(onset_ns), theta, values, raw, gradient, np.empty((2, 4))
    )
    again = np.empty(8)
    regress(intensity, 0, len(onset_ns), theta, values, again)
    np.testing.assert_array_equal(raw, again)
    mix(BASIS.mixing, raw, phi)
    return phi, gradient, recruits


def test_on_the_grid_it_is_the_dense_convolution() -> None:
    samples = 1200
    onset = np.arange(0, samples, 50)
    intensity = np.random.default_rng(1).uniform(size=len(onset))
    impulses = np.zeros(samples)
    impulses[onset] = identified_recruitment(PARAMETERS, intensity)
    response = BASIS.evaluate(1e-3 * np.arange(1, 351))
    for index in (1, 49, 50, 51, 350, 351, 777, 1199):
        past = impulses[max(index - 350, 0) : index][::-1]
        phi, _, _ = sums(index * MILLISECOND, onset * MILLISECOND, intensity, np.array(PARAMETERS))
        # seven pulses of size 0.1, mixing factors up to some ten
        np.testing.assert_allclose(phi, past @ response[: len(past)], atol=1e-12)


@settings(deadline=None)
@given(
    st.lists(st.integers(0, 400 * MILLISECOND), min_size=1, max_size=12, unique=True),
    st.integers(0, 500 * MILLISECOND),
)
def test_off_the_grid_it_is_the_direct_sum(onsets: list[int], stamp_ns: int) -> None:
    onset = np.sort(np.array(onsets))
    intensity = np.random.default_rng(len(onsets)).uniform(size=len(onset))
    phi, _, recruits = sums(stamp_ns, onset, intensity, np.array(PARAMETERS))
    rho = identified_recruitment(PARAMETERS, intensity)
    expected = rho @ BASIS.evaluate((stamp_ns - onset) / 1e9)
    # a tap of 350 resolves to 1e-13; at the jump at the end of the support either side is right
    if np.abs(stamp_ns - onset - 350.5 * MILLISECOND).min() > 1:
        np.testing.assert_allclose(phi, expected, atol=1e-11)
    assert recruits


def test_the_gradient_is_that_of_central_differences() -> None:
    generator = np.random.default_rng(2)
    onset = np.arange(7) * 50 * MILLISECOND
    intensity = generator.uniform(size=7)
    theta = np.array(PARAMETERS)
    _, gradient, _ = sums(310 * MILLISECOND, onset, intensity, theta)
    for place in range(3):
        step = np.zeros(4)
        step[place] = 1e-5
        above, _, _ = sums(310 * MILLISECOND, onset, intensity, theta + step)
        below, _, _ = sums(310 * MILLISECOND, onset, intensity, theta - step)
        expected = (above - below) / 2e-5
        # rounding 1e-16 / 1e-5, cut-off (1e-5)^2 times third derivatives of some hundred
        np.testing.assert_allclose(BASIS.mixing @ gradient[place], expected, atol=1e-7)


def test_a_pulse_without_intensity_does_not_recruit() -> None:
    phi, gradient, recruits = sums(10_000_000, np.array([0]), np.zeros(1), np.array(PARAMETERS))
    assert not recruits
    np.testing.assert_array_equal(phi, 0.0)
    np.testing.assert_array_equal(gradient, 0.0)
