# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Memory of the recursion: sums over samples that are valid for any parameters.

With the recruitment linear in its values at knots (`knots`) the model is

.. math:: y(t) = \sum_k \rho(\theta, u_k) \sum_l w_l\, x_{kl}(t) + b, \qquad
          x_{kl}(t) = \sum_q B_k(u_q)\, \phi_l(t - t_q),

and no regressor x depends on a parameter.  The sums of recursive least squares,
``G <- lambda G + x x^T`` and ``r <- lambda r + x y``, are then valid for every parameter set:
earlier samples were not linearised at parameters that may have been wrong.

x is the state of one chain of Laguerre filters for each knot.  Between two pulses a known matrix
advances it, so the samples of a block are summed first (`BlockStatistics`) and added to G at its
end.

Recruitment interpolated between fixed intensities, so that regressors have no parameters.

Between knots ``u_0 = 0, u_1, .., u_K = 1`` the recruitment is the cubic through its four nearest
values.  It is then linear in them, ``rho(theta, u) = sum_k rho(theta, u_k) B_k(u)``; since
rho(0) = 0 there is no term of the knot at zero.  With 24 knots the error is below 0.25 % of the
maximum for the curves of people, below 0.04 % for half of them
(`test/identification/recursion/test_knots.py`).

Variance of sums of neighbouring residuals, updated block by block.

As `rpms_ros.identification.estimation.uncertainty.residual_spread`, for a recursion that does not
keep blocks.

Adds samples and pulses to the present block, with an a-priori prediction of each sample.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE,
    FORCE_SQUARED,
    RESPONSE_FORCE,
    RESPONSE_ONE,
    BlockStatistics,
    add_sample,
    empty_blocks,
    newest,
    open_block,
)
from rpms_ros.identification.estimation.estimator import count_energy
from rpms_ros.identification.estimation.gauss_newton import Fit
from rpms_ros.identification.estimation.normal_equations import advance_state, correlate
from rpms_ros.identification.estimation.settings import PARAMETERS
from rpms_ros.identification.estimation.uncertainty import ResidualSums
from rpms_ros.identification.model.basis import transition_generator
from rpms_ros.muscle.recruitment import arctan_recruitment_with_gradient
from rpms_ros.pulses import BoolArray, FloatArray, IntArray
from rpms_ros.saved_state import Restorable, expect

# The present block and the one before it.
BLOCKS = 2
# States below this share of the effect of a pulse count as zero.
_NOTHING = 1e-6


class Memory(NamedTuple):
    """Sums over all samples, weighted by their age.

    Attributes
    ----------
    chains : ndarray (knots, functions)
        States x at the beginning of the block.
    blocks : BlockStatistics
        The present block and the one before it.
    gram : ndarray (knots * functions + 1, knots * functions + 1)
        Sums of x x^T, with the regressor of the baseline (1) last; lower triangle.
    cross : ndarray (knots * functions + 1,)
        Sums of x y.
    energy, samples, squared_samples : ndarray (1,)
        Sums of y^2, of 1, and of 1 with the squared weight.
    product : ndarray (knots, functions, functions)
        Overwritten.
    """

    chains: FloatArray
    blocks: BlockStatistics
    gram: FloatArray
    cross: FloatArray
    energy: FloatArray
    samples: FloatArray
    squared_samples: FloatArray
    product: FloatArray


class Sums(NamedTuple):
    """The sums of a memory alone; see `Memory`."""

    gram: FloatArray
    cross: FloatArray
    energy: FloatArray
    samples: FloatArray
    squared_samples: FloatArray


def sums_of(memory: Memory) -> Sums:
    """Return a copy of the sums of a memory."""
    return Sums(*(getattr(memory, name).copy() for name in Sums._fields))


def without(sums: Sums, directions: FloatArray, variance: float) -> Sums:
    """Return sums without the information about changes of the muscle along directions.

    Parameters
    ----------
    sums : Sums
        Sums from before a change.
    directions : ndarray (directions, knots * functions + 1)
        Possible changes, one standard deviation each.
    variance : float
        Variance of the residuals [N^2].
    """
    lower = np.tril(sums.gram, -1)
    applied = directions @ (lower + lower.T + np.diag(np.diag(sums.gram)))
    matrix = applied @ directions.T + variance * np.eye(len(directions))
    right = directions @ sums.cross
    solved = np.linalg.solve(matrix, np.column_stack((applied, right)))
    return sums._replace(
        gram=sums.gram - applied.T @ solved[:, :-1],
        cross=sums.cross - applied.T @ solved[:, -1],
        energy=sums.energy - right @ solved[:, -1],
    )


