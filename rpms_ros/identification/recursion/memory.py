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
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.block_statistics import FORCE
from rpms_ros.identification.projection.block_statistics import FORCE_SQUARED
from rpms_ros.identification.projection.block_statistics import RESPONSE_FORCE
from rpms_ros.identification.projection.block_statistics import RESPONSE_ONE
from rpms_ros.identification.projection.block_statistics import BlockStatistics
from rpms_ros.identification.projection.block_statistics import empty_blocks
from rpms_ros.pulses import FloatArray

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
