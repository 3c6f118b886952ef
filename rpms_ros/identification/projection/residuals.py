# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sums of the residuals of blocks, to see whether neighbouring residuals are correlated."""

import numba

from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.block_statistics import FORCE
from rpms_ros.identification.projection.block_statistics import RESPONSE_ONE
from rpms_ros.identification.projection.block_statistics import TIME
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.normal_equations import hat
from rpms_ros.identification.projection.normal_equations import knot_of
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.pulses import FloatArray


@numba.njit(cache=True)
def residual_sums(problem: Problem, last: int, fit: Fit, sums: FloatArray) -> None:
    """Write the sum of the residuals of blocks first..last-1 into `sums` (last - first,) [N]."""
    blocks, first, baseline, work = problem.blocks, problem.first, problem.baseline, problem.work
    theta, linear, levels, input_gain = fit.theta, fit.linear, fit.levels, problem.input_gain
    state = work.state[0]
    state[:] = 0.0
    origin = arctan_recruitment(0.0, theta)
    values = work.correlated[0]
    for index in range(last):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], state)
        rho = arctan_recruitment(blocks.intensity[here], theta) - origin
        state += input_gain * blocks.weight[here] * rho
        if index < first:
            continue
        moments = blocks.moments[here]
        correlate(linear, state, values)
        total = moments[FORCE]
        for shift in range(len(linear)):
            total -= values[shift] * blocks.response[here, shift, RESPONSE_ONE]
        knot, position = knot_of(blocks.start_ns[here], baseline)
        for offset in range(min(baseline.knots, 2)):
            value, slope = hat(offset, position, baseline)
            total -= levels[knot + offset] * (value * moments[COUNT] + slope * moments[TIME])
        sums[index - first] = total
