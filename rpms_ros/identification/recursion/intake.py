# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Adds samples and pulses to the present block, with an a-priori prediction of each sample."""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.laguerre import transition_generator
from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.block_statistics import FORCE
from rpms_ros.identification.projection.block_statistics import RESPONSE_ONE
from rpms_ros.identification.projection.block_statistics import BlockStatistics
from rpms_ros.identification.projection.block_statistics import add_sample
from rpms_ros.identification.projection.block_statistics import newest
from rpms_ros.identification.projection.block_statistics import open_block
from rpms_ros.identification.projection.data_intake import count_energy
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.recursion.knots import interpolate
from rpms_ros.identification.recursion.knots import recruitment_at_knots
from rpms_ros.identification.recursion.memory import Memory
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


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
