# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Sufficient statistics of the force samples for any parameters, in blocks of one pulse each.

A block holds the samples between two pulses.  Within it the regressors are
``phi_l(tau) = sum_k e_k(tau) z_(l-k)``: `e` depends only on the time ``tau`` since the block
began, the states `z` at its beginning only on the parameters.  So the sums ``sum e e^T``,
``sum e y``, ``sum e``, ``sum e tau`` and a few of ``y`` and ``tau`` over the samples of a block
give the normal equations of *any* parameters exactly, without the samples.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.laguerre import transition_generator
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Columns of `BlockStatistics.response`: sums of e y, e and e tau.
RESPONSE_FORCE, RESPONSE_ONE, RESPONSE_TIME = range(3)
# Columns of `BlockStatistics.moments`: sums of 1, tau, tau^2, y, y tau and y^2.
COUNT, TIME, TIME_SQUARED, FORCE, FORCE_TIME, FORCE_SQUARED = range(6)
# Longest block [ns], so that a horizon moves in small steps when no pulses are given.
LONGEST_BLOCK_NS = 250_000_000


class BlockStatistics(NamedTuple):
    """Ring of blocks, oldest at ``head[0]``, ``size[0]`` of them.

    Attributes
    ----------
    start_ns : ndarray of int64 (capacity,)
        When the block's pulse begins to act, latency included [ns].
    intensity : ndarray (capacity,)
        Intensity of that pulse; 0 if the block began without one.
    weight : ndarray (capacity,)
        Factor of its recruitment (repetition rate).
    transition : ndarray (capacity, functions)
        Generator of the transition from the block before.
    gram : ndarray (capacity, functions, functions)
        Sums of e e^T.
    response : ndarray (capacity, functions, 3)
        Sums of e y, e, e tau.
    moments : ndarray (capacity, 6)
        Sums of 1, tau, tau^2, y, y tau, y^2.
    head, size : ndarray of int64 (1,)
        Where the ring begins, and how many blocks it holds.
    """

    start_ns: IntArray
    intensity: FloatArray
    weight: FloatArray
    transition: FloatArray
    gram: FloatArray
    response: FloatArray
    moments: FloatArray
    head: IntArray
    size: IntArray


def empty_blocks(capacity: int, functions: int) -> BlockStatistics:
    """Return a ring without blocks."""
    return BlockStatistics(
        start_ns=np.zeros(capacity, dtype=np.int64),
        intensity=np.zeros(capacity),
        weight=np.zeros(capacity),
        transition=np.zeros((capacity, functions)),
        gram=np.zeros((capacity, functions, functions)),
        response=np.zeros((capacity, functions, 3)),
        moments=np.zeros((capacity, 6)),
        head=np.zeros(1, dtype=np.int64),
        size=np.zeros(1, dtype=np.int64),
    )


def grown(blocks: BlockStatistics, capacity: int) -> BlockStatistics:
    """Return the same blocks in a longer ring that begins at 0."""
    larger = empty_blocks(capacity, blocks.transition.shape[1])
    head, size = int(blocks.head[0]), int(blocks.size[0])
    order = (head + np.arange(size)) % len(blocks.start_ns)
    for source, target in zip(blocks[:-2], larger[:-2], strict=True):
        target[:size] = source[order]
    larger.size[0] = size
    return larger


@numba.njit(cache=True)
def newest(blocks: BlockStatistics) -> int:
    """Return the place of the newest block; there must be one."""
    place: int = (blocks.head[0] + blocks.size[0] - 1) % len(blocks.start_ns)
    return place


@numba.njit(cache=True)
def open_block(
    blocks: BlockStatistics,
    start_ns: int,
    intensity: float,
    weight: float,
    rate: float,
    fresh: bool,
) -> int:
    """Begin a block and return its place; if the ring is full, the oldest block is dropped.

    `rate` is 2 p [1/s].  A fresh block begins with zero states: the clock may have jumped.
    """
    capacity = len(blocks.start_ns)
    if blocks.size[0] == capacity:
        blocks.head[0] = (blocks.head[0] + 1) % capacity
        blocks.size[0] -= 1
    before = newest(blocks)
    blocks.size[0] += 1
    here = newest(blocks)
    if fresh or blocks.size[0] == 1:
        blocks.transition[here] = 0.0
    else:
        distance = rate * 1e-9 * (start_ns - blocks.start_ns[before])
        transition_generator(distance, blocks.transition[here])
    blocks.start_ns[here] = start_ns
    blocks.intensity[here] = intensity
    blocks.weight[here] = weight
    blocks.gram[here] = 0.0
    blocks.response[here] = 0.0
    blocks.moments[here] = 0.0
    return here


@numba.njit(cache=True)
def add_sample(
    blocks: BlockStatistics, here: int, tau: float, force: float, values: FloatArray
) -> None:
    """Add a sample `tau` seconds into the block; `values` (functions,) holds e(tau)."""
    gram = blocks.gram[here]
    response = blocks.response[here]
    moments = blocks.moments[here]
    for row in range(len(values)):
        value = values[row]
        for column in range(len(values)):
            gram[row, column] += value * values[column]
        response[row, RESPONSE_FORCE] += value * force
        response[row, RESPONSE_ONE] += value
        response[row, RESPONSE_TIME] += value * tau
    moments[COUNT] += 1.0
    moments[TIME] += tau
    moments[TIME_SQUARED] += tau * tau
    moments[FORCE] += force
    moments[FORCE_TIME] += force * tau
    moments[FORCE_SQUARED] += force * force


@numba.njit(cache=True)
def without_force(
    blocks: BlockStatistics,
    here: int,
    values: FloatArray,
    response: FloatArray,
    moments: FloatArray,
) -> None:
    """Write the sums of a block without the force ``values^T e(tau)`` in its samples."""
    response[:] = blocks.response[here]
    moments[:] = blocks.moments[here]
    for row in range(len(values)):
        product = 0.0
        for column in range(len(values)):
            product += blocks.gram[here, row, column] * values[column]
        moments[FORCE_SQUARED] += values[row] * (product - 2.0 * response[row, RESPONSE_FORCE])
        moments[FORCE] -= values[row] * response[row, RESPONSE_ONE]
        moments[FORCE_TIME] -= values[row] * response[row, RESPONSE_TIME]
    for row in range(len(values)):
        for column in range(len(values)):
            response[row, RESPONSE_FORCE] -= blocks.gram[here, row, column] * values[column]
