# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Distorted sines, Eq. (31): orthonormal on the taps, continuous between them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import trapezoid

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import DistortedSineBasis


def taps_of(basis: DistortedSineBasis) -> np.ndarray:
    return basis.tap * np.arange(1, basis.memory_taps + 1)


def test_area_is_the_integral() -> None:
    basis = DistortedSineBasis()
    lag = np.linspace(0.0, basis.duration, 350_501)
    # midpoint rule of 1 ms against a fine one, for functions of some 50 ms: (1 / 50)^2 / 24
    np.testing.assert_allclose(
        basis.area, trapezoid(basis.evaluate(lag), lag, axis=0), atol=1e-4 * np.abs(basis.area[0])
    )


@settings(deadline=None)
@given(st.floats(1e-6, 1.0, exclude_max=True), st.integers(20, 500))
def test_a_grid_of_any_phase_meets_exactly_the_memory(phase: float, memory: int) -> None:
    basis = DistortedSineBasis(1, memory, memory / 3)
    taps = phase + np.arange(memory + 5) - 1.0
    inside = (taps > 0.5) & (taps <= memory + 0.5)
    assert np.count_nonzero(inside) == memory
    values = basis.evaluate(taps * basis.tap)[:, 0]
    # the first function is a half wave that is never zero inside; ends, where the grid touches the
    # support to 1e-9 of a tap, are rounding's
    clear = np.minimum(np.abs(taps - 0.5), np.abs(taps - memory - 0.5)) > 1e-9
    np.testing.assert_array_equal((values != 0.0)[clear], inside[clear])


def test_values_between_the_taps_lie_between_theirs() -> None:
    basis = DistortedSineBasis()
    taps = taps_of(basis)
    middle = basis.evaluate(taps[:-1] + basis.tap / 2)
    mean = (basis.evaluate(taps[:-1]) + basis.evaluate(taps[1:])) / 2
    # h^2 / 8 times the second derivative: (8 pi / 120)^2 / 8 of the amplitude of 0.2 at worst
    np.testing.assert_allclose(middle, mean, atol=2e-3)


def test_it_vanishes_outside_its_support() -> None:
    basis = DistortedSineBasis()
    outside = basis.evaluate([-0.1, 0.0, 0.5e-3, basis.duration + 1e-6, 10.0])
    np.testing.assert_array_equal(outside, 0.0)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'functions': 0}, 'expected 1 to 350 basis functions, got 0'),
        ({'functions': 351}, 'expected 1 to 350 basis functions, got 351'),
        ({'form_factor': 0.0}, r'expected a form factor above 0, got 0\.0'),
        ({'form_factor': math.nan}, 'expected a form factor above 0, got nan'),
        ({'tap': -1e-3}, r'expected a tap above 0 s, got -0\.001'),
    ],
)
def test_impossible_ones_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        DistortedSineBasis(**values)


def test_dependent_functions_are_refused() -> None:
    basis = DistortedSineBasis(functions=60, form_factor=1e-3)
    with pytest.raises(IdentificationError, match='expected a form factor that keeps 60 func'):
        _ = basis.mixing
