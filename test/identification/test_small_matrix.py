# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled algebra of small matrices against NumPy's."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from rpms_ros.identification.model.levenberg_marquardt import condition_number, dot, solve_positive

squares = st.integers(1, 5).flatmap(
    lambda n: arrays(np.float64, (n, n), elements=st.floats(-9, 9))
)


def test_dot() -> None:
    generator = np.random.default_rng(1)
    left, right = generator.normal(size=(2, 8))
    # eight products: a few epsilon
    assert dot(left, right) == pytest.approx(left @ right, rel=1e-14, abs=1e-14)


@settings(deadline=None)
@given(squares)
def test_solve(square: np.ndarray) -> None:
    matrix = square @ square.T + np.eye(len(square))
    vector = np.arange(1.0, len(square) + 1)
    solution = vector.copy()
    assert solve_positive(matrix.copy(), solution)
    # condition number up to 5 * 5 * 81: 2000 epsilon and some
    np.testing.assert_allclose(matrix @ solution, vector, atol=1e-10)


@pytest.mark.parametrize('diagonal', [[1.0, -1.0], [0.0, 1.0], [float('nan'), 1.0]])
def test_what_is_not_positive_gives_no_step(diagonal: list[float]) -> None:
    vector = np.ones(2)
    assert not solve_positive(np.diag(diagonal), vector)
    np.testing.assert_array_equal(vector, 0.0)


@settings(deadline=None)
@given(squares)
def test_condition_number(square: np.ndarray) -> None:
    matrix = square + square.T + 0.5 * np.eye(len(square))
    singular = np.linalg.svd(matrix, compute_uv=False)
    before = matrix.copy()
    found = condition_number(matrix, np.empty_like(matrix))
    if singular[0] < 1e6 * singular[-1]:
        # the smallest singular value is known to epsilon times the largest: 1e-16 * 1e6
        assert found == pytest.approx(singular[0] / singular[-1], rel=1e-8)
    else:
        assert found > 0.9e6
    np.testing.assert_array_equal(matrix, before)


def test_singular_matrices_have_an_infinite_one() -> None:
    assert condition_number(np.diag([1.0, 0.0]), np.empty((2, 2))) == np.inf
