# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When the force leaves its baseline: measured, not a parameter of a model.

The latency of a fitted twitch is the onset of that twitch; it is later if the force of the muscle
rises slower than that of the model.  The onset of the force is the first sample from which on the
force stays outside the noise before the pulse: an upper bound, since noise hides the beginning.
The lower bound is the last sample before it that is a standard deviation below the baseline, which
is improbable after the force has begun.
"""

from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.responses import Response

_OUTSIDE = 4.0
_STAYS = 3
_LEAST_BEFORE = 10


@dataclass(frozen=True)
class ForceOnset:
    """When the force leaves its baseline.

    Attributes
    ----------
    value, lower : float
        Upper (`value`) and lower bound, from the first pulse [s].
    """

    value: float
    lower: float


def force_onset(response: Response) -> ForceOnset | None:
    """Return the onset of the force after the first pulse; None if noise hides it.

    Samples that an artifact may affect are not used, neither as force nor as baseline.
    """
    usable = response.usable & np.isfinite(response.force)
    before = response.force[usable & (response.lag < 0.0)]
    after = usable & (response.lag > 0.0)
    lag, force = response.lag[after], response.force[after]
    if len(before) < _LEAST_BEFORE or len(force) < _STAYS:
        return None
    deviation = float(np.std(before, ddof=1))
    above = force - float(np.mean(before))
    outside = above > _OUTSIDE * deviation
    stays = outside[: len(outside) - _STAYS + 1].copy()
    for shift in range(1, _STAYS):
        stays &= outside[shift : len(outside) - _STAYS + 1 + shift]
    if not stays.any() or (deviation == 0.0 and not above.any()):
        return None
    first = int(np.argmax(stays))
    inside = np.flatnonzero(above[:first] <= -deviation)
    lower = float(lag[inside[-1]]) if len(inside) else 0.0
    return ForceOnset(float(lag[first]), lower)
