# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples that jump away from the predicted force, and back again.

In a fast stream neighbouring samples show an excursion of less than 10 ms.  The prediction also
shows a longer one, or a single sample of a slow sensor, if it was good before.  A deviation that
lasts is no outlier, however large it is: the muscle has changed, or the patient pulls.  Nor is
one that begins or ends smoothly: the force of a muscle does not jump from one sample to the next.
"""

from collections import deque
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import ProcessedSamples
from rpms_ros.identification.monitors.interface import Window
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Cells from which usual residuals follow, and how many of them must have been predicted well.
_CELLS = 30
_EXPLAINED = 15
# A residual is large if it exceeds so many times the largest of a usual cell, and this share of
# the largest range of the predicted force within a cell.
_TIMES = 4.0
_SHARE = 0.1
# Outliers begin and end with a step of at least this share of their distance.
_STEP_SHARE = 0.5
# They last no longer than this, or so many samples of a slow sensor.
_LONGEST_NS = 20_000_000
_LONGEST_COUNT = 2
# If there are more than this share of a second, and more than so many, they are a disturbance.
_RECENT_CELLS = 10
_FEW_SHARE = 0.03
_FEW = 4


class Outliers(Monitor):
    """Finds `force_outlier`."""

    doubtful: ClassVar[Mapping[str, float]] = {faults.FORCE_OUTLIER: 0.01}

    _largest: deque[float]
    _explained: deque[bool]
    _range: float
    _before: float
    _begun_ns: int | None
    _count: int
    _recent: deque[tuple[int, int]]

    def __init__(self) -> None:
        self._largest = deque(maxlen=_CELLS)
        self._explained = deque(maxlen=_CELLS)
        self._range = 0.0
        self._before = 0.0
        self._begun_ns = None
        self._count = 0
        self._recent = deque(maxlen=_RECENT_CELLS)

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return the samples that are briefly far from their prediction."""
        known = sum(self._explained) >= _EXPLAINED
        if window.prediction is None or not known:
            self._begun_ns = None
            return {}
        residual = window.force[window.first : window.last] - window.prediction
        usual = float(np.median(self._largest))
        limit = max(_TIMES * usual, _SHARE * self._range)
        beyond = (np.abs(residual) > limit) & ~window.found
        found = np.zeros_like(window.found)
        if beyond.any():
            stamps = window.stamp_ns[window.first : window.last]
            self._mark_runs(stamps, residual, beyond, found)
        else:
            self._begun_ns = None
        self._before = float(residual[-1])
        edges = window.edges[1:-1] - window.first
        total = np.concatenate(([0], np.cumsum(found)))[edges]
        counts = zip(np.diff(total).tolist(), np.diff(edges).tolist(), strict=True)
        for cell, (marked, samples) in enumerate(counts):
            if samples:
                self._recent.append((marked, samples))
            if marked:
                of_second = np.sum(self._recent, axis=0)
                if of_second[0] > max(_FEW, _FEW_SHARE * of_second[1]):
                    found[edges[cell] : edges[cell + 1]] = False
        return {faults.FORCE_OUTLIER: found} if found.any() else {}

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Update the usual residuals."""
        for _, error, largest, explained in samples.fits:
            follows = explained > 3.0 * error
            self._largest.append(largest)
            self._explained.append(follows or largest < _SHARE * self._range)
            if follows:
                self._range = max(self._range, explained)
        return {}

    def restart(self) -> None:
        """Forget the usual residuals: the muscle may have rested."""
        self._largest.clear()
        self._explained.clear()
        self._begun_ns = None

    def _mark_runs(
        self, stamp_ns: IntArray, residual: FloatArray, beyond: BoolArray, found: BoolArray
    ) -> None:
        """Mark runs of distant samples that are short and begin and end with a step."""
        edges = np.flatnonzero(np.diff(beyond, prepend=False, append=False)).reshape(-1, 2)
        for begin, end in edges.tolist():
            if begin or self._begun_ns is None:
                before = float(residual[begin - 1]) if begin else self._before
                jumps = abs(residual[begin] - before) >= _STEP_SHARE * abs(residual[begin])
                # A run that began smoothly is no outlier: it counts as too long.
                self._begun_ns = (
                    int(stamp_ns[begin]) if jumps else int(stamp_ns[begin]) - _LONGEST_NS
                )
                self._count = 0 if jumps else _LONGEST_COUNT
            self._count += end - begin
            lasted_ns = int(stamp_ns[end - 1]) - self._begun_ns
            brief = lasted_ns < _LONGEST_NS or self._count <= _LONGEST_COUNT
            if end < len(residual):
                step = abs(residual[end - 1] - residual[end])
                brief = brief and bool(step >= _STEP_SHARE * abs(residual[end - 1]))
            found[begin:end] = brief
        if not beyond[-1]:
            self._begun_ns = None
