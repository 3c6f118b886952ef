# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Normal equations of a muscle that changes slowly under a disturbance, from the intervals.

The force of interval j, whose middle lies ``a_j`` intervals before now, is

.. math:: f_j = (1 + \gamma_j) Z e^{\delta_j D} w + B b

with the *present* w, gamma the relative change of the force and delta the change of the logarithm
of the time constant against now (piecewise linear in a, 0 at a = 0), and b a piecewise linear
disturbance.  Z holds pulses as the theta of their time recruits them, ``theta + sigma``: sigma is
the change of u_thr and u_sat against now (piecewise linear in a too).  D is the derivative of the
Laguerre functions by the logarithm of their time constant, so ``e^(delta D)`` stretches a response
in time,

.. math:: D \phi_k = \tfrac12 \left( k \phi_{k-1} - (k + 1) \phi_{k+1} \right) ,

a series that is cut off at the number of functions.

The unknowns ``x = [theta, w, gamma, delta, sigma]`` are few; b has a knot at the end of every
interval and is eliminated, which costs a few hundred multiplications an interval because its
second differences and the intervals couple three neighbours only.

**Intervals.** Within an interval of a fraction of a second the muscle is constant, so gain,
time constant and disturbance may differ from one interval to the next, and each interval needs
one small matrix: ``G = L^T L`` and ``r = L^T y`` with the columns

.. math:: L = [\psi_1 .. \psi_m,\; z_1 .. z_n,\; h_0,\; h_1]

where psi are the derivatives of the force by theta (alpha as logarithms), z the regressors of
the coefficients w, and h the two hats of a piecewise linear baseline whose knots are the
interval's ends. Any model whose force is a combination of these columns, with factors that
change from interval to interval, is fitted from them without the samples.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE_SQUARED,
    RESPONSE_FORCE,
    newest,
    without_force,
)
from rpms_ros.identification.estimation.normal_equations import (
    add_baseline_terms,
    add_gradient_terms,
    add_state_terms,
    advance_state,
    advance_states,
    correlate,
)
from rpms_ros.identification.estimation.settings import Baseline, Problem
from rpms_ros.identification.model.recruitment import PARAMETERS, counted, counted_with_gradient
from rpms_ros.pulses import FloatArray, IntArray

# Of the exponential series: the time constant changes by less than a factor of 2.
_TERMS, _LAST_TERM = 16, 1e-10
MOVING = 2
"""Elements of theta that change slowly: u_thr, u_sat."""
# A change of the time constant by a thousandth of a percent makes no difference.
_NO_SLOWING = 1e-5


@numba.njit(cache=True)
def time_scale_derivative(linear: FloatArray) -> FloatArray:
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
def time_scaled(linear: FloatArray, slowing: float) -> FloatArray:
    """Return w (functions,) with its response stretched in time by ``e^slowing``."""
    term, total = linear.copy(), linear.copy()
    if abs(slowing) < _NO_SLOWING:
        return total
    for order in range(1, _TERMS):
        term = time_scale_derivative(term) * (slowing / order)
        total += term
        if np.abs(term).max() < _LAST_TERM:
            break
    return total


@numba.njit(cache=True)
def time_scaling_terms(functions: int) -> FloatArray:
    """Return the terms of ``e^D`` (terms, functions, functions)."""
    powers = np.zeros((_TERMS, functions, functions))
    for function in range(functions):
        powers[0, function, function] = 1.0
    for order in range(1, _TERMS):
        for function in range(functions):
            column = np.ascontiguousarray(powers[order - 1, :, function])
            powers[order, :, function] = time_scale_derivative(column) / order
    return powers


