# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Equations 1 to 11 and 30, and misprints: the printed form does not work, the mended one does."""

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from rpms_ros.identification import TABLE_4, DistortedSineBasis
from rpms_ros.muscle import (
    Contraction,
    IntensityRecruitment,
    RateRecruitment,
    RecruitmentField,
    RecruitmentParameters,
    Subject,
    identified_recruitment,
    steady_mean,
    summed_twitches,
    twitch,
    twitch_area,
)

T_A = 38.44e-3
T_S = 1e-3
INTENSITY = np.linspace(0.0, 1.0, 101)
TAPS = np.arange(0, 1001)


def test_equation_1_is_a_chain_of_equal_poles():
    for order in (2, 3, 4):
        # dx/dt = (shift - 1) x / T_a: each pole drives the next one.
        chain = (np.diag(np.ones(order - 1), -1) - np.eye(order)) / T_A
        response = np.array([expm(chain * time)[-1, 0] for time in 0.01 * np.arange(1, 30)])
        shape = twitch(0.01 * np.arange(1, 30), T_A, order)
        # Proportional; the matrix exponential is good to 1e-13.
        np.testing.assert_allclose(shape / shape[4], response / response[4], rtol=1e-10)


@pytest.mark.parametrize('order', [2, 3, 4])
def test_equation_2_has_its_maximum_of_1_at_n_minus_1_time_constants(order):
    time = 0.01 * np.arange(100)
    power = order - 1
    scale = (power * T_A) ** power * math.exp(-power)
    # Rounding, also below where powers of T_a / time are formed.
    np.testing.assert_allclose(
        twitch(time, T_A, order), time**power * np.exp(-time / T_A) / scale, rtol=1e-13
    )
    assert twitch(power * T_A, T_A, order) == pytest.approx(1.0, rel=1e-14)


def test_equation_3_is_least_at_the_true_time_constant():
    measured = twitch(TAPS * T_S, T_A)
    found = minimize_scalar(
        lambda guess: float(np.sum((measured - twitch(TAPS * T_S, guess)) ** 2)),
        bounds=(0.02, 0.06),
        method='bounded',
        options={'xatol': 1e-10},
    )
    # A minimum is flat: half the digits.
    assert found.x == pytest.approx(T_A, rel=1e-6)


@pytest.mark.parametrize('frequency_hz', [0.0, 1.0, 5.0, 20.0])
def test_equation_4_is_the_laplace_transform_of_a_contraction(frequency_hz):
    latency = 9.45e-3
    s = 2j * math.pi * frequency_hz
    contraction = Contraction(Subject(time_constant=T_A, latency=latency))
    contraction.add_pulses(0, 1.0)
    time_ns = np.arange(0, 1_000_000_000, 50_000)
    force = contraction.force(time_ns) / float(contraction.subject.pulse_weight(1.0, 0.0))
    transform = 50e-6 * np.sum(force * np.exp(-s * time_ns * 1e-9))
    expected = T_A / (2 * math.exp(-2)) / (1 + s * T_A) ** 3 * cmath.exp(-s * latency)
    # The rule's error is about (2 pi f dt)^2 / 12 at 20 Hz; the tail beyond 1 s is 1e-9.
    assert abs(transform - expected) < 1e-5 * T_A


def test_equation_7_as_average_as_sum_and_as_integral():
    k_rep = 50
    period = summed_twitches((1000 + np.arange(k_rep)) * T_S, 20.0, T_A)
    single = twitch(TAPS * T_S, T_A)
    # The sum stops at 1 s, where 2e-9 of the twitch's area is left.
    assert period.mean() == pytest.approx(single.sum() / k_rep, rel=1e-7)
    assert steady_mean(20.0, T_A) == pytest.approx(single.sum() / k_rep, rel=1e-7)
    area = quad(lambda time: float(twitch(time, T_A)), 0.0, 2.0, epsabs=1e-13)[0]
    assert twitch_area(T_A) == pytest.approx(area, rel=1e-10)


def test_equation_9():
    formula = (
        0.738
        * (
            (INTENSITY - 0.48) * np.arctan(5 * (INTENSITY - 0.48))
            - (INTENSITY - 0.98) * np.arctan(4 * (INTENSITY - 0.98))
        )
        + 0.539
    )
    # Rounding of numbers below 1.
    np.testing.assert_allclose(IntensityRecruitment()(INTENSITY), formula, atol=1e-15)


def test_equation_10():
    rate = np.linspace(0.0, 60.0, 61)
    bend = np.arctan(0.05 * (rate - 25.0)) / np.pi + 0.5
    formula = 0.0597 * (rate - (rate - 25.0) * bend) - 0.321
    # Rounding of numbers up to 4.
    np.testing.assert_allclose(RateRecruitment()(rate), formula, atol=1e-14)
    # Table 3; four digits, as the expected values are given.
    expected = [-0.0004, 0.7849, 0.9990, 1.3819]
    np.testing.assert_allclose(formula[[0, 15, 20, 35]], expected, atol=5e-5)


def test_equation_11_weights_every_pulse_by_its_own_intensity_and_rate():
    subject = Subject(time_constant=T_A, latency=0.0)
    onset_ns = np.array([0, 60, 100, 140, 190]) * 1_000_000
    intensity = np.array([0.6, 0.9, 0.7, 1.0, 0.5])
    rates = [15.0, *(1e9 / (after - before) for before, after in pairwise(onset_ns))]
    contraction = Contraction(subject)
    contraction.add_pulses(onset_ns, intensity)
    expected = np.zeros(len(TAPS))
    for onset, share, rate_hz in zip(onset_ns, intensity, rates, strict=True):
        weight = RecruitmentField()(share, rate_hz) / RateRecruitment()(20.0)
        expected += (
            10.0 / steady_mean(rate_hz, T_A) * weight * twitch(TAPS * T_S - onset * 1e-9, T_A)
        )
    # Lags in seconds are rounded in two ways.
    np.testing.assert_allclose(
        contraction.force(1_000_000 * TAPS), expected, rtol=1e-11, atol=1e-12
    )


ENDS = np.array([0.0, 1.0])


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

    def alignment(damping, direction):
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
