# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Error of the a-priori predictions of a session, in newtons and as a share of the range."""

import math
from typing import NamedTuple

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Earlier samples do not count, or those of the first half of a shorter session [s].
SETTLING_TIME = 10.0


class OutputError(NamedTuple):
    """Error of the predictions made before each sample was learnt from, after settling.

    Attributes
    ----------
    newton : float
        Root mean square of measured minus predicted force [N].
    of_range : float
        The same divided by the range, maximum minus minimum, of the session's force [1].
    """

    newton: float
    of_range: float


def output_error(
    stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
) -> OutputError:
    """Return the output error of a session.

    Usable samples count from `SETTLING_TIME` after the first one on, or from the middle of the
    session if that is earlier.  The error is related to the range of the whole session, so a force
    near zero at some time makes no difference.

    Parameters
    ----------
    stamp_ns, force, prediction : ndarray (samples,)
        In the order in which they were processed [ns], [N], [N]; NaN where nothing was predicted.
    usable : ndarray of bool (samples,)
        Samples that could be learnt from.

    Returns
    -------
    OutputError
        NaN without a usable sample that was predicted, or with a constant force.
    """
    kept = settled(stamp_ns) & usable & np.isfinite(prediction)
    if not kept.any():
        return OutputError(math.nan, math.nan)
    # Not by BLAS, whose last bits depend on the number of its threads: the results of a study
    # would depend on the number of its processes.
    newton = math.sqrt(float(np.mean(np.square(force[kept] - prediction[kept]))))
    span = float(np.ptp(force[usable]))
    return OutputError(newton, newton / span if span > 0.0 else math.nan)


def settled(stamp_ns: IntArray) -> BoolArray:
    """Return which samples (samples,) are past `SETTLING_TIME`, or past the middle if earlier."""
    # A jump back of the clock does not reduce the time that has passed.
    elapsed = np.concatenate(([0], np.cumsum(np.maximum(np.diff(stamp_ns), 0))))
    late: BoolArray = elapsed >= min(
        SETTLING_TIME * NANOSECONDS_PER_SECOND, 0.5 * float(elapsed[-1])
    )
    return late
