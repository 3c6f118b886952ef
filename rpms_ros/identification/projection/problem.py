# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Data of a fit: block statistics, baseline and prior in one object.

The batch keeps all blocks and has no arrival cost, the horizon keeps the blocks of its length and
an arrival cost, and a fit of the horizon alone has the same blocks and another prior.
"""

from typing import NamedTuple

import numpy as np

from rpms_ros.identification.projection.block_statistics import BlockStatistics
from rpms_ros.pulses import FloatArray

PARAMETERS = 4


class BaselineKnots(NamedTuple):
    """Piecewise linear baseline: its knots' values are linear unknowns.

    Attributes
    ----------
    knots : int
        0: none; 1: an offset; more: linear between knots.
    origin_ns, spacing_ns : int
        First knot and distance of knots [ns].
    """

    knots: int
    origin_ns: int
    spacing_ns: int


class Pass(NamedTuple):
    """Arrays that the passes overwrite, allocated once.

    Attributes
    ----------
    state : ndarray (1 + 4, functions)
        States, and their derivatives by theta.
    correlated : ndarray (1 + 4, functions)
        Correlation of w with each row of `state`.
    projected : ndarray (4, functions)
        S v_j.
    product : ndarray (functions, functions)
        X S.
    slope, origin_slope : ndarray (4,)
        Derivatives of the recruitment.
    """

    state: FloatArray
    correlated: FloatArray
    projected: FloatArray
    product: FloatArray
    slope: FloatArray
    origin_slope: FloatArray


def pass_arrays(functions: int) -> Pass:
    """Return arrays for so many functions."""
    return Pass(
        state=np.zeros((1 + PARAMETERS, functions)),
        correlated=np.zeros((1 + PARAMETERS, functions)),
        projected=np.zeros((PARAMETERS, functions)),
        product=np.zeros((functions, functions)),
        slope=np.zeros(PARAMETERS),
        origin_slope=np.zeros(PARAMETERS),
    )


class Prior(NamedTuple):
    """Prior, bounds and arrival cost.

    Attributes
    ----------
    mean, deviation : ndarray (4,)
        Weak physiological prior of theta, alpha as logarithms.
    lower, upper : ndarray (4,)
        Bounds of theta.
    separation : float
        u_sat is at least this far above u_thr.
    information : ndarray (4 + functions, 4 + functions)
        Matrix of the arrival cost of [theta, w], alpha as logarithms.
    information_vector : ndarray (4 + functions,)
        Minus its gradient at `reference`.
    reference : ndarray (4 + functions,)
        Point about which it is expanded.
    """

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray
    separation: float
    information: FloatArray
    information_vector: FloatArray
    reference: FloatArray


class Problem(NamedTuple):
    """A separable least-squares problem over the blocks of a recording.

    Attributes
    ----------
    blocks : BlockStatistics
        Sums over the samples.
    first : int
        Blocks before this one only advance the state and are not fitted.
    input_gain : float
        Increase of each state by a pulse of recruitment 1 [s^-1/2].
    baseline : BaselineKnots
        Baseline of the force.
    prior : Prior
        Prior, bounds and arrival cost.
    work : Pass
        Arrays that the passes overwrite.
    """

    blocks: BlockStatistics
    first: int
    input_gain: float
    baseline: BaselineKnots
    prior: Prior
    work: Pass
