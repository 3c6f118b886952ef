# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sums of the memory, against sums over all samples at once."""

import numpy as np

from rpms_ros.identification import LaguerreBasis
from rpms_ros.identification.estimation.blocks import newest
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.recursion.fit import empty_fit
from rpms_ros.identification.recursion.people_kernel import (
    KNOTS,
    Memory,
    add_block,
    begin_block,
    empty_memory,
    equations,
    evaluate,
    fresh_prediction_state,
    interpolate,
    let_baseline_drift,
    take,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment

BASIS = LaguerreBasis(3, 38e-3, 0.0)
RATE = 2.0 / BASIS.time_constant
BLOCK = 20


def filled(generator: np.random.Generator, blocks: int = 60) -> tuple[Memory, np.ndarray]:
    """Return a memory of blocks of 20 samples, and all regressors and forces (samples, n)."""
    memory = empty_memory(KNOTS, BASIS.functions)
    carried = fresh_prediction_state(BASIS.functions)
    onset = np.arange(blocks, dtype=np.int64) * BLOCK * 1_000_000
    intensity = generator.uniform(size=blocks)
    stamps = np.arange(blocks * BLOCK, dtype=np.int64) * 1_000_000 + 500_000
    force = generator.normal(size=len(stamps))
    usable = np.ones(BLOCK, dtype=np.bool_)
    for index in range(blocks):
        begin_block(
            memory.blocks,
            memory.chains,
            onset[index],
            intensity[index],
            BASIS.input_gain,
            RATE,
            index == 0,
        )
        part = slice(index * BLOCK, (index + 1) * BLOCK)
        take(stamps[part], force[part], usable, memory.blocks, carried, 0.0, RATE, np.empty(BLOCK))
        add_block(memory, newest(memory.blocks))
    weight = np.empty((blocks, KNOTS))
    for row, value in zip(weight, intensity, strict=True):
        interpolate(value, row)
    lag = 1e-9 * (stamps[:, None] - onset)
    basis = BASIS.evaluate(np.where(lag > 0.0, lag, -1.0).ravel()).reshape(*lag.shape, -1)
    regressors = np.einsum('spf,pk->skf', basis, weight).reshape(len(stamps), -1)
    return memory, np.column_stack((regressors, np.ones(len(stamps)), force))


def test_sums_are_those_of_all_samples_at_once() -> None:
    memory, columns = filled(np.random.default_rng(1))
    regressors, force = columns[:, :-1], columns[:, -1]
    # Sums in another order.
    np.testing.assert_allclose(memory.cross, regressors.T @ force, rtol=1e-9, atol=1e-9)
    expected = np.tril(regressors.T @ regressors)
    np.testing.assert_allclose(np.tril(memory.gram), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(memory.energy[0], force @ force, rtol=1e-12)
    assert memory.samples[0] == len(force)


def test_equations_are_those_of_any_parameters() -> None:
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


def test_the_cost_is_that_of_the_samples() -> None:
    memory, columns = filled(np.random.default_rng(3))
    regressors, force = columns[:, :-2], columns[:, -1]
    prior = ProjectionSettings(basis=BASIS).as_prior()
    fit = empty_fit(np.array([0.45, 0.95, 4.0, 5.0]), BASIS.functions, 1)
    fit.variance[0] = 1e-9
    assert evaluate(memory, prior, fit)
    rho = identified_recruitment(
        RecruitmentParameters(*fit.theta), np.arange(1, KNOTS + 1) / KNOTS
    )
    residual = force - regressors @ np.outer(rho, fit.linear).ravel() - fit.levels[0]
    # The ridge of the linear unknowns and rounding.
    np.testing.assert_allclose(fit.squares[0], residual @ residual, rtol=1e-6)


def test_a_baseline_that_drifts_far_is_forgotten() -> None:
    memory, _ = filled(np.random.default_rng(4))
    before = memory.energy[0] - memory.cross[-1] ** 2 / memory.gram[-1, -1]
    let_baseline_drift(memory, 1e12)
    # What is left is what the samples say of everything else, the level eliminated.
    assert memory.gram[-1, -1] < 1e-6
    assert abs(memory.cross[-1]) < 1e-6
    np.testing.assert_allclose(memory.energy[0], before, rtol=1e-6)
