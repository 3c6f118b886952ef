# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Normal equations of a parameter set from the blocks, in the order of time.

The unknowns are ``[theta (4), w (n), b (m)]``: the recruitment's parameters (the two alpha as
logarithms), the coefficients of the Laguerre functions and the baseline's values at its knots.
Two passes over the blocks fill one symmetric matrix and one right-hand side:

* `linear_pass`: ``Phi^T Phi`` and ``Phi^T y`` of the linear unknowns.  With X the lower
  triangular Toeplitz matrix of the states, a block adds ``X S X^T`` and ``X s_y``.
* `gradient_pass`: the columns ``psi_j = d(Phi w)/d theta_j`` against all others.  A block adds
  ``X S v_j`` and ``v_j^T S v_i`` with ``v_j`` the correlation of w with the states' derivatives.

A pass takes about 300 multiplications a block with six functions: 20 s at 20 Hz cost
as much as a loop over two thousand samples.
"""

import numba

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE,
    FORCE_SQUARED,
    FORCE_TIME,
    RESPONSE_FORCE,
    RESPONSE_ONE,
    RESPONSE_TIME,
    TIME,
    TIME_SQUARED,
    BlockStatistics,
)
from rpms_ros.identification.estimation.settings import PARAMETERS, BaselineKnots, Pass, Problem
from rpms_ros.muscle.recruitment import arctan_recruitment, arctan_recruitment_with_gradient
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
def knot_of(start_ns: int, baseline: BaselineKnots) -> tuple[int, float]:
    """Return the knot before a time and the position between it and the next one, 0..1."""
    if baseline.knots < 2:
        return 0, 0.0
    ahead = (start_ns - baseline.origin_ns) / baseline.spacing_ns
    knot = min(max(int(ahead), 0), baseline.knots - 2)
    return knot, ahead - knot


@numba.njit(cache=True)
def within_knots(position: float, baseline: BaselineKnots) -> float:
    """Return a position limited to `_EXTRAPOLATION_NS` outside the knots.

    The slope is not valid after a gap or a jump of the clock.
    """
    if baseline.knots < 2:
        return position
    margin = _EXTRAPOLATION_NS / baseline.spacing_ns
    return min(max(position, -margin), 1.0 + margin)


@numba.njit(cache=True)
def hat(offset: int, position: float, baseline: BaselineKnots) -> tuple[float, float]:
    """Return value at a block's start and slope [1/s] of knot `knot_of() + offset`."""
    if baseline.knots < 2:
        return 1.0, 0.0
    steepness = 1e9 / baseline.spacing_ns
    if offset == 0:
        return 1.0 - position, -steepness
    return position, steepness


@numba.njit(cache=True)
def add_state_terms(
    gram: FloatArray,
    response: FloatArray,
    state: FloatArray,
    product: FloatArray,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add X S X^T and X s_y; only the lower triangle of `matrix` is written."""
    count = len(state)
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
            total += state[row - shift] * response[shift, RESPONSE_FORCE]
        right[PARAMETERS + row] += total
        for column in range(row + 1):
            total = 0.0
            for shift in range(column + 1):
                total += product[row, shift] * state[column - shift]
            matrix[PARAMETERS + row, PARAMETERS + column] += total


@numba.njit(cache=True)
def add_baseline_terms(
    start_ns: int,
    response: FloatArray,
    moments: FloatArray,
    state: FloatArray,
    baseline: BaselineKnots,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add the baseline against itself, the regressors and the force."""
    count = len(state)
    first, position = knot_of(start_ns, baseline)
    for offset in range(min(baseline.knots, 2)):
        value, slope = hat(offset, position, baseline)
        row = PARAMETERS + count + first + offset
        right[row] += value * moments[FORCE] + slope * moments[FORCE_TIME]
        for function in range(count):
            total = 0.0
            for shift in range(function + 1):
                total += state[function - shift] * (
                    value * response[shift, RESPONSE_ONE] + slope * response[shift, RESPONSE_TIME]
                )
            matrix[row, PARAMETERS + function] += total
        for other in range(offset + 1):
            value_2, slope_2 = hat(other, position, baseline)
            matrix[row, PARAMETERS + count + first + other] += (
                value * value_2 * moments[COUNT]
                + (value * slope_2 + slope * value_2) * moments[TIME]
                + slope * slope_2 * moments[TIME_SQUARED]
            )


@numba.njit(cache=True)
def linear_pass(
    problem: Problem, last: int, theta: FloatArray, matrix: FloatArray, right: FloatArray
) -> tuple[float, float]:
    """Fill the linear part of the normal equations from blocks first..last-1 of the ring.

    Parameters
    ----------
    first, last : int
        Blocks before `first` only advance the state.
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr.
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Overwritten; lower triangle only.

    Returns
    -------
    tuple of float
        Number of samples and sum of y^2.
    """
    blocks, first, baseline, work = problem.blocks, problem.first, problem.baseline, problem.work
    input_gain = problem.input_gain
    matrix[:] = 0.0
    right[:] = 0.0
    state = work.state[0]
    state[:] = 0.0
    origin = arctan_recruitment(0.0, theta)
    samples = 0.0
    energy = 0.0
    for index in range(last):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], state)
        if blocks.intensity[here] != 0.0:
            state += (
                input_gain
                * blocks.weight[here]
                * (arctan_recruitment(blocks.intensity[here], theta) - origin)
            )
        moments = blocks.moments[here]
        if index < first or moments[COUNT] == 0.0:
            continue
        samples += moments[COUNT]
        energy += moments[FORCE_SQUARED]
        response = blocks.response[here]
        add_state_terms(blocks.gram[here], response, state, work.product, matrix, right)
        if baseline.knots:
            add_baseline_terms(
                blocks.start_ns[here], response, moments, state, baseline, matrix, right
            )
    return samples, energy


