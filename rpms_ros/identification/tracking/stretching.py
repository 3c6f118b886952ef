# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""A response of Laguerre functions, stretched in time.

D is the derivative of the functions by the logarithm of their time constant,

.. math:: D \phi_k = \tfrac12 \left( k \phi_{k-1} - (k + 1) \phi_{k+1} \right),

so ``e^(delta D)`` stretches a response by ``e^delta``; the series is cut off at the number of
functions.
"""

import numba
import numpy as np

from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.pulses import FloatArray

# Of the exponential series: the time constant changes by less than a factor of 2.
_TERMS, _LAST_TERM = 16, 1e-10
NO_SLOWING = 1e-5
"""A change of the time constant by a thousandth of a percent makes no difference."""


@numba.njit(cache=True)
def slowed(linear: FloatArray) -> FloatArray:
    """Return D w (functions,), truncated to the number of functions."""
    count = len(linear)
    result = np.zeros(count)
    for index in range(count):
        if index + 1 < count:
            result[index] += 0.5 * (index + 1) * linear[index + 1]
        if index > 0:
            result[index] -= 0.5 * index * linear[index - 1]
    return result


@numba.njit(cache=True)
def stretched(linear: FloatArray, slowing: float) -> FloatArray:
    """Return w (functions,) with its response stretched in time by ``e^slowing``."""
    term, total = linear.copy(), linear.copy()
    if abs(slowing) < NO_SLOWING:
        return total
    for order in range(1, _TERMS):
        term = slowed(term) * (slowing / order)
        total += term
        if np.abs(term).max() < _LAST_TERM:
            break
    return total


@numba.njit(cache=True)
def stretching_powers(functions: int) -> FloatArray:
    """Return the terms of ``e^D`` (terms, functions, functions)."""
    powers = np.zeros((_TERMS, functions, functions))
    for function in range(functions):
        powers[0, function, function] = 1.0
    for order in range(1, _TERMS):
        for function in range(functions):
            column = np.ascontiguousarray(powers[order - 1, :, function])
            powers[order, :, function] = slowed(column) / order
    return powers


@numba.njit(cache=True)
def _stretching(slowing: float, powers: FloatArray) -> FloatArray:
    """Return ``e^(slowing D)`` (functions, functions)."""
    matrix: FloatArray = powers[0].copy()
    factor = 1.0
    for order in range(1, _TERMS):
        factor *= slowing
        matrix += factor * powers[order]
        if abs(factor) < _LAST_TERM:
            break
    return matrix


@numba.njit(cache=True)
def stretched_columns(
    gram: FloatArray, right: FloatArray, slowing: float, powers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of an interval with the columns of w stretched in time.

    Parameters
    ----------
    gram, right : ndarray (columns, columns), (columns,)
        Sums of an interval, see `Intervals`.
    slowing : float
        Logarithm of the relative time constant.
    powers : ndarray (terms, functions, functions)
        See `stretching_powers`.
    """
    functions = powers.shape[1]
    matrix = _stretching(slowing, powers)
    part = slice(PARAMETERS, PARAMETERS + functions)
    # columns first, rows after
    half, changed = gram.copy(), right.copy()
    for row in range(len(right)):
        for column in range(functions):
            total = 0.0
            for inner in range(functions):
                total += gram[row, PARAMETERS + inner] * matrix[inner, column]
            half[row, PARAMETERS + column] = total
    both = half.copy()
    both[part] = 0.0
    changed[part] = 0.0
    for inner in range(functions):
        for column in range(functions):
            changed[PARAMETERS + column] += matrix[inner, column] * right[PARAMETERS + inner]
            both[PARAMETERS + column] += matrix[inner, column] * half[PARAMETERS + inner]
    return both, changed
