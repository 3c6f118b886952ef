# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Variance of sums of neighbouring residuals, updated block by block.

As `rpms_ros.identification.projection.uncertainty.residual_spread`, for a recursion that does not
keep blocks.
"""

import numpy as np

from rpms_ros.identification.projection.missing_area import ResidualSums
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import FloatArray

# Lengths over which residuals are summed [ns].
_LENGTH_NS = (100_000_000, 500_000_000, 2_000_000_000)
# Least number of sums for a result.
_LEAST_SUMS = 3.0


class ResidualSpread(Restorable):
    """Running means of (sum of residuals)^2 / samples, for each length."""

    _cell: list[int]
    _sum: FloatArray
    _count: FloatArray
    _total: FloatArray
    _weight: FloatArray
    _kept: FloatArray

    def __init__(self) -> None:
        self._cell = [0] * len(_LENGTH_NS)
        self._sum, self._count, self._total, self._weight = np.zeros((4, len(_LENGTH_NS)))
        # samples, seconds and squared recruitment
        self._kept = np.zeros(3)

    def take(
        self,
        start_ns: int,
        seconds: float,
        residual: float,
        samples: float,
        recruitment: float,
        kept: float,
    ) -> None:
        """Add a block.

        Parameters
        ----------
        start_ns : int
            Its start [ns].
        seconds : float
            The time that its samples cover.
        residual : float
            Sum of its residuals [N].
        samples : float
            Number of its samples.
        recruitment : float
            Of its pulse.
        kept : float
            Factor on the weights of earlier blocks.
        """
        for place, length in enumerate(_LENGTH_NS):
            cell = start_ns // length
            if cell != self._cell[place]:
                if self._count[place] > 0.0:
                    self._total[place] += self._sum[place] ** 2 / self._count[place]
                    self._weight[place] += 1.0
                self._cell[place] = cell
                self._sum[place] = 0.0
                self._count[place] = 0.0
        self._sum += residual
        self._count += samples
        self._total *= kept
        self._weight *= kept
        self._kept *= kept
        self._kept += (samples, seconds, recruitment**2)

    def _check_restored(self) -> None:
        lengths = {len(self._cell), *(len(part) for part in self._sums)}
        expect(lengths == {len(_LENGTH_NS)}, 'ResidualSpread', f'{len(_LENGTH_NS)} lengths')
        expect(self._kept.shape == (3,), 'ResidualSpread', '3 sums')

    @property
    def _sums(self) -> tuple[FloatArray, ...]:
        return self._sum, self._count, self._total, self._weight

    def forget(self) -> None:
        """Forget all earlier blocks."""
        self._total[:] = 0.0
        self._weight[:] = 0.0
        self._kept[:] = 0.0

    @property
    def mean(self) -> FloatArray:
        """The means (lengths,) [N^2], zero with too few sums."""
        known = self._weight >= _LEAST_SUMS
        return np.where(known, self._total / np.maximum(self._weight, 1.0), 0.0)

    @property
    def sums(self) -> ResidualSums:
        """The means, and what they were made from."""
        samples, seconds, recruited = (float(value) for value in self._kept)
        return ResidualSums(self.mean, float(self._weight[0]), samples, seconds, recruited)
