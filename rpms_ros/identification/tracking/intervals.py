# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The blocks of a window, linearised and condensed into intervals of equal length.

Within an interval of a fraction of a second the muscle is constant, so gain, time constant
and disturbance may differ from one interval to the next, and each interval needs one small
matrix: ``G = L^T L`` and ``r = L^T y`` with the columns

.. math:: L = [\psi_1 .. \psi_4,\; z_1 .. z_n,\; h_0,\; h_1]

where psi are the derivatives of the force by theta (alpha as logarithms), z the regressors of the
coefficients w, and h the two hats of a piecewise linear baseline whose knots are the interval's
ends.  Any model whose force is a combination of these columns, with factors that change from
interval to interval, is fitted from them without the samples.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.block_statistics import FORCE_SQUARED
from rpms_ros.identification.projection.block_statistics import without_force
from rpms_ros.identification.projection.normal_equations import add_baseline_terms
from rpms_ros.identification.projection.normal_equations import add_gradient_baseline_terms
from rpms_ros.identification.projection.normal_equations import add_gradient_terms
from rpms_ros.identification.projection.normal_equations import add_state_terms
from rpms_ros.identification.projection.normal_equations import advance_gradient
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.muscle.identified_form import arctan_recruitment_with_gradient
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


class Intervals(NamedTuple):
    """Intervals of a window, oldest first; one that holds no sample is zero.

    Attributes
    ----------
    first : ndarray of int64 (1,)
        Number of the first one: it begins at this many lengths.
    gram : ndarray (intervals, 4 + functions + 2, 4 + functions + 2)
        L^T L, symmetric.
    right : ndarray (intervals, 4 + functions + 2)
        L^T y.
    energy, samples : ndarray (intervals,)
        Sum of y^2 [N^2], number of samples.
    """

    first: IntArray
    gram: FloatArray
    right: FloatArray
    energy: FloatArray
    samples: FloatArray


def empty_intervals(count: int, functions: int, first: int) -> Intervals:
    """Return so many intervals without a sample."""
    columns = PARAMETERS + functions + 2
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
    theta, linear : ndarray (4,), (functions,)
        The muscle before it.
    """

    stamp_ns: int
    theta: FloatArray
    linear: FloatArray


def no_change(functions: int) -> Origin:
    """Return the origin of a muscle that has not changed."""
    return Origin(-(2**62), np.ones(PARAMETERS), np.zeros(functions))


def condensed(
    problem: Problem,
    theta: FloatArray,
    linear: FloatArray,
    first_ns: int,
    length_ns: int,
    origin: Origin,
) -> Intervals:
    """Return the intervals of the blocks `problem.first`.. at theta (4,) and w (functions,).

    Parameters
    ----------
    problem : Problem
        Blocks; those before `first` only advance the state.
    theta, linear : ndarray (4,), (functions,)
        Point of linearisation.
    first_ns, length_ns : int
        Beginning of the first block and length of an interval [ns].
    origin : Origin
        The force of pulses before it is subtracted from the samples.
    """
    blocks = problem.blocks
    newest = (int(blocks.head[0]) + int(blocks.size[0]) - 1) % len(blocks.start_ns)
    first = first_ns // length_ns
    count = int(blocks.start_ns[newest]) // length_ns - first + 1
    intervals = empty_intervals(count, len(linear), first)
    _condense(problem, theta, linear, length_ns, origin, intervals)
    return intervals


@numba.njit(cache=True)
def _condense(
    problem: Problem,
    theta: FloatArray,
    linear: FloatArray,
    length_ns: int,
    change: Origin,
    intervals: Intervals,
) -> None:
    """Write intervals; they have to be zero before."""
    blocks, work = problem.blocks, problem.work
    functions = len(linear)
    work.state[:] = 0.0
    before, values = np.zeros(functions), np.zeros(functions)
    response, moments = np.zeros((functions, 3)), np.zeros(blocks.moments.shape[1])
    origin = arctan_recruitment_with_gradient(0.0, theta, work.origin_slope)
    nothing = arctan_recruitment(0.0, change.theta)
    most = len(intervals.samples) - 1
    for index in range(blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        start_ns = blocks.start_ns[here]
        advance_state(blocks.transition[here], before)
        if start_ns < change.stamp_ns:
            if blocks.intensity[here] != 0.0:
                rho = arctan_recruitment(blocks.intensity[here], change.theta) - nothing
                before += problem.input_gain * blocks.weight[here] * rho
            continue
        advance_gradient(blocks, here, theta, origin, problem.input_gain, work)
        if index < problem.first or blocks.moments[here, COUNT] == 0.0:
            continue
        correlate(change.linear, before, values)
        without_force(blocks, here, values, response, moments)
        number = start_ns // length_ns
        place = min(max(number - intervals.first[0], 0), most)
        baseline = BaselineKnots(2, number * length_ns, length_ns)
        gram, right = intervals.gram[place], intervals.right[place]
        intervals.samples[place] += moments[COUNT]
        intervals.energy[place] += moments[FORCE_SQUARED]
        add_state_terms(blocks.gram[here], response, work.state[0], work.product, gram, right)
        add_baseline_terms(start_ns, response, moments, work.state[0], baseline, gram, right)
        add_gradient_terms(blocks.gram[here], response, linear, work, gram, right)
        add_gradient_baseline_terms(start_ns, response, baseline, work, gram)
    for place in range(len(intervals.samples)):
        gram = intervals.gram[place]
        for row in range(len(gram)):
            for column in range(row):
                gram[column, row] = gram[row, column]
