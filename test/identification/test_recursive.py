# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimator: laws that hold whatever the data."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import TABLE_4, ModifiedRecursiveLM
from rpms_ros.pulses import FloatArray, ForceTrace, PulseTrain

MILLISECOND = 1_000_000


def uniform(count, seed=7) -> FloatArray:
    return np.random.default_rng(seed).uniform(size=count)


def fed(pulses, forces, settings=TABLE_4) -> tuple[ModifiedRecursiveLM, FloatArray]:
    estimator = ModifiedRecursiveLM(settings, seed=1)
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    usable = np.ones(len(forces), dtype=np.bool_)
    return estimator, estimator.update(forces.stamp_ns, forces.force, usable)


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


def test_a_prediction_knows_nothing_of_its_own_or_later_samples(record):
    pulses, forces = record(uniform(30))
    _, expected = fed(pulses, forces)
    changed = forces.force.copy()
    changed[800:] = 99.0
    _, prediction = fed(pulses, ForceTrace(forces.stamp_ns, changed))
    np.testing.assert_array_equal(prediction[:801], expected[:801])
    assert prediction[801] != expected[801]


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


def test_a_minute_below_the_threshold_keeps_the_covariance_positive(record):
    intensity = np.concatenate((0.1 * uniform(1200), uniform(200, 8)))
    pulses, forces = record(intensity)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(forces))
    force = forces.force + noise
    low = slice(0, 60_000)
    estimator = ModifiedRecursiveLM(TABLE_4, seed=1)
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    estimator.update(forces.stamp_ns[low], force[low], np.ones(60_000, dtype=np.bool_))
    # the pause of forgetting is checked before a sample, which adds one percent at most
    assert estimator._state.covariance.max() < 1.02e10
    high = slice(60_000, None)
    prediction = estimator.update(
        forces.stamp_ns[high], force[high], np.ones(10_000, dtype=np.bool_)
    )
    assert np.linalg.eigvalsh(estimator._state.covariance).min() > 0.0
    rest = slice(5_000, None)
    error = np.linalg.norm(force[high][rest] - prediction[rest]) / np.linalg.norm(
        force[high][rest]
    )
    # noise of 0.05 N in some 3.5 N, and what it does to eight parameters that forget in 0.1 s
    assert error < 0.03


@pytest.mark.parametrize('others', [0.8, 0.0])
def test_one_intensity_gives_no_curve(record, others):
    intensity = np.full(40, 0.8)
    intensity[::4] = others
    pulses, forces = record(intensity)
    estimator, _ = fed(pulses, forces)
    found = estimator.estimate(0, {})
    assert not found.curve_known
    assert len(found.curve_force) == 0
    assert found.response_force.max() > 0.0


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
    pulses, forces = record(uniform(40))
    estimator = ModifiedRecursiveLM(TABLE_4, seed=1)
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    before = state_bytes(estimator)
    estimator.update(forces.stamp_ns, forces.force, np.zeros(len(forces), dtype=np.bool_))
    assert state_bytes(estimator) == before


def test_a_matrix_without_a_factor_is_counted_and_published(record):
    pulses, forces = record(uniform(30))
    estimator = ModifiedRecursiveLM(TABLE_4, seed=1)
    estimator.add_pulses(pulses.onset_ns, pulses.intensity)
    usable = np.ones(len(forces), dtype=np.bool_)
    half = slice(0, 700)
    estimator.update(forces.stamp_ns[half], forces.force[half], usable[half])
    assert estimator.estimate(0, {}).faults == {}
    before = estimator.parameters
    # What overwritten memory or an overflow would leave.
    estimator._state.hessian[0, 0] = -1e6
    one = slice(700, 701)
    estimator.update(forces.stamp_ns[one], forces.force[one], usable[one])
    assert estimator.parameters == before
    found = estimator.estimate(0, {'force_gap': 2})
    assert found.faults == {'force_gap': 2, 'factorisation_failed': 1}
