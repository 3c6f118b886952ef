# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Equations 12 to 31: every step of the recursion against plain NumPy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rpms_ros.identification import TABLE_4, DistortedSineBasis, ModifiedRecursiveLM
from rpms_ros.identification.model.recruitment import recruitment_curve
from rpms_ros.identification.model.settings import BOUNDS
from rpms_ros.identification.recursion.paper_kernel import RecursionState, _judge, _update_linear
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import PulseTrain

MILLISECOND = 1_000_000
BASIS = DistortedSineBasis()
TRAIN = PulseTrain.regular(np.random.default_rng(4).uniform(size=200), 20.0)
STAMP_NS = MILLISECOND * np.arange(8000, dtype=np.int64)
# Noise makes steps of every quality: good, bad and discarded ones.
NOISE = 0.02 * np.random.default_rng(5).standard_normal(8000)


def plant_force():
    contraction = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    contraction.add_pulses(TRAIN.onset_ns, TRAIN.intensity)
    return contraction.force(STAMP_NS) + NOISE


def regressors(stamp_ns, theta):
    """Return phi (functions,) and d phi / d theta (functions, 3) out of all pulses."""
    values = BASIS.evaluate((stamp_ns - TRAIN.onset_ns) * 1e-9)
    rho, slope = recruitment_curve(TRAIN.intensity, theta)
    return values.T @ rho, values.T @ (slope[:, :3] / np.append(np.ones(2), theta[2]))


def copied(state):
    return RecursionState(*(part.copy() for part in state))


def step_of(settings, before, after, stamp_ns, force, prediction):
    """Return one sample: the state before and after, and what the equations need."""
    theta, linear = before.theta, before.linear
    regressor, slope = regressors(stamp_ns, theta)
    error = force - prediction
    denominator = float(settings.forgetting + regressor @ before.covariance @ regressor)
    # the derivative less what the linear regressors say of it, and the factor that makes its
    # residual a-posteriori
    innovation = slope.T @ linear - before.projection @ regressor
    factor = settings.forgetting / denominator if settings.projected else 1.0
    derivative = innovation if settings.projected else slope.T @ linear
    gradient = factor * derivative * error
    # delta after the rule of the condition number
    damping = float(before.scalars['damping'][0])
    condition = float(np.linalg.cond(after.hessian + damping * np.eye(3)))
    damping += settings.damping_increment if condition > settings.condition_limit else 0.0
    update = np.linalg.solve(after.hessian + damping * np.eye(3), gradient)
    # whether the bounds leave the step alone
    moved, (low, high) = theta[:3] + update, np.transpose(list(BOUNDS.values()))
    inside = (low <= moved).all() and (moved <= high).all() and moved[1] - moved[0] >= 0.05
    return SimpleNamespace(**locals())


@pytest.fixture(scope='module', params=[True, False], ids=['projected', 'plain'])
def steps(request):
    """Single samples taken out of a running recursion."""
    settings = replace(TABLE_4, projected=request.param)
    estimator = ModifiedRecursiveLM(settings)
    estimator.add_pulses(TRAIN.onset_ns, TRAIN.intensity)
    force = plant_force()
    usable = np.ones(len(force), dtype=bool)
    estimator.update(STAMP_NS[:3000], force[:3000], usable[:3000])
    taken = []
    for index in range(3000, 3300):
        before = copied(estimator._state)
        here = slice(index, index + 1)
        prediction = estimator.update(STAMP_NS[here], force[here], usable[here])
        after, sample = copied(estimator._state), (int(STAMP_NS[index]), float(force[index]))
        taken.append(step_of(settings, before, after, *sample, float(prediction[0])))
    return taken


def test_equations_12_and_13_predict_from_pulses_and_parameters(steps):
    for step in steps:
        # Sums of 7 pulses and 8 functions, in another order.
        assert step.prediction == pytest.approx(
            float(step.regressor @ step.before.linear), rel=1e-9, abs=1e-10
        )


def frozen_fit(forgetting, samples):
    """Return regressors, force and the linear parameters after a run at fixed theta."""
    # So much damping lets the nonlinear parameters stay where they are.
    settings = replace(TABLE_4, forgetting=forgetting, damping=1e30)
    estimator = ModifiedRecursiveLM(settings)
    estimator.add_pulses(TRAIN.onset_ns, TRAIN.intensity)
    force = plant_force()[:samples]
    estimator.update(STAMP_NS[:samples], force, np.ones(samples, dtype=bool))
    theta = np.array(settings.start)
    phi = np.array([regressors(int(stamp), theta)[0] for stamp in STAMP_NS[:samples]])
    return phi, force, estimator._state.linear


@pytest.mark.parametrize('forgetting', [0.99, 0.999])
def test_equations_17_to_22_linear_least_squares_with_forgetting(forgetting):
    phi, force, linear = frozen_fit(forgetting, 1500)
    acts = np.abs(phi).max(axis=1) > 0.0
    count = int(acts.sum())
    # A sample on which nothing acts is not forgotten either, so ages count acting samples.
    root = np.sqrt(forgetting ** np.arange(count - 1, -1, -1.0))
    prior = np.sqrt(forgetting**count / TABLE_4.linear_covariance) * np.eye(8)
    expected = np.linalg.lstsq(
        np.vstack((root[:, None] * phi[acts], prior)),
        np.concatenate((root * force[acts], np.zeros(8))),
        rcond=None,
    )[0]
    # The recursion squares the condition of the data (about 1e3): 1e-16 * 1e6, with a margin.
    np.testing.assert_allclose(linear, expected, rtol=1e-6, atol=1e-7)


