# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which numbers of an estimate come from the data, and not from the prior.

Where the data determine little, an estimator with a prior returns the values of the prior.  Such
a number is no measurement and is not shown as one.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification.estimate import NOT_INFORMED
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.physiology import PRIOR
from rpms_ros.identification.projection.identifiability import LEAST_GAIN
from rpms_ros.pulses import BoolArray

# A twitch whose peak is further from that of the response does not describe the response.
_PEAK_DIFFERENCE = 0.3


def informed_parameters(estimate: Estimate) -> BoolArray:
    """Return which nonlinear parameters (p,) are informed; all if the estimator has no flags."""
    flags = estimate.nonlinear_identifiability
    if len(flags) != len(estimate.nonlinear):
        return np.ones(len(estimate.nonlinear), dtype=np.bool_)
    informed: BoolArray = flags != NOT_INFORMED
    return informed


def informed_physiology(estimate: Estimate) -> Iterator[int]:
    """Yield the indices of the physiology of which the data inform.

    Informed is a number whose standard deviation is below 0.7 (as in `identifiability`) of that
    of the prior, or of the value itself where there is no prior.  None is if the twitch has
    another peak than the response to which it was fitted.
    """
    if not estimate.confidence > 0.0 or not len(estimate.response_force):
        return
    quantile = float(ndtri(0.5 + 0.5 * estimate.confidence))
    values = dict(zip(estimate.physiology_names, estimate.physiology.tolist(), strict=True))
    peak = float(estimate.response_force.max())
    if abs(values.get('twitch_peak_n', peak) - peak) > _PEAK_DIFFERENCE * abs(peak):
        return
    # the lower end may have been cut off at 0
    width = (estimate.physiology_upper - estimate.physiology) / quantile
    for index, name in enumerate(estimate.physiology_names):
        _, before = PRIOR.get(name, (0.0, abs(values[name])))
        if width[index] < LEAST_GAIN * before:
            yield index
