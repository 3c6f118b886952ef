# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Distorted sines of Eq. (31), and Laguerre functions with an exact transition."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import trapezoid

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import DistortedSineBasis
from rpms_ros.identification.estimation.normal_equations import advance_state
from rpms_ros.identification.model.basis import LaguerreBasis, transition_generator
from rpms_ros.muscle import twitch


def test_area_is_the_integral():
    basis = DistortedSineBasis()
    lag = np.linspace(0.0, basis.duration, 350_501)
    # midpoint rule of 1 ms against a fine one, for functions of some 50 ms: (1 / 50)^2 / 24
    np.testing.assert_allclose(
        basis.area, trapezoid(basis.evaluate(lag), lag, axis=0), atol=1e-4 * np.abs(basis.area[0])
    )


@given(st.floats(1e-6, 1.0, exclude_max=True), st.integers(20, 500))
def test_a_grid_of_any_phase_meets_exactly_the_memory(phase, memory):
    basis = DistortedSineBasis(1, memory, memory / 3)
    taps = phase + np.arange(memory + 5) - 1.0
    inside = (taps > 0.5) & (taps <= memory + 0.5)
    assert np.count_nonzero(inside) == memory
    values = basis.evaluate(taps * basis.tap)[:, 0]
    # the first function is a half wave that is never zero inside; ends, where the grid touches the
    # support to 1e-9 of a tap, are rounding's
    clear = np.minimum(np.abs(taps - 0.5), np.abs(taps - memory - 0.5)) > 1e-9
    np.testing.assert_array_equal((values != 0.0)[clear], inside[clear])


def test_dependent_functions_are_refused():
    basis = DistortedSineBasis(functions=60, form_factor=1e-3)
    with pytest.raises(IdentificationError, match='expected a form factor that keeps 60 func'):
        _ = basis.mixing


def test_laguerre_functions_are_orthonormal_and_their_area_is_their_integral():
    basis = LaguerreBasis(8, 38e-3)
    step = 0.1e-3
    values = basis.evaluate(np.arange(step / 2, 2.0, step))
    # The midpoint rule errs by h^2: (0.1 ms / 38 ms)^2 times a curvature that grows with order.
    np.testing.assert_allclose(step * values.T @ values, np.eye(8), atol=1e-3)
    np.testing.assert_allclose(step * values.sum(axis=0), basis.area, rtol=1e-3)


@given(
    first=st.floats(0.0, 0.3), second=st.floats(0.0, 0.3), time_constant=st.floats(15e-3, 60e-3)
)
def test_states_move_as_the_functions_do(first, second, time_constant):
    basis = LaguerreBasis(7, time_constant)
    state = basis.evaluate(first)[0]
    generator = np.empty(7)
    transition_generator(2.0 / time_constant * second, generator)
    advance_state(generator, state)
    # Polynomials of order 6 in up to 2 * 0.6 / 0.015 = 80, damped: a few digits are lost.
    np.testing.assert_allclose(state, basis.evaluate(first + second)[0], atol=1e-9)


def test_nothing_before_the_latency():
    basis = LaguerreBasis(4, 38e-3, 9e-3)
    values = basis.evaluate([-1.0, 0.0, 8.999e-3, 9.001e-3])
    assert not values[:3].any()
    assert values[3].all()


# 0.03 % over the range of the paper's subjects; three hold the twitch of their pole, but for
# rounding
@pytest.mark.parametrize(
    ('functions', 'time_constant', 'error'),
    [(8, 26.7e-3, 5e-4), (8, 38.44e-3, 5e-4), (8, 49.8e-3, 5e-4), (3, 38e-3, 1e-11)],
)
def test_functions_hold_twitches(functions, time_constant, error):
    time = np.arange(0.5e-3, 1.0, 1e-3)
    values, response = LaguerreBasis(functions, 38e-3).evaluate(time), twitch(time, time_constant)
    coefficients = np.linalg.lstsq(values, response, rcond=None)[0]
    left = np.linalg.norm(response - values @ coefficients)
    assert left < error * np.linalg.norm(response)