def test_equation_19_has_the_last_error_inside_the_sum():
    phi, force, linear = frozen_fit(0.99, 1000)
    weight = 0.99 ** np.arange(999, -1, -1.0)
    # Another set of parameters, which explains the last sample to the full.
    other = linear + phi[-1] * (force[-1] - phi[-1] @ linear) / (phi[-1] @ phi[-1])

    def printed(parameters):
        return float(np.sum(weight) * (force[-1] - phi[-1] @ parameters) ** 2)

    def mended(parameters):
        return float(weight @ (force - phi @ parameters) ** 2)

    # As printed, the past does not count, and anything that fits one sample is optimal.
    assert printed(other) < 1e-6 * printed(linear)
    assert mended(linear) < mended(other)


def test_equations_20_to_23_elimination_of_the_linear_parameters():
    generator = np.random.default_rng(0)
    phi, psi = generator.standard_normal((50, 8)), generator.standard_normal((50, 3))
    force = generator.standard_normal(50)
    forgetting = 0.97
    settings = replace(TABLE_4, forgetting=forgetting, linear_covariance=1e6)
    state = ModifiedRecursiveLM(settings)._state
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    for row, slope, measured in zip(phi, psi, force, strict=True):
        gain = state.covariance @ row
        denominator = float(forgetting + row @ gain)
        innovation, error = slope - state.projection @ row, float(measured - row @ state.linear)
        factor = forgetting / denominator
        hessian = forgetting * hessian + factor * np.outer(innovation, innovation)
        gradient = forgetting * gradient + factor * innovation * error
        _update_linear(state, gain, innovation, error, denominator, forgetting)
    weight = forgetting ** np.arange(49, -1, -1.0)[:, None]
    prior = forgetting**50 / 1e6 * np.eye(8)
    gram = phi.T @ (weight * phi) + prior
    projected = np.linalg.solve(gram, phi.T @ (weight * psi))
    off = psi - phi @ projected
    # Eliminating w from the joint normal equations; a prior of 1e-6 is what is left of W.
    np.testing.assert_allclose(hessian, psi.T @ (weight * off), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(gradient, off.T @ (weight[:, 0] * force), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(state.projection, projected.T, rtol=1e-8, atol=1e-10)
    linear = np.linalg.solve(gram, phi.T @ (weight[:, 0] * force))
    np.testing.assert_allclose(state.linear, linear, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(state.covariance, np.linalg.inv(gram), rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(state.covariance, state.covariance.T)


def test_equations_24_to_26_step_to_the_minimum_of_the_damped_model(steps):
    taken = 0
    for step in steps:
        moved = step.after.theta[:3] - step.before.theta[:3]
        if step.inside and np.abs(moved).any():
            taken += 1
            # A difference of numbers of size 1 loses digits where the step is small.
            np.testing.assert_allclose(moved, step.update, rtol=1e-6, atol=1e-12)
    assert taken > 50


def test_equation_27_forgets_the_hessian_itself(steps):
    for step in steps:
        outer = step.factor * np.outer(step.derivative, step.derivative)
        expected = step.settings.forgetting * step.before.hessian + outer
        # Rounding.
        np.testing.assert_allclose(step.after.hessian, expected, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize(
    ('ratio', 'change', 'taken'),
    [
        (-0.5, 1.002, False),
        (0.01, 1.002, True),
        (0.5, 1.0, True),
        (0.97, 1.0, True),
        (0.99, 1.0 / 1.002, True),
        (3.0, 1.0 / 1.002, True),
    ],
)
def test_rules_after_equation_28(ratio, change, taken):
    estimator = ModifiedRecursiveLM(TABLE_4)
    constants, state = estimator._constants, estimator._state
    assert _judge(state.scalars, constants, 2.0 * ratio, 2.0) == taken
    # Rounding.
    assert state.scalars['damping'][0] == pytest.approx(TABLE_4.damping * change, rel=1e-14)


@pytest.mark.parametrize('limit', [1.5, 1e9])
def test_the_condition_rule_adds_its_increment(limit):
    settings = replace(TABLE_4, condition_limit=limit, damping_factor=1.0 + 1e-12)
    estimator = ModifiedRecursiveLM(settings)
    estimator.add_pulses(TRAIN.onset_ns[:1], np.array([0.9]))
    force = plant_force()[:40]
    estimator.update(STAMP_NS[:40], force, np.ones(40, dtype=bool))
    damping = estimator.estimate(0, {}).damping
    # H[0] is small beside delta[0] = 0.001, so R is well conditioned until the force is learnt.
    increments = (damping - 0.001) / 0.01
    assert increments == pytest.approx(round(increments), abs=1e-6)
    assert (round(increments) > 0) == (limit < 1e9)


@pytest.mark.parametrize(('form_factor', 'memory'), [(120.0, 350), (45.0, 350), (160.0, 600)])
def test_equation_31(form_factor, memory):
    basis = DistortedSineBasis(8, memory, form_factor)
    taps = np.arange(1, memory + 1)
    bent = np.pi * (1.0 - np.exp(-(taps - 0.5) / form_factor))
    raw = np.sin(np.outer(np.arange(1, 9), bent)) / np.sqrt(memory / 2)
    factor = np.linalg.cholesky(raw @ raw.T).T
    functions = np.linalg.solve(factor.T, raw)
    # Rounding times the condition of the sines.
    np.testing.assert_allclose(basis.evaluate(taps * 1e-3), functions.T, atol=1e-11)
    np.testing.assert_allclose(functions @ functions.T, np.eye(8), atol=1e-11)
