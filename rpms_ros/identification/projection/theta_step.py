# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the parameters of the recruitment curve, within their bounds and kept in order."""

import math

import numba

from rpms_ros.identification.projection.fit import coordinate
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.pulses import FloatArray


@numba.njit(cache=True)
def room_for_steps(theta: FloatArray, prior: Prior, low: FloatArray, high: FloatArray) -> None:
    """Write the least and greatest steps of the coordinates (4,) within the bounds."""
    for place in range(PARAMETERS):
        here = coordinate(theta, place)
        low[place] = coordinate(prior.lower, place) - here
        high[place] = coordinate(prior.upper, place) - here


@numba.njit(cache=True)
def move_theta(theta: FloatArray, prior: Prior, step: FloatArray, moved: FloatArray) -> float:
    """Write theta (4,) after a step (4,); u_thr and u_sat keep their least distance.

    `step` becomes what was gone.  Returns its largest component.
    """
    for place in range(PARAMETERS):
        value = coordinate(theta, place) + step[place]
        value = math.exp(value) if place >= 2 else value
        moved[place] = min(max(value, prior.lower[place]), prior.upper[place])
    lacking = prior.separation - (moved[1] - moved[0])
    if lacking > 0.0:
        moved[0] = max(moved[0] - 0.5 * lacking, prior.lower[0])
        moved[1] = moved[0] + prior.separation
    largest = 0.0
    for place in range(PARAMETERS):
        step[place] = coordinate(moved, place) - coordinate(theta, place)
        largest = max(largest, abs(step[place]))
    return largest