@numba.njit(cache=True)
def advance_gradient(
    blocks: BlockStatistics,
    here: int,
    theta: FloatArray,
    origin: float,
    input_gain: float,
    work: Pass,
) -> None:
    """Advance states and derivatives (by log alpha) to a block, its pulse included."""
    for row in range(1 + PARAMETERS):
        advance_state(blocks.transition[here], work.state[row])
    intensity = blocks.intensity[here]
    if intensity == 0.0:
        return
    rho = arctan_recruitment_with_gradient(intensity, theta, work.slope) - origin
    push = input_gain * blocks.weight[here]
    work.state[0] += push * rho
    for place in range(PARAMETERS):
        scale = theta[place] if place >= 2 else 1.0
        slope = scale * (work.slope[place] - work.origin_slope[place])
        work.state[1 + place] += push * slope


@numba.njit(cache=True)
def add_gradient_terms(
    gram: FloatArray,
    response: FloatArray,
    linear: FloatArray,
    work: Pass,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add psi against psi, the regressors and the force."""
    count = len(linear)
    state = work.state
    values = work.correlated
    projected = work.projected
    for place in range(PARAMETERS):
        for shift in range(count):
            total = 0.0
            for function in range(shift, count):
                total += linear[function] * state[1 + place, function - shift]
            values[1 + place, shift] = total
        force = 0.0
        for row in range(count):
            total = 0.0
            for column in range(count):
                total += gram[row, column] * values[1 + place, column]
            projected[place, row] = total
            force += values[1 + place, row] * response[row, RESPONSE_FORCE]
        right[place] += force
        for function in range(count):
            total = 0.0
            for shift in range(function + 1):
                total += state[0, function - shift] * projected[place, shift]
            matrix[PARAMETERS + function, place] += total
        for other in range(place + 1):
            total = 0.0
            for row in range(count):
                total += values[1 + other, row] * projected[place, row]
            matrix[place, other] += total


@numba.njit(cache=True)
def add_gradient_baseline_terms(
    start_ns: int, response: FloatArray, baseline: BaselineKnots, work: Pass, matrix: FloatArray
) -> None:
    """Add psi, whose correlations `add_gradient_terms` left in `work`, against the baseline."""
    count = response.shape[0]
    knot, position = knot_of(start_ns, baseline)
    for offset in range(min(baseline.knots, 2)):
        value, slope = hat(offset, position, baseline)
        row = PARAMETERS + count + knot + offset
        for place in range(PARAMETERS):
            total = 0.0
            for shift in range(count):
                total += work.correlated[1 + place, shift] * (
                    value * response[shift, RESPONSE_ONE] + slope * response[shift, RESPONSE_TIME]
                )
            matrix[row, place] += total


@numba.njit(cache=True)
def gradient_pass(
    problem: Problem,
    last: int,
    theta: FloatArray,
    linear: FloatArray,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Add the rows and columns of theta to the result of `linear_pass` at the same parameters.

    `linear` (functions,) are the coefficients w at which the derivatives are taken.
    """
    blocks, first, baseline, work = problem.blocks, problem.first, problem.baseline, problem.work
    work.state[:] = 0.0
    origin = arctan_recruitment_with_gradient(0.0, theta, work.origin_slope)
    for index in range(last):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_gradient(blocks, here, theta, origin, problem.input_gain, work)
        if index < first or blocks.moments[here, COUNT] == 0.0:
            continue
        response = blocks.response[here]
        add_gradient_terms(blocks.gram[here], response, linear, work, matrix, right)
        if not baseline.knots:
            continue
        add_gradient_baseline_terms(blocks.start_ns[here], response, baseline, work, matrix)
