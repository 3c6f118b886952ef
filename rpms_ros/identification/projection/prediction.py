# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Prediction of samples ahead by a fit."""

import numba
import numpy as np

from rpms_ros.identification.laguerre import transition_generator
from rpms_ros.identification.projection.block_statistics import newest
from rpms_ros.identification.projection.data_intake import Intake
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.normal_equations import hat
from rpms_ros.identification.projection.normal_equations import knot_of
from rpms_ros.identification.projection.normal_equations import within_knots
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


@numba.njit(cache=True)
def predict(
    stamp_ns: IntArray,
    begin_ns: IntArray,
    intensity: FloatArray,
    weight: FloatArray,
    problem: Problem,
    intake: Intake,
    fit: Fit,
    rate: float,
    expected: FloatArray,
) -> None:
    """Write the predictions that `data_intake.take` would make of ascending samples (samples,).

    The state of the intake does not change.
    """
    blocks, baseline = problem.blocks, problem.baseline
    known = blocks.size[0] > 0 and intake.fresh[0] == 0.0
    start = blocks.start_ns[newest(blocks)] if known else stamp_ns[0]
    state, response = intake.state.copy(), intake.response.copy()
    if not known:
        state[:] = 0.0
        response[:] = 0.0
    values = np.empty(len(state))
    origin = arctan_recruitment(0.0, fit.theta)
    begun = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            transition_generator(rate * 1e-9 * max(begin_ns[begun] - start, 0), values)
            advance_state(values, state)
            rho = arctan_recruitment(intensity[begun], fit.theta) - origin
            state += problem.input_gain * weight[begun] * rho
            correlate(fit.linear, state, response)
            start = begin_ns[begun]
            begun += 1
        transition_generator(rate * 1e-9 * (stamp - start), values)
        total = 0.0
        for function in range(len(values)):
            total += response[function] * values[function]
        knot, position = knot_of(stamp, baseline)
        position = within_knots(position, baseline)
        for offset in range(min(baseline.knots, 2)):
            total += fit.levels[knot + offset] * hat(offset, position, baseline)[0]
        expected[index] = total
