# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""How far off the area of a response may be that the functions do not fit.

A response that lacks an area ``a_k`` in the time between ``k`` and ``k + 1`` blocks after its
pulse leaves residuals whose sum over block b is ``sum_k a_k rho_(b-k) / dt``.  With intensities
that differ from pulse to pulse the mean square of these sums is that of ``rho`` times
``sum_k a_k^2``, beyond what white residuals have.  The signs are not known: taken as random, the
error of the area, to which the recruitment curve is proportional, is the root of ``sum_k a_k^2``.
The fit has taken up a part of what is missing, so it is multiplied by `_SHOWN`.

Drift, voluntary effort and a changed muscle leave such sums too, and are an error of the curve
too.
"""

import math
from dataclasses import dataclass

from rpms_ros.pulses import FloatArray

# What is missing, as a multiple of what the residuals show of it: such that intervals hold in
# bench/misfit.py, with T_a of 10 to 90 ms and latencies up to 24 ms.
_SHOWN = 2.5
# Standard deviations by which sums of white residuals vary; what is within them does not count.
_CHANCE = 1.0


@dataclass(frozen=True)
class ResidualSums:
    """Sums of residuals over cells of the time.

    Attributes
    ----------
    spread : ndarray (lengths,)
        Mean of (sum of residuals)^2 / samples in the cells of each length [N^2], the shortest
        first; see `uncertainty.residual_spread`.
    cells : float
        Number of the shortest cells.
    samples, seconds : float
        Number of the samples, and the time that they cover.
    recruited : float
        Sum of the squared recruitment of the pulses.
    """

    spread: FloatArray
    cells: float
    samples: float
    seconds: float
    recruited: float

    def missing_area(self, variance: float) -> float:
        """Return the standard deviation of the area of a response by its misfit [N s].

        `variance` is that of the residuals [N^2].
        """
        if not (self.cells > 1.0 and self.samples > 0.0 and self.recruited > 0.0):
            return 0.0
        by_chance = variance * (1.0 + _CHANCE * math.sqrt(2.0 / self.cells))
        beyond = max(float(self.spread[0]) - by_chance, 0.0)
        area_squared = beyond * self.seconds**2 / (self.samples * self.recruited)
        return _SHOWN * math.sqrt(area_squared)
