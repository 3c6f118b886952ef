# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Misprints of the paper: the printed form does not work, the mended one does."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import TABLE_4, DistortedSineBasis, ModifiedRecursiveLM
from rpms_ros.muscle import (
    Contraction,
    IntensityRecruitment,
    RecruitmentParameters,
    identified_recruitment,
    simulation_subject,
    twitch,
)
from rpms_ros.pulses import FloatArray, PulseTrain

T_A = 38.44e-3
ENDS = np.array([0.0, 1.0])
INTENSITY = np.linspace(0.0, 1.0, 101)


@pytest.mark.parametrize('order', [3, 4, 5])
def test_equation_2_has_a_surplus_factor(order):
    power = order - 1
    time = power * T_A
    printed = time**power * math.exp(-time / T_A) / ((power * T_A) ** power * power)
    printed /= math.exp(-power)
    # Rounding.
    assert printed == pytest.approx(1.0 / power, rel=1e-13)
    assert twitch(time, T_A, order) == pytest.approx(1.0, rel=1e-13)


def test_equation_9_has_beta_2_inside_the_bracket():
    bends = IntensityRecruitment(gain=1.0, offset=0.0)(ENDS)
    # Three decimals, as stated; a relative recruitment runs from 0 to 1.
    np.testing.assert_allclose(0.738 * (bends + 0.539), [-0.141, 0.859], atol=6e-4)
    np.testing.assert_allclose(IntensityRecruitment()(ENDS), [0.0002, 0.9997], atol=5e-5)


def run(samples) -> tuple[ModifiedRecursiveLM, FloatArray, FloatArray]:
    """Return an estimator with fixed theta, its regressors and its force."""
    train = PulseTrain.regular(np.random.default_rng(2).uniform(size=samples // 50), 20.0)
    stamp_ns = 1_000_000 * np.arange(1, samples + 1, dtype=np.int64)
    contraction = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    contraction.add_pulses(train.onset_ns, train.intensity)
    force = contraction.force(stamp_ns)
    # So much damping lets the nonlinear parameters stay where they are.
    estimator = ModifiedRecursiveLM(replace(TABLE_4, damping=1e30))
    estimator.add_pulses(train.onset_ns, train.intensity)
    estimator.update(stamp_ns, force, np.ones(samples, dtype=bool))
    rho = identified_recruitment(TABLE_4.start, train.intensity)
    lag = (stamp_ns[:, None] - train.onset_ns) * 1e-9
    values = DistortedSineBasis().evaluate(lag.ravel()).reshape(*lag.shape, 8)
    return estimator, np.einsum('p,spf->sf', rho, values), force


def test_equation_19_has_the_last_error_inside_the_sum():
    estimator, phi, force = run(1000)
    linear = estimator._state.linear
    weight = 0.99 ** np.arange(999, -1, -1.0)
    # Another set of parameters, which explains the last sample to the full.
    other = linear + phi[-1] * (force[-1] - phi[-1] @ linear) / (phi[-1] @ phi[-1])

    def printed(parameters: FloatArray) -> float:
        return float(np.sum(weight) * (force[-1] - phi[-1] @ parameters) ** 2)

    def mended(parameters: FloatArray) -> float:
        return float(weight @ (force - phi @ parameters) ** 2)

    # As printed, the past does not count, and anything that fits one sample is optimal.
    assert printed(other) < 1e-6 * printed(linear)
    assert mended(linear) < mended(other)


def test_equation_27_inverts_the_old_hessian():
    forgetting = 0.99
    printed, mended = 1.0, 1.0
    for _ in range(3000):
        printed = forgetting / printed + 1.0
        mended = forgetting * mended + 1.0
    # Under a constant derivative of 1 the sum over the past is 1 / (1 - lambda) ...
    assert mended == pytest.approx(100.0, rel=1e-12)
    # ... while the printed form knows one sample and a half, whatever lambda is.
    assert printed == pytest.approx((1.0 + math.sqrt(1.0 + 4.0 * forgetting)) / 2.0, rel=1e-12)


def test_smaller_damping_is_the_gauss_newton_direction():
    hessian = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 0.05]])
    gradient = np.array([1.0, -0.5, 0.2])
    newton = np.linalg.solve(hessian, gradient)

    def alignment(damping: float, direction: FloatArray) -> float:
        step = np.linalg.solve(hessian + damping * np.eye(3), gradient)
        return float(step @ direction / np.linalg.norm(step) / np.linalg.norm(direction))

    # Unit vectors: one minus half the squared angle.
    assert alignment(1e-9, newton) == pytest.approx(1.0, abs=1e-12)
    assert alignment(1e9, gradient) == pytest.approx(1.0, abs=1e-12)
    assert alignment(1e-9, gradient) < 0.9


def test_equation_31_has_one_tap_too_many():
    basis = DistortedSineBasis()
    taps = np.arange(0, 351)
    printed = np.sin(
        np.outer(np.arange(1, 9), np.pi * (1.0 - np.exp(-(taps - 0.5) / basis.form_factor)))
    ) / math.sqrt(175.0)
    # i = 0 .. m makes m + 1 columns, the first of which has the wrong sign.
    assert printed.shape == (8, basis.memory_taps + 1)
    assert (printed[:, 0] < 0.0).all()
    assert (printed[:, 1] > 0.0).all()
    functions = basis.evaluate(taps * 1e-3)
    np.testing.assert_array_equal(functions[0], 0.0)
    # Rounding times the condition of the sines.
    np.testing.assert_allclose(functions.T @ functions, np.eye(8), atol=1e-11)


def test_theta_begins_with_the_threshold():
    start = TABLE_4.start
    assert (start.u_thr, start.u_sat) == (0.40, 0.90)
    as_listed = RecruitmentParameters(u_thr=0.90, u_sat=0.40, alpha_sat=3.0)
    # In the order in which Sec. 3.3.2 lists them the start would relax with the intensity.
    assert identified_recruitment(as_listed, 1.0) < 0.0
    assert identified_recruitment(start, 1.0) > 0.0
    assert (np.diff(identified_recruitment(start, INTENSITY)) > 0.0).all()
