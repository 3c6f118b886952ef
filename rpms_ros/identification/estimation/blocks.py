# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Sufficient statistics of the force samples for any parameters, in blocks of one pulse each.

A block holds the samples between two pulses.  Within it the regressors are
``phi_l(tau) = sum_k e_k(tau) z_(l-k)``: `e` depends only on the time ``tau`` since the block
began, the states `z` at its beginning only on the parameters.  So the sums ``sum e e^T``,
``sum e y``, ``sum e``, ``sum e tau`` and a few of ``y`` and ``tau`` over the samples of a block
give the normal equations of *any* parameters exactly, without the samples.  `PulseDelayLine` holds
the pulses between their onset and the onset of their twitch.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.model.basis import transition_generator
from rpms_ros.identification.model.history_law import PulseHistory, TemporalSummation
from rpms_ros.muscle.recruitment import RateRecruitment
from rpms_ros.pulses import FloatArray, IntArray, nanoseconds

# Columns of `BlockStatistics.response`: sums of e y, e and e tau.
RESPONSE_FORCE, RESPONSE_ONE, RESPONSE_TIME = range(3)
# Columns of `BlockStatistics.moments`: sums of 1, tau, tau^2, y, y tau and y^2.
COUNT, TIME, TIME_SQUARED, FORCE, FORCE_TIME, FORCE_SQUARED = range(6)
# Longest block [ns], so that a window moves in small steps when no pulses are given.
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


def ring_order(blocks: BlockStatistics) -> IntArray:
    """Return the places of the blocks in the ring (size,), oldest first."""
    size = int(blocks.size[0])
    order: IntArray = (int(blocks.head[0]) + np.arange(size)) % len(blocks.start_ns)
    return order


def grown(blocks: BlockStatistics, capacity: int) -> BlockStatistics:
    """Return the same blocks in a longer ring that begins at 0."""
    larger = empty_blocks(capacity, blocks.transition.shape[1])
    order = ring_order(blocks)
    size = len(order)
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


class PendingPulses(NamedTuple):
    """Pulses whose twitch has not begun.

    Attributes
    ----------
    begin_ns : ndarray of int64 (pulses,)
        When it begins, latency included [ns], ascending.
    intensity, weight : ndarray (pulses,)
        Intensity, and factor of the recruitment.
    """

    begin_ns: IntArray
    intensity: FloatArray
    weight: FloatArray


class PulseDelayLine:
    """Pulses whose twitch has not begun, with their weights.

    Parameters
    ----------
    latency : float
        From the pulse to the onset of its twitch [s].
    by_rate : RateRecruitment or None
        Weight by the interval to the pulse before; None weights all alike.
    rate_hz : float
        Rate at which the weight is 1 [Hz].
    history : TemporalSummation or None
        Weight by all pulses before, instead of by the interval.
    """

    def __init__(
        self,
        latency: float,
        by_rate: RateRecruitment | None,
        rate_hz: float,
        history: TemporalSummation | None = None,
    ) -> None:
        self._latency_ns = nanoseconds(latency)
        self._by_rate, self._rate_hz = by_rate, rate_hz
        self._history = PulseHistory(history, rate_hz) if history is not None else None
        self._last_ns: int | None = None
        self.begin_ns, self.intensity = np.empty(0, dtype=np.int64), np.empty(0)
        self.weight = np.empty(0)

    def add(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if not len(onset_ns):
            return
        self.begin_ns = np.concatenate((self.begin_ns, onset_ns + self._latency_ns))
        self.intensity = np.concatenate((self.intensity, intensity))
        self.weight = np.concatenate((self.weight, self._weights(onset_ns, intensity)))
        self._last_ns = int(onset_ns[-1])

    @property
    def pending(self) -> PendingPulses:
        """The pulses that wait."""
        return PendingPulses(self.begin_ns, self.intensity, self.weight)

    def latency(self, latency: float) -> None:
        """Set the latency of pulses that are added from now on [s]."""
        self._latency_ns = nanoseconds(latency)

    def restart(
        self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray, latency: float
    ) -> None:
        """Replace all pulses by these (pulses,), with another latency [s]."""
        self.latency(latency)
        self.begin_ns = onset_ns + self._latency_ns
        self.intensity = intensity.copy()
        self.weight = weight.copy()

    def drop(self, count: int) -> None:
        """Drop the first pulses, whose twitch has begun."""
        if count:
            self.begin_ns = self.begin_ns[count:]
            self.intensity = self.intensity[count:]
            self.weight = self.weight[count:]

    def begin_until(self, stamp_ns: int) -> int:
        """Return how many twitches begin before a stamp [ns]."""
        return int(np.searchsorted(self.begin_ns, stamp_ns))

    def forget(self) -> None:
        """Drop all pulses; the next one counts as the first."""
        self.drop(len(self.begin_ns))
        self._last_ns = None
        if self._history is not None:
            self._history.forget()

    def _weights(self, onset_ns: IntArray, intensity: FloatArray) -> FloatArray:
        if self._history is not None:
            return self._history.weights(onset_ns, intensity)
        if self._by_rate is None:
            return np.ones(len(onset_ns))
        return self._by_rate.of_train(onset_ns, self._rate_hz, self._last_ns)
