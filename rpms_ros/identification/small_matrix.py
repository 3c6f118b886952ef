# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled algebra of symmetric matrices of a few rows, without allocation.

LAPACK's calls cost more than the arithmetic at this size; numba offers them with allocation only.
"""

import math

import numba

from rpms_ros.pulses import FloatArray

# Off-diagonal elements this small do not change a digit of a condition number below 1e6.
_NEGLIGIBLE = 1e-12


@numba.njit(cache=True)
def dot(left: FloatArray, right: FloatArray) -> float:
    """Return the inner product of two vectors (n,), summed from the first element on."""
    total = 0.0
    for index in range(len(left)):
        total += left[index] * right[index]
    return total


@numba.njit(cache=True)
def solve_positive(matrix: FloatArray, vector: FloatArray) -> bool:
    """Solve ``matrix x = vector`` by Cholesky, in place in both; return whether it is positive.

    Parameters
    ----------
    matrix : ndarray (n, n)
        Symmetric; its lower triangle is overwritten by the factor.
    vector : ndarray (n,)
        Right-hand side, overwritten by the solution; zeros if the matrix is not positive.
    """
    if not factorise_positive(matrix):
        vector[:] = 0.0
        return False
    solve_factorised(matrix, vector)
    return True


@numba.njit(cache=True)
def factorise_positive(matrix: FloatArray) -> bool:
    """Put the Cholesky factor (n, n) in the lower triangle; return whether there is one."""
    count = len(matrix)
    for column in range(count):
        pivot = matrix[column, column]
        for inner in range(column):
            pivot -= matrix[column, inner] * matrix[column, inner]
        if not pivot > 0.0:
            return False
        pivot = math.sqrt(pivot)
        matrix[column, column] = pivot
        for row in range(column + 1, count):
            total = matrix[row, column]
            for inner in range(column):
                total -= matrix[row, inner] * matrix[column, inner]
            matrix[row, column] = total / pivot
    return True


@numba.njit(cache=True)
def solve_factorised(matrix: FloatArray, vector: FloatArray) -> None:
    """Solve for a right-hand side (n,), in place, with the factor of `factorise_positive`."""
    count = len(vector)
    for row in range(count):
        for inner in range(row):
            vector[row] -= matrix[row, inner] * vector[inner]
        vector[row] /= matrix[row, row]
    for row in range(count - 1, -1, -1):
        for inner in range(row + 1, count):
            vector[row] -= matrix[inner, row] * vector[inner]
        vector[row] /= matrix[row, row]


@numba.njit(cache=True)
def _rotate(work: FloatArray, low: int, high: int) -> None:
    """Annul work[low, high] of a symmetric matrix by one Jacobi rotation, in place."""
    coupling = work[low, high]
    if coupling == 0.0:
        return
    ratio = (work[high, high] - work[low, low]) / (2.0 * coupling)
    tangent = 1.0 / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
    if ratio < 0.0:
        tangent = -tangent
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    work[low, low] -= tangent * coupling
    work[high, high] += tangent * coupling
    work[low, high] = 0.0
    work[high, low] = 0.0
    for index in range(len(work)):
        if index in (low, high):
            continue
        left = work[index, low]
        right = work[index, high]
        work[index, low] = work[low, index] = cosine * left - sine * right
        work[index, high] = work[high, index] = sine * left + cosine * right


@numba.njit(cache=True)
def condition_number(matrix: FloatArray, work: FloatArray) -> float:
    """Return the ratio of the largest to the smallest singular value of a symmetric matrix.

    Singular values of a symmetric matrix are the magnitudes of its eigenvalues, found by cyclic
    Jacobi rotations, whose error falls quadratically: at three or four rows, five sweeps reach
    working precision.  Infinite if singular.

    Parameters
    ----------
    matrix : ndarray (n, n)
        Symmetric, not changed.
    work : ndarray (n, n)
        Overwritten.
    """
    work[:] = matrix
    count = len(work)
    for _ in range(5):
        coupling = 0.0
        size = 0.0
        for low in range(count):
            size += abs(work[low, low])
            for high in range(low + 1, count):
                coupling += abs(work[low, high])
        if coupling <= _NEGLIGIBLE * size:
            break
        for low in range(count):
            for high in range(low + 1, count):
                _rotate(work, low, high)
    largest = 0.0
    smallest = math.inf
    for index in range(count):
        magnitude = abs(work[index, index])
        largest = max(largest, magnitude)
        smallest = min(smallest, magnitude)
    return largest / smallest if smallest > 0.0 else math.inf
