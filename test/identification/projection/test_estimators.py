# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Batch and horizon: right curve, independent of blocks, replayable, stable at rest."""

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.horizon import HorizonEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED
from rpms_ros.muscle import Contraction, RecruitmentParameters, average_subject

BOTH = pytest.mark.parametrize('kind', [BatchEstimator, HorizonEstimator])
SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))


@BOTH
def test_noise_free_is_exact(kind, record):
    take = record(12.0)
    estimator = kind(SETTINGS)
    prediction = take.feed(estimator)
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    # Seven functions hold a twitch of T_a 38.44 ms to 1e-5; the rest is the weak prior.
    assert take.curve_error(estimate) < 1e-3
    late = slice(10_000, None)
    error = np.linalg.norm((take.force - prediction)[late]) / np.linalg.norm(take.force[late])
    assert error < 1e-3
    assert (estimate.nonlinear_identifiability == CONVERGED).all()
    np.testing.assert_allclose(estimate.nonlinear, [0.48, 0.98, 4.0, 6.0], rtol=1e-2)


@BOTH
def test_five_seconds_suffice_in_noise(kind, record):
    take = record(5.0, noise=0.01, seed=1)
    estimator = kind(SETTINGS)
    take.feed(estimator)
    # One per cent of the maximum: the figure for the median of seeds
    assert take.curve_error(estimator.estimate(0, {})) < 0.01


@BOTH
@pytest.mark.parametrize('block', [1, 37, 999])
def test_block_length_changes_no_bit(kind, block, record):
    take = record(2.5, noise=0.01)
    whole, parts = kind(SETTINGS), kind(SETTINGS)
    np.testing.assert_array_equal(take.feed(whole), take.feed(parts, block))
    left, right = whole.estimate(0, {}), parts.estimate(0, {})
    np.testing.assert_array_equal(left.nonlinear, right.nonlinear)
    np.testing.assert_array_equal(left.linear, right.linear)
    np.testing.assert_array_equal(left.curve_upper, right.curve_upper)


@BOTH
def test_scale_of_the_force_moves_the_linear_parameters_only(kind, record):
    take = record(4.0, noise=0.01)
    small, large = kind(SETTINGS), kind(SETTINGS)
    take.feed(small)
    type(take)(take.onset_ns, take.intensity, take.stamp_ns, 1000 * take.force, take.curve).feed(
        large
    )
    left, right = small.estimate(0, {}), large.estimate(0, {})
    # Where the iteration ends may differ by its tolerance.
    np.testing.assert_allclose(left.nonlinear, right.nonlinear, rtol=1e-4)
    np.testing.assert_allclose(1000 * left.curve_force, right.curve_force, rtol=1e-4, atol=1e-3)


@BOTH
@pytest.mark.parametrize('start', [(0.2, 0.3, 1.0), (0.7, 1.2, 20.0), (0.68, 0.79, 2.0)])
def test_wide_starts_end_at_the_right_minimum(kind, start, record):
    take = record(8.0, noise=0.01)
    settings = ProjectionSettings(basis=SETTINGS.basis, start=RecruitmentParameters(*start))
    estimator = kind(settings)
    take.feed(estimator)
    assert take.curve_error(estimator.estimate(0, {})) < 0.01


def test_changing_rate_is_one_model():
    """The weight of a pulse follows its rate: 15, 20 and 30 Hz in one recording."""
    generator = np.random.default_rng(0)
    rate = np.repeat([15.0, 30.0, 20.0], 60)
    onset = np.cumsum(1e9 / rate).astype(np.int64)
    intensity = generator.uniform(0, 1, len(onset))
    muscle = average_subject()
    contraction = Contraction(muscle)
    contraction.add_pulses(onset, intensity)
    stamp = np.arange(9_000, dtype=np.int64) * 1_000_000
    force = contraction.force(stamp)
    errors = []
    for by_rate in (ProjectionSettings().by_rate, None):
        settings = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 9e-3), by_rate=by_rate)
        estimator = BatchEstimator(settings)
        estimator.add_pulses(onset, intensity)
        estimator.update(stamp, force, np.ones(len(stamp), dtype=bool))
        curve = muscle.steady_force(estimator.estimate(0, {}).curve_intensity, 20.0)
        curve -= curve[0]
        found = estimator.estimate(0, {}).curve_force
        errors.append(np.abs(found - curve).max() / curve.max())
    with_rate, without = errors
    assert with_rate < 2e-3
    assert without > 10 * with_rate


def test_silence_neither_forgets_nor_winds_up(record):
    take = record(6.0, noise=0.005, silence=70.0)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    # The horizon of 20 s holds no pulse any more: the arrival cost has the information.
    assert take.curve_error(estimate) < 0.01
    width = (estimate.curve_upper - estimate.curve_force).max() / take.curve.max()
    assert width < 0.05


def test_constant_intensity_does_not_erase_the_curve(record):
    generator = np.random.default_rng(4)
    intensity = np.concatenate((generator.uniform(0, 1, 160), np.full(700, 0.7)))
    take = record(43.0, intensity, noise=0.005)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    assert take.curve_error(estimator.estimate(0, {})) < 0.02


def test_memory_is_flat(record):
    take = record(45.0)
    estimator = HorizonEstimator(ProjectionSettings(basis=SETTINGS.basis, horizon=2.0))
    take.feed(estimator, 1000)
    assert int(estimator._problem.blocks.size[0]) < 70
    assert len(estimator._delay_line.begin_ns) == 0


def test_follows_a_clock_that_jumps_back(record):
    take = record(6.0, noise=0.005)
    estimator = HorizonEstimator(SETTINGS)
    take.feed(estimator)
    estimator.forget_pulses()
    again = record(4.0, noise=0.005, seed=8)
    again.feed(estimator)
    assert again.curve_error(estimator.estimate(0, {})) < 0.01


@BOTH
def test_refuses_a_rate_of_nothing(kind):
    with pytest.raises(IdentificationError, match='expected a repetition rate above 0 Hz, got 0'):
        kind(rate_hz=0.0)
