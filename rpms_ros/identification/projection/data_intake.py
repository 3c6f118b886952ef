# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Adds samples and pulses to blocks, with an a-priori prediction of each sample."""

import math
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.laguerre import transition_generator
from rpms_ros.identification.projection.block_statistics import LONGEST_BLOCK_NS
from rpms_ros.identification.projection.block_statistics import BlockStatistics
from rpms_ros.identification.projection.block_statistics import add_sample
from rpms_ros.identification.projection.block_statistics import newest
from rpms_ros.identification.projection.block_statistics import open_block
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.normal_equations import hat
from rpms_ros.identification.projection.normal_equations import knot_of
from rpms_ros.identification.projection.normal_equations import within_knots
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

OUTPUT_ERROR_TIME = 1.0


class Intake(NamedTuple):
    """State of the intake between samples.

    Attributes
    ----------
    state : ndarray (functions,)
        States at the beginning of the newest block, at the parameters of the fit.
    response : ndarray (functions,)
        The force of the newest block at tau is ``response^T e(tau)``.
    values : ndarray (functions,)
        e(tau), overwritten.
    error_energy, force_energy, recent : ndarray (1,)
        Exponentially decaying sums of squares of the a-priori error and of the force [N^2], and
        number of samples.
    learnt : ndarray (1,)
        Number of samples that were learnt from.
    fresh : ndarray (1,)
        1 if the next block begins with zero states.
    previous_ns : ndarray of int64 (1,)
        Stamp of the last sample that was learnt from [ns]; a float would round it to 256 ns.
    """

    state: FloatArray
    response: FloatArray
    values: FloatArray
    error_energy: FloatArray
    force_energy: FloatArray
    recent: FloatArray
    learnt: FloatArray
    fresh: FloatArray
    previous_ns: IntArray


def fresh_intake(functions: int) -> Intake:
    """Return an intake before its first sample."""
    state, response, values = np.zeros((3, functions))
    return Intake(
        state=state,
        response=response,
        values=values,
        error_energy=np.zeros(1),
        force_energy=np.zeros(1),
        recent=np.zeros(1),
        learnt=np.zeros(1),
        fresh=np.ones(1),
        previous_ns=np.zeros(1, dtype=np.int64),
    )


@numba.njit(cache=True)
def _begin_block(
    blocks: BlockStatistics,
    input_gain: float,
    intake: Intake,
    fit: Fit,
    start_ns: int,
    intensity: float,
    weight: float,
    rate: float,
) -> int:
    here = open_block(blocks, start_ns, intensity, weight, rate, intake.fresh[0] > 0.0)
    intake.fresh[0] = 0.0
    advance_state(blocks.transition[here], intake.state)
    rho = arctan_recruitment(intensity, fit.theta) - arctan_recruitment(0.0, fit.theta)
    intake.state[:] += input_gain * weight * rho
    correlate(fit.linear, intake.state, intake.response)
    return here


@numba.njit(cache=True)
def recompute_state(problem: Problem, intake: Intake, fit: Fit) -> None:
    """Recompute the state of the intake for new parameters."""
    blocks, input_gain = problem.blocks, problem.input_gain
    intake.state[:] = 0.0
    origin = arctan_recruitment(0.0, fit.theta)
    for index in range(blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], intake.state)
        rho = arctan_recruitment(blocks.intensity[here], fit.theta) - origin
        intake.state[:] += input_gain * blocks.weight[here] * rho
    correlate(fit.linear, intake.state, intake.response)


@numba.njit(cache=True)
def count_energy(
    error_energy: FloatArray,
    force_energy: FloatArray,
    previous_ns: IntArray,
    stamp_ns: int,
    error: float,
    force: float,
) -> float:
    """Add the squares of an a-priori error and of a force [N] to the decaying sums (1,).

    Returns what is left of what was counted until the sample before.
    """
    since = min(max(1e-9 * (stamp_ns - previous_ns[0]), 0.0), 100.0)
    decay = math.exp(-since / OUTPUT_ERROR_TIME)
    previous_ns[0] = stamp_ns
    error_energy[0] = decay * error_energy[0] + error * error
    force_energy[0] = decay * force_energy[0] + force * force
    return decay


@numba.njit(cache=True)
def take(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    begin_ns: IntArray,
    intensity: FloatArray,
    weight: FloatArray,
    problem: Problem,
    intake: Intake,
    fit: Fit,
    rate: float,
    prediction: FloatArray,
) -> int:
    """Add ascending samples (samples,); return how many pulses have begun to act.

    `begin_ns`, `intensity`, `weight` (pulses,) are pulses whose twitch has not begun yet;
    `begin_ns` includes the latency.  Writes the prediction of each sample with the present
    parameters.
    """
    blocks, baseline, input_gain = problem.blocks, problem.baseline, problem.input_gain
    begun = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            _begin_block(
                blocks,
                problem.input_gain,
                intake,
                fit,
                begin_ns[begun],
                intensity[begun],
                weight[begun],
                rate,
            )
            begun += 1
        none = blocks.size[0] == 0 or intake.fresh[0] > 0.0
        if none or stamp - blocks.start_ns[newest(blocks)] > LONGEST_BLOCK_NS:
            _begin_block(blocks, input_gain, intake, fit, stamp, 0.0, 0.0, rate)
        here = newest(blocks)
        tau = 1e-9 * (stamp - blocks.start_ns[here])
        transition_generator(rate * tau, intake.values)
        predicted = 0.0
        for function in range(len(intake.values)):
            predicted += intake.response[function] * intake.values[function]
        knot, position = knot_of(stamp, baseline)
        position = within_knots(position, baseline)
        for offset in range(min(baseline.knots, 2)):
            predicted += fit.levels[knot + offset] * hat(offset, position, baseline)[0]
        prediction[index] = predicted
        if not usable[index]:
            continue
        error = force[index] - predicted
        decay = count_energy(
            intake.error_energy,
            intake.force_energy,
            intake.previous_ns,
            stamp,
            error,
            force[index],
        )
        intake.recent[0] = decay * intake.recent[0] + 1.0
        intake.learnt[0] += 1.0
        add_sample(blocks, here, tau, force[index], intake.values)
    return begun