def empty_memory(knots: int, functions: int) -> Memory:
    """Return an empty memory."""
    unknowns = knots * functions + 1
    return Memory(
        chains=np.zeros((knots, functions)),
        blocks=empty_blocks(BLOCKS, functions),
        gram=np.zeros((unknowns, unknowns)),
        cross=np.zeros(unknowns),
        energy=np.zeros(1),
        samples=np.zeros(1),
        squared_samples=np.zeros(1),
        product=np.zeros((knots, functions, functions)),
    )


@numba.njit(cache=True)
def scale_memory(memory: Memory, share: float) -> None:
    """Multiply the weights of all samples by `share`."""
    memory.gram[:] *= share
    memory.cross[:] *= share
    memory.energy[0] *= share
    memory.samples[0] *= share
    memory.squared_samples[0] *= share * share


@numba.njit(cache=True)
def excited(memory: Memory, input_gain: float) -> bool:
    """Return whether any pulse still acts."""
    largest = 0.0
    for value in memory.chains.flat:
        largest = max(largest, abs(value))
    return largest > _NOTHING * input_gain


@numba.njit(cache=True)
def let_baseline_drift(memory: Memory, variance: float) -> None:
    """Add process noise to the baseline: a variance, relative to that of the noise of a sample.

    There is none after a block that ends at the stamp at which it began, with one sample.
    """
    if not variance > 0.0:
        return
    gram, cross = memory.gram, memory.cross
    last = len(cross) - 1
    share = 1.0 / (gram[last, last] + 1.0 / variance)
    row = gram[last].copy()
    level = cross[last]
    memory.energy[0] -= level * level * share
    for place in range(len(cross)):
        cross[place] -= row[place] * level * share
        for other in range(place + 1):
            gram[place, other] -= row[place] * row[other] * share


@numba.njit(cache=True)
def _add_chain(memory: Memory, here: int, knot: int) -> None:
    """Add the products of one chain with force and baseline; write its product with the sums."""
    blocks, state, product = memory.blocks, memory.chains[knot], memory.product[knot]
    sums, response = blocks.gram[here], blocks.response[here]
    functions = len(state)
    last = len(memory.cross) - 1
    for row in range(functions):
        at = knot * functions + row
        product[row] = 0.0
        for shift in range(row + 1):
            value = state[row - shift]
            memory.cross[at] += value * response[shift, RESPONSE_FORCE]
            memory.gram[last, at] += value * response[shift, RESPONSE_ONE]
            for column in range(functions):
                product[row, column] += value * sums[shift, column]


@numba.njit(cache=True)
def _add_pair(memory: Memory, knot: int, other: int) -> None:
    """Add the products of two chains."""
    product, state = memory.product[knot], memory.chains[other]
    functions = len(state)
    for row in range(functions):
        for column in range(functions):
            total = 0.0
            for shift in range(column + 1):
                total += product[row, shift] * state[column - shift]
            memory.gram[knot * functions + row, other * functions + column] += total


@numba.njit(cache=True)
def add_block(memory: Memory, here: int) -> None:
    """Add the samples of a block, whose states are `chains`, to the sums."""
    moments = memory.blocks.moments[here]
    last = len(memory.cross) - 1
    for knot in range(len(memory.chains)):
        _add_chain(memory, here, knot)
        for other in range(knot + 1):
            _add_pair(memory, knot, other)
    memory.cross[last] += moments[FORCE]
    memory.gram[last, last] += moments[COUNT]
    memory.energy[0] += moments[FORCE_SQUARED]
    memory.samples[0] += moments[COUNT]
    memory.squared_samples[0] += moments[COUNT]


KNOTS = 24


@numba.njit(cache=True)
def interpolate(intensity: float, values: FloatArray) -> None:
    """Write ``B_k(intensity)`` into `values` (knots,), those of the knots above zero."""
    count = len(values)
    values[:] = 0.0
    place = min(max(intensity, 0.0), 1.0) * count
    first = min(max(int(place) - 1, 0), count - 3)
    for near in range(4):
        weight = 1.0
        for other in range(4):
            if other != near:
                weight *= (place - first - other) / (near - other)
        if first + near > 0:
            values[first + near - 1] = weight


