# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Normal equations of a parameter set from the blocks, in the order of time.

The unknowns are ``[theta, w (n), b (m)]``: the recruitment's parameters (the two alpha as
logarithms), the coefficients of the Laguerre functions and the baseline's values at its knots.
With X the lower triangular Toeplitz matrix of the states, a block adds ``X S X^T`` and ``X s_y``
to the equations of the linear unknowns; with v_j the correlation of w with the states'
derivatives, the columns ``psi_j = d(Phi w)/d theta_j`` add ``X S v_j`` and ``v_j^T S v_i``.
"""

import numba
import numpy as np

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE,
    FORCE_TIME,
    RESPONSE_FORCE,
    RESPONSE_ONE,
    RESPONSE_TIME,
    TIME,
    TIME_SQUARED,
)
from rpms_ros.identification.estimation.settings import Baseline
from rpms_ros.pulses import FloatArray

# A prediction continues the slope of the baseline up to this time beyond its knots [ns].
_EXTRAPOLATION_NS = 250_000_000


@numba.njit(cache=True)
def advance_state(generator: FloatArray, state: FloatArray) -> None:
    """Multiply a state (functions,) by the Toeplitz matrix of a generator, in place."""
    for function in range(len(state) - 1, -1, -1):
        total = 0.0
        for shift in range(function + 1):
            total += generator[shift] * state[function - shift]
        state[function] = total


@numba.njit(cache=True)
def correlate(linear: FloatArray, state: FloatArray, values: FloatArray) -> None:
    """Write ``v_k = sum_l w_l z_(l-k)`` (functions,): the force at tau is then v^T e(tau)."""
    count = len(state)
    for shift in range(count):
        total = 0.0
        for function in range(shift, count):
            total += linear[function] * state[function - shift]
        values[shift] = total


@numba.njit(cache=True)
def position_of(stamp_ns: int, baseline: Baseline) -> float:
    """Return a time in distances of the knots, 0 at the first one."""
    value: float = (stamp_ns - baseline.origin_ns) / baseline.spacing_ns
    return value


@numba.njit(cache=True)
def near_knots(position: float, baseline: Baseline) -> float:
    """Return a position limited to `_EXTRAPOLATION_NS` outside the knots.

    The slope is not valid after a gap or a jump of the clock.
    """
    margin = _EXTRAPOLATION_NS / baseline.spacing_ns
    return min(max(position, -margin), 1.0 + margin)


@numba.njit(cache=True)
def hat(knot: int, position: float, baseline: Baseline) -> tuple[float, float]:
    """Return value at a position and slope [1/s] of the hat function of a knot, 0 or 1."""
    steepness = 1e9 / baseline.spacing_ns
    return (position, steepness) if knot else (1.0 - position, -steepness)


@numba.njit(cache=True)
def add_state_terms(
    gram: FloatArray, force: FloatArray, state: FloatArray, matrix: FloatArray, right: FloatArray
) -> None:
    """Add X S X^T and X s_y (`force`); only the lower triangle of `matrix` is written."""
    count = len(state)
    nonlinear = len(right) - count - 2
    product = np.empty((count, count))
    for row in range(count):
        for column in range(count):
            product[row, column] = 0.0
        for shift in range(row + 1):
            weight = state[row - shift]
            for column in range(count):
                product[row, column] += weight * gram[shift, column]
    for row in range(count):
        total = 0.0
        for shift in range(row + 1):
            total += state[row - shift] * force[shift]
        right[nonlinear + row] += total
        for column in range(row + 1):
            total = 0.0
            for shift in range(column + 1):
                total += product[row, shift] * state[column - shift]
            matrix[nonlinear + row, nonlinear + column] += total


@numba.njit(cache=True)
def add_baseline_terms(
    start_ns: int,
    response: FloatArray,
    moments: FloatArray,
    state: FloatArray,
    baseline: Baseline,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add the baseline against itself, the regressors and the force."""
    count = len(state)
    nonlinear = len(right) - count - 2
    position = position_of(start_ns, baseline)
    for offset in range(2):
        value, slope = hat(offset, position, baseline)
        row = nonlinear + count + offset
        right[row] += value * moments[FORCE] + slope * moments[FORCE_TIME]
        for function in range(count):
            total = 0.0
            for shift in range(function + 1):
                total += state[function - shift] * (
                    value * response[shift, RESPONSE_ONE] + slope * response[shift, RESPONSE_TIME]
                )
            matrix[row, nonlinear + function] += total
        for other in range(offset + 1):
            value_2, slope_2 = hat(other, position, baseline)
            matrix[row, nonlinear + count + other] += (
                value * value_2 * moments[COUNT]
                + (value * slope_2 + slope * value_2) * moments[TIME]
                + slope * slope_2 * moments[TIME_SQUARED]
            )


@numba.njit(cache=True)
def advance_states(generator: FloatArray, states: FloatArray) -> None:
    """Advance several states, the columns of (functions, states), in place.

    Here and below the inner loops run over the nonlinear unknowns, which lie side by side: the
    processor does several at once.
    """
    count, unknowns = states.shape
    for function in range(count - 1, -1, -1):
        row = states[function]
        for place in range(unknowns):
            row[place] *= generator[0]
        for shift in range(1, function + 1):
            other, factor = states[function - shift], generator[shift]
            for place in range(unknowns):
                row[place] += factor * other[place]


@numba.njit(cache=True)
def _add_lower_product(left: FloatArray, right: FloatArray, matrix: FloatArray) -> None:
    """Add the lower triangle of left^T right, both (functions, nonlinear)."""
    for row in range(len(left)):
        for other in range(left.shape[1]):
            factor = left[row, other]
            for place in range(other + 1):
                matrix[other, place] += factor * right[row, place]


@numba.njit(cache=True)
def add_gradient_terms(  # noqa: C901 - calls for each row take longer than the sums
    start_ns: int,
    gram: FloatArray,
    response: FloatArray,
    linear: FloatArray,
    state: FloatArray,
    slopes: FloatArray,
    baseline: Baseline,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add psi against psi (lower triangle), the regressors, the baseline and the force.

    `slopes` (functions, nonlinear) are the derivatives of `state` (functions,) by theta.
    """
    count, unknowns = slopes.shape
    # v_j, and S v_j
    values, projected = np.zeros((count, unknowns)), np.zeros((count, unknowns))
    for shift in range(count):
        for function in range(shift, count):
            factor = linear[function]
            for place in range(unknowns):
                values[shift, place] += factor * slopes[function - shift, place]
    for row in range(count):
        for column in range(count):
            factor = gram[row, column]
            for place in range(unknowns):
                projected[row, place] += factor * values[column, place]
    position = position_of(start_ns, baseline)
    for row in range(count):
        force = response[row, RESPONSE_FORCE]
        for place in range(unknowns):
            right[place] += force * values[row, place]
        for shift in range(row + 1):
            factor = state[row - shift]
            for place in range(unknowns):
                matrix[unknowns + row, place] += factor * projected[shift, place]
        for knot in range(2):
            value, slope = hat(knot, position, baseline)
            factor = value * response[row, RESPONSE_ONE] + slope * response[row, RESPONSE_TIME]
            for place in range(unknowns):
                matrix[unknowns + count + knot, place] += factor * values[row, place]
    _add_lower_product(values, projected, matrix)
