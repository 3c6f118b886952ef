# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which parameters the data determine.

* not informed: the standard deviation is above 0.7 of that of the prior: the data have not halved
  the variance.
* converged: it is below `SETTLED`, and the last step was smaller than that.
* informed: neither.
"""

import numpy as np

from rpms_ros.identification.estimate import CONVERGED
from rpms_ros.identification.estimate import INFORMED
from rpms_ros.identification.estimate import NOT_INFORMED
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

LEAST_GAIN = 0.7
SETTLED: FloatArray = np.array([0.01, 0.01, 0.15, 0.15])
SETTLED.flags.writeable = False


def identifiability(deviation: FloatArray, prior: FloatArray, moved: float) -> IntArray:
    """Return one flag per parameter (4,).

    Parameters
    ----------
    deviation, prior : ndarray (4,)
        Standard deviations of the estimate and of the prior, alpha as logarithms.
    moved : float
        Largest change in the last step, in the same units.
    """
    flags = np.full(len(deviation), INFORMED, dtype=np.int64)
    flags[(deviation < SETTLED) & (moved < SETTLED)] = CONVERGED
    flags[~(deviation < LEAST_GAIN * prior)] = NOT_INFORMED
    return flags