@numba.njit(cache=True)
def recruitment_at_knots(theta: FloatArray, values: FloatArray) -> None:
    """Write rho and its derivatives, by the logarithms of alpha, into `values` (5, knots)."""
    origin, slope = values[1:, 0].copy(), values[1:, 0].copy()
    zero = arctan_recruitment_with_gradient(0.0, theta, origin)
    count = values.shape[1]
    for knot in range(count):
        intensity = (knot + 1) / count
        values[0, knot] = arctan_recruitment_with_gradient(intensity, theta, slope) - zero
        for place in range(len(theta)):
            scale = theta[place] if place >= 2 else 1.0
            values[1 + place, knot] = scale * (slope[place] - origin[place])


# Lengths over which residuals are summed [ns].
_LENGTH_NS = (100_000_000, 500_000_000, 2_000_000_000)
# Least number of sums for a result.
_LEAST_SUMS = 3.0


class ResidualSpread(Restorable):
    """Running means of (sum of residuals)^2 / samples, for each length."""

    _cell: list[int]
    _sum: FloatArray
    _count: FloatArray
    _total: FloatArray
    _weight: FloatArray
    _kept: FloatArray

    def __init__(self) -> None:
        self._cell = [0] * len(_LENGTH_NS)
        self._sum, self._count, self._total, self._weight = np.zeros((4, len(_LENGTH_NS)))
        # samples, seconds and squared recruitment
        self._kept = np.zeros(3)

    def take(
        self,
        start_ns: int,
        seconds: float,
        residual: float,
        samples: float,
        recruitment: float,
        kept: float,
    ) -> None:
        """Add a block.

        Parameters
        ----------
        start_ns : int
            Its start [ns].
        seconds : float
            The time that its samples cover.
        residual : float
            Sum of its residuals [N].
        samples : float
            Number of its samples.
        recruitment : float
            Of its pulse.
        kept : float
            Factor on the weights of earlier blocks.
        """
        for place, length in enumerate(_LENGTH_NS):
            cell = start_ns // length
            if cell != self._cell[place]:
                if self._count[place] > 0.0:
                    self._total[place] += self._sum[place] ** 2 / self._count[place]
                    self._weight[place] += 1.0
                self._cell[place] = cell
                self._sum[place] = 0.0
                self._count[place] = 0.0
        self._sum += residual
        self._count += samples
        self._total *= kept
        self._weight *= kept
        self._kept *= kept
        self._kept += (samples, seconds, recruitment**2)

    def _check_restored(self) -> None:
        lengths = {len(self._cell), *(len(part) for part in self._sums)}
        expect(lengths == {len(_LENGTH_NS)}, 'ResidualSpread', f'{len(_LENGTH_NS)} lengths')
        expect(self._kept.shape == (3,), 'ResidualSpread', '3 sums')

    @property
    def _sums(self) -> tuple[FloatArray, ...]:
        return self._sum, self._count, self._total, self._weight

    def forget(self) -> None:
        """Forget all earlier blocks."""
        self._total[:] = 0.0
        self._weight[:] = 0.0
        self._kept[:] = 0.0

    @property
    def mean(self) -> FloatArray:
        """The means (lengths,) [N^2], zero with too few sums."""
        known = self._weight >= _LEAST_SUMS
        return np.where(known, self._total / np.maximum(self._weight, 1.0), 0.0)

    @property
    def sums(self) -> ResidualSums:
        """The means, and what they were made from."""
        samples, seconds, recruited = (float(value) for value in self._kept)
        return ResidualSums(self.mean, float(self._weight[0]), samples, seconds, recruited)


class PredictionState(NamedTuple):
    """State of the a-priori prediction between samples.

    Attributes
    ----------
    response : ndarray (functions,)
        The force of the block at tau is ``response^T e(tau)``, without the baseline.
    values : ndarray (functions,)
        Overwritten.
    error_energy, force_energy : ndarray (1,)
        Sums of squares of the a-priori error and of the force, decaying [N^2].
    squares : ndarray (1,)
        Sum of squared a-priori errors of the block [N^2].
    learnt : ndarray (1,)
        Number of samples that were learnt from.
    previous_ns : ndarray of int64 (1,)
        Stamp of the last sample that was learnt from [ns].
    """

    response: FloatArray
    values: FloatArray
    error_energy: FloatArray
    force_energy: FloatArray
    squares: FloatArray
    learnt: FloatArray
    previous_ns: IntArray