@numba.njit(cache=True)
def _time_scaling(slowing: float, powers: FloatArray) -> FloatArray:
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
def time_scaled_columns(
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
        See `time_scaling_terms`.
    """
    functions = powers.shape[1]
    matrix = _time_scaling(slowing, powers)
    first = len(right) - functions - 2
    last = first + functions
    both, changed = gram.copy(), right.copy()
    both[first:last] = 0.0
    changed[first:last] = 0.0
    for inner in range(functions):
        for row in range(functions):
            factor = matrix[inner, row]
            changed[first + row] += factor * right[first + inner]
            for column in range(len(right)):
                both[first + row, column] += factor * gram[first + inner, column]
    for row in range(functions):
        rows = both[first + row, first:last].copy()
        both[first + row, first:last] = 0.0
        for inner in range(functions):
            for column in range(functions):
                both[first + row, first + column] += rows[inner] * matrix[inner, column]
    both[:first, first:last] = both[first:last, :first].T
    both[last:, first:last] = both[first:last, last:].T
    return both, changed


class Intervals(NamedTuple):
    """Intervals of a window, oldest first; one that holds no sample is zero.

    Attributes
    ----------
    first : ndarray of int64 (1,)
        Number of the first one: it begins at this many lengths.
    gram : ndarray (intervals, columns, columns)
        L^T L, symmetric; columns of theta, w, and two of the disturbance.
    right : ndarray (intervals, columns)
        L^T y.
    energy, samples : ndarray (intervals,)
        Sum of y^2 [N^2], number of samples.
    """

    first: IntArray
    gram: FloatArray
    right: FloatArray
    energy: FloatArray
    samples: FloatArray

    def without(self, places: IntArray) -> 'Intervals':
        """Return the same without the samples of those at some places."""
        places = places[(places >= 0) & (places < len(self.samples))]
        if not len(places):
            return self
        kept = [values.copy() for values in self[1:]]
        for values in kept:
            values[places] = 0.0
        return Intervals(self.first, *kept)


@numba.njit(cache=True)
def empty_intervals(count: int, columns: int, first: int) -> Intervals:
    """Return so many intervals without a sample."""
    return Intervals(
        first=np.array([first], dtype=np.int64),
        gram=np.zeros((count, columns, columns)),
        right=np.zeros((count, columns)),
        energy=np.zeros(count),
        samples=np.zeros(count),
    )


class Origin(NamedTuple):
    """A sudden change: earlier pulses act as before.

    Attributes
    ----------
    stamp_ns : int
        Time of the change [ns]; before every pulse if there was none.
    theta, linear : ndarray (nonlinear,), (functions,)
        The muscle before it.
    """

    stamp_ns: int
    theta: FloatArray
    linear: FloatArray


def no_change(functions: int) -> Origin:
    """Return the origin of a muscle that has not changed."""
    return Origin(-(2**62), np.ones(PARAMETERS + 2), np.zeros(functions))


@numba.njit(cache=True)
def _in_knots(times: FloatArray, age: float) -> float:
    """Return an age, in intervals, counted in knots (see `Point`).

    Beyond the last one as between the last two.
    """
    if len(times) < 2:
        return 0.0
    knot = 1
    while knot < len(times) - 1 and times[0] - times[knot] < age:
        knot += 1
    share = (age - times[0] + times[knot - 1]) / (times[knot - 1] - times[knot])
    return float(knot - 1 + share)


@numba.njit(cache=True)
def ages_in_knots(times: FloatArray, first: int, count: int) -> FloatArray:
    """Return how long before now the muscle was as intervals from number `first` on show it."""
    ages = np.empty(count)
    for index in range(count):
        ages[index] = _in_knots(times, max(times[0] - first - (index + 0.5), 0.0))
    return ages


@numba.njit(cache=True)
def condensed(
    problem: Problem, point: 'Point', first_ns: int, now_ns: int, length_ns: int, origin: Origin
) -> Intervals:
    """Return the intervals of the blocks `problem.first`.. at a point.

    Parameters
    ----------
    problem : Problem
        Blocks; those before `first` only advance the state.
    point : Point
        Point of linearisation; of it, theta, its change and w are used.
    first_ns, now_ns, length_ns : int
        Beginning of the first block, when theta holds, and length of an interval [ns].
    origin : Origin
        The force of pulses before it is subtracted from the samples.
    """
    blocks, theta, linear = problem.blocks, point.theta, point.linear
    last_ns = blocks.start_ns[newest(blocks)]
    first = first_ns // length_ns
    nonlinear, functions = len(theta), len(linear)
    columns = nonlinear + functions + 2
    intervals = empty_intervals(last_ns // length_ns - first + 1, columns, first)
    state, slope = np.zeros(functions), np.zeros(nonlinear)
    slopes = np.zeros((functions, nonlinear))
    before, values = np.zeros(functions), np.zeros(functions)
    cleaned, rest = np.zeros((functions, 3)), np.zeros(blocks.moments.shape[1])
    then = theta.copy()
    most = len(intervals.samples) - 1
    for index in range(blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        start_ns = blocks.start_ns[here]
        advance_state(blocks.transition[here], before)
        if start_ns < origin.stamp_ns:
            if blocks.intensity[here] != 0.0:
                before += problem.input_gain * counted(
                    blocks.intensity[here], blocks.weight[here], origin.theta
                )
            continue
        advance_state(blocks.transition[here], state)
        advance_states(blocks.transition[here], slopes)
        if blocks.intensity[here] != 0.0:
            position = _in_knots(point.times, max(now_ns - start_ns, 0) / length_ns)
            for place in range(MOVING):
                then[place] = point.theta[place] + _at_age(point.thresholds[place], position)
            state += problem.input_gain * counted_with_gradient(
                blocks.intensity[here], blocks.weight[here], then, slope
            )
            slopes += problem.input_gain * slope
        if index < problem.first or blocks.moments[here, COUNT] == 0.0:
            continue
        response, moments = blocks.response[here], blocks.moments[here]
        if before.any():
            correlate(origin.linear, before, values)
            without_force(blocks, here, values, cleaned, rest)
            response, moments = cleaned, rest
        number = start_ns // length_ns
        place = min(max(number - intervals.first[0], 0), most)
        baseline = Baseline(number * length_ns, length_ns)
        gram, right = intervals.gram[place], intervals.right[place]
        intervals.samples[place] += moments[COUNT]
        intervals.energy[place] += moments[FORCE_SQUARED]
        sums = blocks.gram[here]
        add_state_terms(sums, response[:, RESPONSE_FORCE], state, gram, right)
        add_baseline_terms(start_ns, response, moments, state, baseline, gram, right)
        add_gradient_terms(start_ns, sums, response, linear, state, slopes, baseline, gram, right)
    for place in range(len(intervals.samples)):
        gram = intervals.gram[place]
        for row in range(len(gram)):
            gram[:row, row] = gram[row, :row]
    return intervals


class Point(NamedTuple):
    """Point of linearisation: the present muscle and its slow change.

    Attributes
    ----------
    theta : ndarray (nonlinear,)
        u_thr, u_sat, alpha_sat, alpha_thr, deviation c and kappa now.
    linear : ndarray (functions,)
        w now.
    gain, slowing : ndarray (knots,)
        Relative change of the force and change of the logarithm of the time constant at the
        knots, against now.
    thresholds : ndarray (2, knots)
        Change of u_thr and u_sat at the knots, against now.
    times : ndarray (1 + knots,)
        When now is and the knots are, newest first, in intervals.
    """

    theta: FloatArray
    linear: FloatArray
    gain: FloatArray
    slowing: FloatArray
    thresholds: FloatArray
    times: FloatArray

    @property
    def changes(self) -> FloatArray:
        """Gain, slowing, u_thr and u_sat at the knots, against now (4, knots)."""
        return np.vstack((self.gain, self.slowing, self.thresholds))

    @property
    def speed(self) -> FloatArray:
        """Their change with the age, per interval, since the newest knot (4,)."""
        if len(self.times) < 2:
            return np.zeros(2 + MOVING)
        speed: FloatArray = self.changes[:, 0] / (self.times[0] - self.times[1])
        return speed

    def at_times(self, times: FloatArray) -> 'Point':
        """Return the point with its slow change at other knots (1 + knots,)."""
        gain, slowing, *thresholds = (
            np.interp(times[1:], self.times[::-1], np.concatenate((values[::-1], [0.0])))
            for values in self.changes
        )
        return Point(self.theta, self.linear, gain, slowing, np.array(thresholds), times)


class Equations(NamedTuple):
    """Normal equations of a window, not scaled by the variance.

    Attributes
    ----------
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Part of x, symmetric; the right-hand side is that of the residual at the point with b = 0.
    coupling : ndarray (knots, unknowns + 1)
        Part of each knot of the disturbance with x, and its right-hand side.
    band : ndarray (knots, 3)
        Part of each knot with itself and the next two.
    energy : ndarray (1,)
        Sum of the squared residuals at the point with b = 0 [N^2].
    """

    matrix: FloatArray
    right: FloatArray
    coupling: FloatArray
    band: FloatArray
    energy: FloatArray


def steady(theta: FloatArray, linear: FloatArray) -> Point:
    """Return a point at which nothing changes."""
    none = np.zeros(0)
    return Point(theta.copy(), linear.copy(), none, none, np.zeros((MOVING, 0)), np.zeros(1))


@numba.njit(cache=True)
def unknowns_of(point: Point) -> int:
    """Return the number of unknowns in x."""
    count: int = len(point.theta) + len(point.linear) + (2 + MOVING) * len(point.gain)
    return count


@numba.njit(cache=True)
def _at_age(knots: FloatArray, position: float) -> float:
    """Return a piecewise linear function of the age that is 0 at 0 and has knots at 1, 2, ..."""
    count = len(knots)
    if count == 0:
        return 0.0
    knot = min(int(position), count - 1)
    share = position - knot
    low = knots[knot - 1] if knot > 0 else 0.0
    return (1.0 - share) * low + share * float(knots[knot])


@numba.njit(cache=True)
def at_ages(knots: FloatArray, position: FloatArray) -> FloatArray:
    """Return `_at_age` at positions (n,), in knots."""
    values = np.empty(len(position))
    for index in range(len(position)):
        values[index] = _at_age(knots, position[index])
    return values


@numba.njit(cache=True)
def _add_now(
    gram: FloatArray, rest: FloatArray, gain: float, index: int, local: int, equations: Equations
) -> None:
    """Add theta, w and the disturbance of an interval; `rest` is what is left of the samples."""
    squared = gain * gain
    for row in range(local):
        equations.right[row] += gain * rest[row]
        for column in range(row + 1):
            equations.matrix[row, column] += squared * gram[row, column]
        for hat in range(2):
            equations.coupling[index + hat, row] += gain * gram[local + hat, row]
    for hat in range(2):
        equations.coupling[index + hat, -1] += rest[local + hat]
        equations.band[index + hat, 0] += gram[local + hat, local + hat]
    equations.band[index, 1] += gram[local, local + 1]


@numba.njit(cache=True)
def _add_past(
    products: FloatArray,
    rests: FloatArray,
    squares: FloatArray,
    gain: float,
    index: int,
    position: float,
    equations: Equations,
) -> None:
    """Add the slow changes that act in an interval, at the two knots beside its age.

    Parameters
    ----------
    products, rests, squares : ndarray (4, local + 2), (4,), (4, 4)
        Columns of gain, slowing, u_thr and u_sat: against those of the interval, what is left of
        its samples, and one another.
    gain : float
        Of the interval.
    index : int
        Its number in the window.
    position : float
        Its age, counted in knots.
    equations : Equations
        To which they are added.
    """
    kinds, local = len(products), products.shape[1] - 2
    knots = (len(equations.right) - local) // kinds
    knot = min(int(position), knots - 1)
    share = position - knot
    for side in range(2):
        if knot - 1 + side < 0:
            continue
        hat = share if side else 1.0 - share
        for kind in range(kinds):
            row, product = local + kind * knots + knot - 1 + side, products[kind]
            equations.right[row] += hat * rests[kind]
            for column in range(local):
                equations.matrix[row, column] += (hat * gain) * product[column]
            for end in range(2):
                equations.coupling[index + end, row] += hat * product[local + end]
            for other in range(kinds):
                column = local + other * knots + knot - 1 + side
                equations.matrix[row, column] += hat * hat * squares[kind, other]
                if side and knot > 0:
                    equations.matrix[row, column - 1] += hat * (1.0 - hat) * squares[kind, other]
                    equations.matrix[row - 1, column] += hat * (1.0 - hat) * squares[kind, other]


@numba.njit(cache=True)
def _columns_of_changes(point: Point) -> tuple[FloatArray, IntArray]:
    """Return the columns (4, columns) of gain, slowing, u_thr and u_sat.

    By those of an interval, and where each begins and ends.  If nothing changes only the first,
    that of the force.
    """
    nonlinear, local = len(point.theta), len(point.theta) + len(point.linear)
    columns = np.zeros((2 + MOVING, local + 2))
    columns[0, nonlinear:local] = point.linear
    # D commutes with its exponential
    columns[1, nonlinear:local] = time_scale_derivative(point.linear)
    bounds = np.array([[nonlinear, local]] * 2 + [[0, 1]] * MOVING)
    for moving in range(MOVING):
        columns[2 + moving, moving] = 1.0
        bounds[2 + moving] += moving
    used = 2 + MOVING if len(point.gain) else 1
    return columns[:used], bounds[:used]


@numba.njit(cache=True)
def _multiply(
    columns: FloatArray, bounds: IntArray, gain: float, sums: FloatArray, products: FloatArray
) -> None:
    """Write columns times sums (columns, n) into products; all but the force by the gain."""
    products[:] = 0.0
    for kind in range(len(columns)):
        factor = gain if kind else 1.0
        for row in range(bounds[kind, 0], bounds[kind, 1]):
            value = factor * columns[kind, row]
            for column in range(sums.shape[1]):
                products[kind, column] += value * sums[row, column]


@numba.njit(cache=True)
def assembled(intervals: Intervals, point: Point, position: FloatArray) -> Equations:
    """Return the equations of a window.

    Parameters
    ----------
    intervals : Intervals
        At the point's theta and w.
    point : Point
        Point of linearisation.
    position : ndarray (intervals,)
        Age of the muscle that an interval shows, counted in knots of the slow change.
    """
    unknowns, ends = unknowns_of(point), len(intervals.samples) + 1
    matrix, right_hand = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    coupling, band = np.zeros((ends, unknowns + 1)), np.zeros((ends, 3))
    equations = Equations(matrix, right_hand, coupling, band, np.zeros(1))
    local = len(point.theta) + len(point.linear)
    powers = time_scaling_terms(len(point.linear))
    columns, bounds = _columns_of_changes(point)
    kinds = len(columns)
    products, rests = np.zeros((kinds, local + 2)), np.zeros((kinds, 1))
    squares = np.zeros((kinds, kinds))
    for index in range(len(intervals.samples)):
        if intervals.samples[index] == 0.0:
            continue
        gain = 1.0 + _at_age(point.gain, position[index])
        delay = _at_age(point.slowing, position[index])
        gram, right = intervals.gram[index], intervals.right[index]
        if abs(delay) >= _NO_SLOWING:
            gram, right = time_scaled_columns(gram, right, delay, powers)
        _multiply(columns, bounds, gain, gram, products)
        # right-hand side of the residual at the point, by the columns of the interval
        rest = right - gain * products[0]
        equations.energy[0] += intervals.energy[index]
        for row in range(bounds[0, 0], bounds[0, 1]):
            equations.energy[0] -= gain * columns[0, row] * (right[row] + rest[row])
        _add_now(gram, rest, gain, index, local, equations)
        if kinds > 1:
            _multiply(columns, bounds, gain, rest.reshape(-1, 1), rests)
            _multiply(columns, bounds, gain, products.T, squares)
            _add_past(products, rests[:, 0], squares, gain, index, position[index], equations)
    for row in range(unknowns):
        matrix[:row, row] = matrix[row, :row]
    return equations


class Reduced(NamedTuple):
    """Equations of x with the disturbance eliminated, in units of the residuals' variance.

    Attributes
    ----------
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Information about x and minus half the gradient of the cost.
    cost : ndarray (1,)
        Cost at the point, with the best disturbance.
    evidence : ndarray (1,)
        Logarithm of the factor that the disturbance gives to the evidence.
    factor : ndarray (knots + 1, unknowns + 5)
        Rows from which the disturbance follows: coupling with x and with its mean, right-hand
        side, with the next two knots, and pivot; the last row is that of the mean.
    """

    matrix: FloatArray
    right: FloatArray
    cost: FloatArray
    evidence: FloatArray
    factor: FloatArray


class Roughness(NamedTuple):
    """Prior of the course of the disturbance.

    Attributes
    ----------
    first, second : ndarray (knots,)
        Information about the increment after each knot, and about the second difference around
        it [1/N^2]; the first may be zero everywhere.
    extent : float
        Information about the distance of each knot from a mean that is not known [1/N^2].
    """

    first: FloatArray
    second: FloatArray
    extent: float


@numba.njit(cache=True)
def shares_of_prior(rough: Roughness) -> tuple[FloatArray, float]:
    """Return how much of what is known of a difference its own prior says, without samples.

    What the extent says is not counted.

    Returns
    -------
    shares : ndarray (2, knots)
        Of increments and of second differences, between 0 and 1.
    logarithm : float
        Log-determinant of the information about the increments.
    """
    count = len(rough.first) - 1
    pivot, beside = rough.first[:count].copy(), np.zeros(count)
    for middle in range(1, count):
        pivot[middle - 1] += rough.second[middle]
        pivot[middle] += rough.second[middle]
        beside[middle - 1] = -rough.second[middle]
    logarithm = 0.0
    for index in range(count):
        if index:
            pivot[index] -= beside[index - 1] ** 2 / pivot[index - 1]
        logarithm += np.log(pivot[index])
    shares, newer = np.ones((2, count + 1)), 0.0
    for index in range(count - 1, -1, -1):
        ratio = beside[index] / pivot[index]
        variance = 1.0 / pivot[index] + ratio * ratio * newer
        spread = variance + newer + 2.0 * ratio * newer
        shares[0, index] = rough.first[index] * variance
        shares[1, index + 1] = rough.second[index + 1] * spread
        newer = variance
    return shares, logarithm


@numba.njit(cache=True)
def _add_roughness(rough: Roughness, unknowns: int, factor: FloatArray) -> None:
    """Add the prior of the course; the last of the unknowns is the mean."""
    ahead, pivot = unknowns + 1, unknowns + 3
    for knot in range(len(factor)):
        factor[knot, unknowns - 1] -= rough.extent
        factor[knot, pivot] += rough.extent
    for knot in range(len(factor) - 1):
        value = rough.first[knot]
        factor[knot, pivot] += value
        factor[knot + 1, pivot] += value
        factor[knot, ahead] -= value
    for middle in range(1, len(factor) - 1):
        value = rough.second[middle]
        factor[middle - 1, pivot] += value
        factor[middle, pivot] += 4.0 * value
        factor[middle + 1, pivot] += value
        factor[middle - 1, ahead] -= 2.0 * value
        factor[middle, ahead] -= 2.0 * value
        factor[middle - 1, ahead + 1] += value


@numba.njit(cache=True)
def _pass_on(factor: FloatArray, knot: int, unknowns: int) -> None:
    """Eliminate a knot from the rows of the next two."""
    ahead, pivot = unknowns + 1, unknowns + 3
    inverse = 1.0 / factor[knot, pivot]
    for step in range(1, min(3, len(factor) - knot)):
        share = factor[knot, ahead + step - 1] * inverse
        for column in range(unknowns + 1):
            factor[knot + step, column] -= share * factor[knot, column]
        factor[knot + step, pivot] -= share * factor[knot, ahead + step - 1]
        if step == 1:
            factor[knot + 1, ahead] -= share * factor[knot, ahead + 1]


@numba.njit(cache=True)
def eliminated(
    equations: Equations, variance: float, rough: Roughness, level: FloatArray, about: FloatArray
) -> Reduced:
    """Eliminate the disturbance; the evidence lacks the log-determinant of its prior.

    Parameters
    ----------
    equations : Equations
        Of a window.
    variance : float
        Of the residuals, correlation included [N^2].
    rough : Roughness
        Information about its course.
    level, about : ndarray (knots,)
        Information about the level of each knot [1/N^2], and its mean [N].
    """
    unknowns, knots = len(equations.right), len(equations.band)
    # the mean counts as one more unknown
    right, ahead, pivot = unknowns + 1, unknowns + 2, unknowns + 4
    factor = np.zeros((knots + 1, unknowns + 5))
    scale = 1.0 / variance
    cost = scale * equations.energy[0]
    for knot in range(knots):
        for column in range(unknowns):
            factor[knot, column] = scale * equations.coupling[knot, column]
        factor[knot, right] = scale * equations.coupling[knot, unknowns]
        factor[knot, ahead] = scale * equations.band[knot, 1]
        factor[knot, pivot] = scale * equations.band[knot, 0] + level[knot]
        factor[knot, right] += level[knot] * about[knot]
        cost += level[knot] * about[knot] * about[knot]
    _add_roughness(rough, right, factor[:knots])
    right_hand, matrix = np.zeros(right), np.zeros((right, right))
    right_hand[:unknowns] = scale * equations.right
    matrix[:unknowns, :unknowns] = scale * equations.matrix
    # a mean as far from zero as the newest knot may be
    matrix[unknowns, unknowns] = knots * rough.extent + level[-1]
    logarithm = np.log(matrix[unknowns, unknowns])
    for knot in range(knots + 1):
        if knot == knots:
            factor[knot, :unknowns] = matrix[unknowns, :unknowns]
            factor[knot, right] = right_hand[unknowns]
            factor[knot, pivot] = matrix[unknowns, unknowns]
        inverse = 1.0 / factor[knot, pivot]
        logarithm += np.log(inverse)
        cost -= factor[knot, right] * factor[knot, right] * inverse
        for row in range(right):
            share = factor[knot, row] * inverse
            if share == 0.0:
                continue
            right_hand[row] -= share * factor[knot, right]
            for column in range(row + 1):
                matrix[row, column] -= share * factor[knot, column]
        _pass_on(factor, knot, right)
    left, rest = matrix[:unknowns, :unknowns].copy(), right_hand[:unknowns].copy()
    for row in range(unknowns):
        left[:row, row] = left[row, :row]
    return Reduced(left, rest, np.full(1, cost), np.full(1, 0.5 * logarithm), factor)


@numba.njit(cache=True)
def log_determinant_of_prior(rough: Roughness, level: FloatArray) -> float:
    """Return that of the information about the disturbance, its mean integrated out.

    Of differences that are next to nothing against the level it would be lost in rounding.
    """
    matrix, right, knots = np.zeros((0, 0)), np.zeros(0), len(level)
    coupling, band = np.zeros((knots, 1)), np.zeros((knots, 3))
    nothing = Equations(matrix, right, coupling, band, np.zeros(1))
    alone = eliminated(nothing, 1.0, rough, level, np.zeros(knots))
    return float(-2.0 * alone.evidence[0])


@numba.njit(cache=True)
def disturbance_at(reduced: Reduced, step: FloatArray) -> FloatArray:
    """Return the disturbance at its knots (knots,) [N] after a step of x (unknowns,)."""
    factor, unknowns = reduced.factor, len(step)
    knots = len(factor) - 1
    # The mean stands behind the newest knot; as a level it is coupled with none.
    levels = np.zeros(knots + 3)
    for knot in range(knots, -1, -1):
        total = factor[knot, unknowns + 1] - factor[knot, unknowns] * levels[knots]
        for column in range(unknowns):
            total -= factor[knot, column] * step[column]
        for ahead in range(1, 3):
            total -= factor[knot, unknowns + 1 + ahead] * levels[knot + ahead]
        levels[knot] = total / factor[knot, unknowns + 4]
    return levels[:knots]
