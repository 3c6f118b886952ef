# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's recursion: against its plain version, and laws that hold whatever the data."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification import TABLE_4, TABLE_5, DistortedSineBasis, ModifiedRecursiveLM
from rpms_ros.identification.recursion.paper_kernel import (
    basis_of_pulses,
    mix,
    regress,
    regress_with_gradient,
    workspace,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment
from rpms_ros.pulses import FloatArray, ForceTrace, PulseTrain


def uniform(count, seed=7) -> FloatArray:
    return np.random.default_rng(seed).uniform(size=count)


def fed(pulses, forces, settings=TABLE_4, usable=True) -> tuple[ModifiedRecursiveLM, FloatArray]:
    estimator = ModifiedRecursiveLM(settings, seed=1)
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    flags = np.full(len(forces), usable)
    return estimator, estimator.update(forces.stamp_ns, forces.force, flags)


@pytest.mark.parametrize(
    'settings',
    [
        TABLE_4,
        TABLE_5,
        replace(TABLE_4, projected=False),
        replace(TABLE_4, force_scale=3.0, basis=DistortedSineBasis(functions=3)),
        # every sample meets the conditioning rule, and some steps the bounds
        replace(TABLE_4, condition_limit=1.5, start=RecruitmentParameters(0.001, 0.9, 3.0)),
    ],
)
def test_it_is_the_plain_version(record, numpy_recursion, settings):
    pulses, forces = record(uniform(16))
    plain = numpy_recursion.NumpyRecursion(settings, seed=1)
    expected = [
        plain.update(stamp, force, pulses.onset_ns, pulses.intensity)
        for stamp, force in zip(forces.stamp_ns.tolist(), forces.force.tolist(), strict=True)
    ]
    compiled, prediction = fed(pulses, forces, settings)
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
    work = workspace(8, len(onset_ns))
    work.basis[:] = np.nan
    basis_of_pulses(stamp_ns, onset_ns, SHAPE, work.basis)
    recruits = regress_with_gradient(intensity, theta, work)
    raw, phi = work.raw.copy(), np.empty(8)
    regress(intensity, theta, work)
    np.testing.assert_array_equal(raw, work.raw)
    mix(BASIS.mixing, raw, phi)
    return phi, work.raw_gradient, recruits


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


def state_bytes(estimator, without=()) -> bytes:
    scalars = estimator._state.scalars.copy()
    for name in without:
        scalars[name] = 0
    state = estimator._state._replace(scalars=scalars)
    return b''.join(array.tobytes() for array in state)


def test_scaling_the_force_moves_the_linear_parameters_alone(record):
    pulses, forces = record(uniform(60))
    one, prediction = fed(pulses, forces)
    # a power of two is exact, so that every bit can be asked for
    scaled = ForceTrace(forces.stamp_ns, 8.0 * forces.force)
    eight, louder = fed(pulses, scaled, replace(TABLE_4, force_scale=8.0))
    first, second = one.estimate(0, {}), eight.estimate(0, {})
    np.testing.assert_array_equal(second.nonlinear, first.nonlinear)
    np.testing.assert_array_equal(second.linear, 8.0 * first.linear)
    np.testing.assert_array_equal(louder, 8.0 * prediction)
    assert second.damping == first.damping
    assert second.output_error == first.output_error


def test_a_minute_of_silence_changes_nothing(record):
    pulses, forces = record(uniform(40))
    estimator, _ = fed(pulses, forces)
    tail = forces.stamp_ns[-1] + MILLISECOND * np.arange(1, 351)
    estimator.update(tail, np.zeros(350), np.zeros(350, dtype=np.bool_))
    decaying = ('error_energy', 'force_energy', 'previous_ns')
    before = state_bytes(estimator, without=decaying)
    silence = tail[-1] + MILLISECOND * np.arange(1, 60_001)
    prediction = estimator.update(silence, np.zeros(60_000), np.ones(60_000, dtype=np.bool_))
    np.testing.assert_array_equal(prediction, 0.0)
    # but for the output error, which decays to that of the silence
    scalars = estimator._state.scalars
    assert scalars['error_energy'][0] < 1e-20
    assert scalars['force_energy'][0] < 1e-20
    assert state_bytes(estimator, without=decaying) == before


def test_a_minute_of_zero_pulses_winds_nothing_up():
    pulses = PulseTrain.regular(np.zeros(1200), 20.0)
    stamps = MILLISECOND * np.arange(60_000, dtype=np.int64)
    estimator, _ = fed(pulses, ForceTrace(stamps, np.zeros(60_000)))
    assert estimator.estimate(0, {}).samples == 0
    fresh = ModifiedRecursiveLM(TABLE_4, seed=1)
    without = ('previous_ns',)
    assert state_bytes(estimator, without) == state_bytes(fresh, without)


def test_a_minute_below_the_threshold_keeps_the_covariance_positive(recorded):
    take = recorded(70.0, np.concatenate((0.1 * uniform(1200), uniform(200, 8))))
    take.force[:] += np.random.default_rng(1).normal(0.0, 0.05, len(take.force))
    estimator = ModifiedRecursiveLM(TABLE_4, seed=1)
    take.feed(estimator, last_s=60.0)
    # the pause of forgetting is checked before a sample, which adds one percent at most
    assert estimator._state.covariance.max() < 1.02e10
    prediction = take.feed(estimator, first_s=60.0)
    assert np.linalg.eigvalsh(estimator._state.covariance).min() > 0.0
    rest = take.force[65_000:]
    error = np.linalg.norm(rest - prediction[5_000:]) / np.linalg.norm(rest)
    # noise of 0.05 N in some 3.5 N, and what it does to eight parameters that forget in 0.1 s;
    # by the rounding of the force it is 0.016 or twice as much
    assert error < 0.04


def test_a_jump_back_leaves_the_output_error_finite(record):
    pulses, forces = record(uniform(40), start_ns=3_600_000_000_000)
    estimator, _ = fed(pulses, forces)
    estimator.forget_pulses()
    pulses, forces = record(uniform(40))
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    estimator.update(forces.stamp_ns, forces.force, np.ones(len(forces), dtype=np.bool_))
    found = estimator.estimate(0, {})
    assert math.isfinite(found.output_error)
    # half of the memory of the first second has seen it learn
    assert 0.0 < found.output_error < 0.1


def test_what_is_not_usable_is_predicted_only(record):
    estimator, _ = fed(*record(uniform(40)), usable=False)
    assert state_bytes(estimator) == state_bytes(ModifiedRecursiveLM(TABLE_4, seed=1))


def test_a_matrix_without_a_factor_is_counted_and_published(recorded):
    take, estimator = recorded(1.5), ModifiedRecursiveLM(TABLE_4, seed=1)
    assert take.fit(estimator, 0.7).faults == {}
    before = estimator._state.theta.copy()
    # What overwritten memory or an overflow would leave.
    estimator._state.hessian[0, 0] = -1e6
    one = slice(700, 701)
    estimator.update(take.stamp_ns[one], take.force[one], np.ones(1, dtype=np.bool_))
    np.testing.assert_array_equal(estimator._state.theta, before)
    found = estimator.estimate(0, {'force_gap': 2})
    assert found.faults == {'force_gap': 2, 'factorisation_failed': 1}
