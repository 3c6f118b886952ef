# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The compiled recursion against its plain version, and its rules one by one."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import (
    TABLE_4,
    TABLE_5,
    DistortedSineBasis,
    ModifiedRecursiveLM,
    RecruitmentBounds,
    RecursiveSettings,
)
from rpms_ros.identification.recursion.paper_kernel import _plain_derivative, mix
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
def test_it_is_the_plain_version(record, numpy_recursion, settings: RecursiveSettings) -> None:
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


def test_the_derivative_is_that_of_central_differences() -> None:
    generator = np.random.default_rng(3)
    basis = DistortedSineBasis()
    lags, intensity = generator.uniform(0.0, 0.35, 7), generator.uniform(size=7)
    linear = generator.normal(size=8)
    raw = np.linalg.solve(basis.mixing, basis.evaluate(lags).T).T
    theta = np.array([0.45, 0.95, 4.0, 6.0])

    def output(values: np.ndarray) -> float:
        rho = identified_recruitment(RecruitmentParameters(*values), intensity)
        phi = np.empty(8)
        mix(basis.mixing, rho @ raw, phi)
        return float(phi @ linear)

    def difference(place: int, values: np.ndarray) -> np.ndarray:
        step = np.zeros(4)
        step[place] = 1e-5
        above = identified_recruitment(RecruitmentParameters(*(values + step)), intensity)
        below = identified_recruitment(RecruitmentParameters(*(values - step)), intensity)
        return (above - below) @ raw / 2e-5

    gradient = np.array([difference(place, theta) for place in range(3)])
    derivative = np.empty(3)
    _plain_derivative(linear, basis.mixing, gradient, derivative)
    for place in range(3):
        step = np.zeros(4)
        step[place] = 1e-5
        expected = (output(theta + step) - output(theta - step)) / 2e-5
        # what epsilon becomes when it is divided by the step of 1e-5
        assert derivative[place] == pytest.approx(expected, rel=1e-7, abs=1e-8)
