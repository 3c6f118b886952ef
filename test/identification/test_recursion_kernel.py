# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The compiled recursion against its plain version; its regressors against direct sums."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification import (
    TABLE_4,
    TABLE_5,
    DistortedSineBasis,
    ModifiedRecursiveLM,
    RecruitmentBounds,
)
from rpms_ros.identification.recursion.paper_kernel import (
    basis_of_pulses,
    mix,
    regress,
    regress_with_gradient,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment


@pytest.mark.parametrize(
    'settings',
    [
        TABLE_4,
        TABLE_5,
        replace(TABLE_4, projected=False),
        replace(TABLE_4, force_scale=3.0, basis=DistortedSineBasis(functions=3)),
        # every sample meets the conditioning rule, and some steps the bounds
        replace(TABLE_4, condition_limit=1.5, bounds=RecruitmentBounds(u_thr=(0.39, 0.41))),
    ],
)
def test_it_is_the_plain_version(record, numpy_recursion, settings):
    pulses, forces = record(np.random.default_rng(7).uniform(size=16))
    plain = numpy_recursion.NumpyRecursion(settings, seed=1)
    expected = [
        plain.update(stamp, force, pulses.onset_ns, pulses.intensity)
        for stamp, force in zip(forces.stamp_ns.tolist(), forces.force.tolist(), strict=True)
    ]
    compiled = ModifiedRecursiveLM(settings, seed=1)
    compiled.add_pulses(pulses.onset_ns, pulses.intensity)
    usable = np.ones(len(forces), dtype=np.bool_)
    prediction = compiled.update(forces.stamp_ns, forces.force, usable)
    # Sums in another order; the first samples, with a covariance of 1e6 against residuals of
    # 1e-3, multiply epsilon by up to 1e9.  A wrong term shows in the first digit.
    np.testing.assert_allclose(prediction, expected, rtol=1e-6, atol=1e-6)
    state = compiled._state
    np.testing.assert_allclose(state.theta, plain.theta, rtol=1e-5)
    np.testing.assert_allclose(state.hessian, plain.hessian, rtol=1e-4, atol=1e-9)
    assert state.scalars['damping'][0] == pytest.approx(plain.damping, rel=1e-5)


BASIS = DistortedSineBasis()
SHAPE = np.array([1e6, 350.0, 120.0])
MILLISECOND = 1_000_000
PARAMETERS = RecruitmentParameters(0.45, 0.95, 4.0)


def sums(stamp_ns, onset_ns, intensity, theta):
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


@given(
    st.lists(st.integers(0, 400 * MILLISECOND), min_size=1, max_size=12, unique=True),
    st.integers(0, 500 * MILLISECOND),
)
def test_off_the_grid_it_is_the_direct_sum(onsets, stamp_ns):
    onset = np.sort(np.array(onsets))
    intensity = np.random.default_rng(len(onsets)).uniform(size=len(onset))
    phi, _, recruits = sums(stamp_ns, onset, intensity, np.array(PARAMETERS))
    rho = identified_recruitment(PARAMETERS, intensity)
    expected = rho @ BASIS.evaluate((stamp_ns - onset) / 1e9)
    # a tap of 350 resolves to 1e-13; at the jump at the end of the support either side is right
    if np.abs(stamp_ns - onset - 350.5 * MILLISECOND).min() > 1:
        np.testing.assert_allclose(phi, expected, atol=1e-11)
    assert recruits


def test_a_pulse_without_intensity_does_not_recruit():
    phi, gradient, recruits = sums(10_000_000, np.array([0]), np.zeros(1), np.array(PARAMETERS))
    assert not recruits
    np.testing.assert_array_equal(phi, 0.0)
    np.testing.assert_array_equal(gradient, 0.0)