def fresh_prediction_state(functions: int) -> PredictionState:
    """Return the state before the first sample."""
    return PredictionState(
        response=np.zeros(functions),
        values=np.zeros(functions),
        error_energy=np.zeros(1),
        force_energy=np.zeros(1),
        squares=np.zeros(1),
        learnt=np.zeros(1),
        previous_ns=np.zeros(1, dtype=np.int64),
    )


@numba.njit(cache=True)
def recompute_response(
    chains: FloatArray, theta: FloatArray, linear: FloatArray, response: FloatArray
) -> None:
    """Write the response (functions,) of the present block for given parameters."""
    knots, functions = chains.shape
    values = np.empty((1 + PARAMETERS, knots))
    recruitment_at_knots(theta, values)
    state = np.zeros(functions)
    for knot in range(knots):
        for function in range(functions):
            state[function] += values[0, knot] * chains[knot, function]
    correlate(linear, state, response)


@numba.njit(cache=True)
def begin_block(
    blocks: BlockStatistics,
    chains: FloatArray,
    start_ns: int,
    intensity: float,
    push: float,
    rate: float,
    fresh: bool,
) -> None:
    """Begin a block with a pulse, which adds `push` times its recruitment to the states.

    `rate` is 2 p [1/s]; a fresh block begins with zero states.
    """
    here = open_block(blocks, start_ns, intensity, push, rate, fresh)
    values = np.empty(len(chains))
    interpolate(intensity, values)
    for knot in range(len(chains)):
        advance_state(blocks.transition[here], chains[knot])
        share = push * values[knot]
        if share != 0.0:
            chains[knot] += share


@numba.njit(cache=True)
def residual_sum(blocks: BlockStatistics, response: FloatArray, level: float) -> float:
    """Return the sum of the a-priori errors of the block [N]."""
    here = newest(blocks)
    moments = blocks.moments[here]
    total: float = moments[FORCE] - level * moments[COUNT]
    for shift in range(len(response)):
        total -= response[shift] * blocks.response[here, shift, RESPONSE_ONE]
    return total


@numba.njit(cache=True)
def take(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    blocks: BlockStatistics,
    carried: PredictionState,
    level: float,
    rate: float,
    prediction: FloatArray,
) -> None:
    """Add samples (samples,) to the block; write the a-priori prediction of each."""
    here = newest(blocks)
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        tau = 1e-9 * (stamp - blocks.start_ns[here])
        transition_generator(rate * tau, carried.values)
        predicted = level
        for function in range(len(carried.values)):
            predicted += carried.response[function] * carried.values[function]
        prediction[index] = predicted
        if not usable[index]:
            continue
        error = force[index] - predicted
        count_energy(
            carried.error_energy,
            carried.force_energy,
            carried.previous_ns,
            stamp,
            error,
            force[index],
        )
        carried.squares[0] += error * error
        carried.learnt[0] += 1.0
        add_sample(blocks, here, tau, force[index], carried.values)


@numba.njit(cache=True)
def predict(
    stamp_ns: IntArray,
    pending: tuple[IntArray, FloatArray, FloatArray],
    memory: Memory,
    carried: PredictionState,
    fit: Fit,
    rate: float,
    fresh: bool,
) -> FloatArray:
    """Return the predictions that `take` would make of ascending samples (samples,) [N].

    `pending` are begin, intensity and push (pulses,) of the pulses that have not begun.
    """
    begin_ns, intensity, push = pending
    blocks, expected = memory.blocks, np.empty(len(stamp_ns))
    known = blocks.size[0] > 0 and not fresh
    start = blocks.start_ns[newest(blocks)] if known else stamp_ns[0]
    states, present = memory.chains.copy(), carried.response.copy()
    if not known:
        states[:] = 0.0
        present[:] = 0.0
    values, shares = np.empty(len(present)), np.empty(len(states))
    begun = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        before = begun
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            transition_generator(rate * 1e-9 * max(begin_ns[begun] - start, 0), values)
            interpolate(intensity[begun], shares)
            for knot in range(len(states)):
                advance_state(values, states[knot])
                states[knot] += push[begun] * shares[knot]
            start = begin_ns[begun]
            begun += 1
        if begun > before:
            recompute_response(states, fit.theta, fit.linear, present)
        transition_generator(rate * 1e-9 * (stamp - start), values)
        total = fit.levels[0]
        for function in range(len(values)):
            total += present[function] * values[function]
        expected[index] = total
    return expected
