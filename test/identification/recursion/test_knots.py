# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sums of the memory, against those of all samples; the recruitment between knots."""

import numpy as np
import pytest

from rpms_ros.identification import LaguerreBasis
from rpms_ros.identification.estimation.blocks import newest
from rpms_ros.identification.estimation.settings import PRIOR
from rpms_ros.identification.model.recruitment import recruitment_curve
from rpms_ros.identification.recursion.recursive_kernel import (
    KNOTS,
    Memory,
    add_block,
    begin_block,
    empty_fit,
    empty_memory,
    equations,
    evaluate,
    fresh_prediction_state,
    interpolate,
    let_baseline_drift,
    recruitment_at_knots,
    take,
)
from rpms_ros.muscle import random_subject
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment

BASIS = LaguerreBasis(3, 38e-3, 0.0)
RATE = 2.0 / BASIS.time_constant
BLOCK = 20


def filled(generator, blocks=60) -> tuple[Memory, np.ndarray]:
    """Return a memory of blocks of 20 samples, and all regressors and forces (samples, n)."""
    memory = empty_memory(KNOTS, BASIS.functions)
    carried = fresh_prediction_state(BASIS.functions)
    onset = np.arange(blocks, dtype=np.int64) * BLOCK * 1_000_000
    intensity = generator.uniform(size=blocks)
    stamps = np.arange(blocks * BLOCK, dtype=np.int64) * 1_000_000 + 500_000
    force = generator.normal(size=len(stamps))
    usable = np.ones(BLOCK, dtype=np.bool_)
    for index in range(blocks):
        begin_block(memory, onset[index], intensity[index], BASIS.input_gain, RATE)
        part = slice(index * BLOCK, (index + 1) * BLOCK)
        take(stamps[part], force[part], usable, memory.blocks, carried, 0.0, RATE)
        add_block(memory, newest(memory.blocks))
    weight = np.empty((blocks, KNOTS))
    for row, value in zip(weight, intensity, strict=True):
        interpolate(value, row)
    lag = 1e-9 * (stamps[:, None] - onset)
    basis = BASIS.evaluate(np.where(lag > 0.0, lag, -1.0).ravel()).reshape(*lag.shape, -1)
    regressors = np.einsum('spf,pk->skf', basis, weight).reshape(len(stamps), -1)
    return memory, np.column_stack((regressors, np.ones(len(stamps)), force))


def test_sums_are_those_of_all_samples_at_once():
    memory, columns = filled(np.random.default_rng(1))
    regressors, force = columns[:, :-1], columns[:, -1]
    # Sums in another order.
    np.testing.assert_allclose(memory.cross, regressors.T @ force, rtol=1e-9, atol=1e-9)
    expected = np.tril(regressors.T @ regressors)
    np.testing.assert_allclose(np.tril(memory.gram), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(memory.energy[0], force @ force, rtol=1e-12)
    assert memory.samples[0] == len(force)


def test_equations_are_those_of_any_parameters():
    memory, columns = filled(np.random.default_rng(2))
    regressors, force = columns[:, :-2], columns[:, -1]
    theta = np.array([0.5, 0.9, 5.0, 6.0])
    fit = empty_fit(theta, BASIS.functions, 1)
    fit.linear[:] = [1.0, -0.4, 0.3]
    fit.levels[0] = 0.2
    equations(memory, fit)

    def model(values: np.ndarray, linear: np.ndarray, level: float) -> np.ndarray:
        parameters = RecruitmentParameters(*values[:2], *np.exp(values[2:]))
        rho = identified_recruitment(parameters, np.arange(1, KNOTS + 1) / KNOTS)
        return regressors @ np.outer(rho, linear).ravel() + level

    here = np.concatenate((theta[:2], np.log(theta[2:]), fit.linear, fit.levels))
    jacobian = np.empty((len(force), len(here)))
    for place in range(len(here)):
        step = np.zeros(len(here))
        step[place] = 1e-6
        above, below = here + step, here - step
        jacobian[:, place] = model(above[:4], above[4:7], above[7])
        jacobian[:, place] -= model(below[:4], below[4:7], below[7])
    jacobian /= 2e-6
    # Central differences: epsilon over the step.
    np.testing.assert_allclose(fit.matrix, jacobian.T @ jacobian, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(fit.right, jacobian.T @ force, rtol=1e-6, atol=1e-5)


def test_the_cost_is_that_of_the_samples():
    memory, columns = filled(np.random.default_rng(3))
    regressors, force = columns[:, :-2], columns[:, -1]
    prior = PRIOR
    fit = empty_fit(np.array([0.45, 0.95, 4.0, 5.0]), BASIS.functions, 1)
    fit.variance[0] = 1e-9
    assert evaluate(memory, prior, fit)
    rho = identified_recruitment(
        RecruitmentParameters(*fit.theta), np.arange(1, KNOTS + 1) / KNOTS
    )
    residual = force - regressors @ np.outer(rho, fit.linear).ravel() - fit.levels[0]
    # The ridge of the linear unknowns and rounding.
    np.testing.assert_allclose(fit.squares[0], residual @ residual, rtol=1e-6)


def test_a_baseline_that_drifts_far_is_forgotten():
    memory, _ = filled(np.random.default_rng(4))
    before = memory.energy[0] - memory.cross[-1] ** 2 / memory.gram[-1, -1]
    let_baseline_drift(memory, 1e12)
    # What is left is what the samples say of everything else, the level eliminated.
    assert memory.gram[-1, -1] < 1e-6
    assert abs(memory.cross[-1]) < 1e-6
    np.testing.assert_allclose(memory.energy[0], before, rtol=1e-6)


def test_intensities_beyond_the_range_count_as_its_ends():
    beyond, end = np.empty(KNOTS), np.empty(KNOTS)
    interpolate(1.3, beyond)
    interpolate(1.0, end)
    np.testing.assert_array_equal(beyond, end)
    interpolate(-0.2, beyond)
    np.testing.assert_array_equal(beyond, 0.0)


def test_curves_of_people_are_met():
    every_intensity = np.linspace(0.0, 1.0, 301)
    rows = np.empty((301, KNOTS))
    for row, intensity in zip(rows, every_intensity, strict=True):
        interpolate(intensity, row)
    errors = []
    for seed in range(200):
        shape = random_subject(np.random.default_rng(seed)).recruitment
        theta = np.array(
            [shape.threshold, shape.saturation, shape.saturation_slope, shape.threshold_slope]
        )
        values = np.empty((5, KNOTS))
        recruitment_at_knots(theta, values)
        curve = identified_recruitment(RecruitmentParameters(*theta), every_intensity)
        errors.append(np.abs(rows @ values[0] - curve).max() / curve.max())
    # As the module says.
    assert max(errors) < 2.5e-3
    assert np.median(errors) < 4e-4


@pytest.mark.parametrize('theta', [(0.48, 0.98, 4.0, 6.0), (0.6, 0.8, 15.0, 4.0)])
def test_values_at_knots_are_those_of_the_curve(theta):
    values = np.empty((5, KNOTS))
    recruitment_at_knots(np.array(theta), values)
    knots = np.arange(1, KNOTS + 1) / KNOTS
    rho, by_logarithm = recruitment_curve(knots, np.array(theta))
    # Rounding.
    np.testing.assert_allclose(values[0], rho, atol=1e-14)
    np.testing.assert_allclose(values[1:].T, by_logarithm, atol=1e-13)
