# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force that the model does not predict although it did before."""

from collections import deque
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import ProcessedSamples

# Cells from which usual residuals follow, and how many of them must have been predicted well.
_CELLS = 30
_EXPLAINED = 15
# A residual is large if it exceeds so many times the usual one, and this share of the largest
# range of the predicted force within a cell.
_TIMES = 8.0
_SHARE = 0.1


class Unexplained(Monitor):
    """Finds `force_unexplained`.

    The usual residual is the median over three seconds: a lasting change is reported for half of
    that time.
    """

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_UNEXPLAINED: 0.002}

    _residuals: deque[float]
    _explained: deque[bool]
    _range: float

    def __init__(self) -> None:
        self._residuals = deque(maxlen=_CELLS)
        self._explained = deque(maxlen=_CELLS)
        self._range = 0.0

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Return the number of used samples if residuals are far larger than usual."""
        known = sum(self._explained) >= _EXPLAINED and len(self._residuals) == _CELLS
        usual = float(np.median(self._residuals)) if known else np.inf
        large = max(_TIMES * usual, _SHARE * self._range)
        count = 0
        for used, error, _, explained in samples.fits:
            count += used if error > large else 0
            self._residuals.append(error)
            self._explained.append(explained > 3.0 * error)
            if self._explained[-1]:
                self._range = max(self._range, explained)
        return {faults.FORCE_UNEXPLAINED: count} if count else {}

    def restart(self) -> None:
        """Forget the usual residual: the muscle may have rested."""
        self._residuals.clear()
        self._explained.clear()
