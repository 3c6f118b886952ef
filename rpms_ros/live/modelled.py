# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The force that the newest estimate gives for the pulses that were delivered.

The response to one pulse at full intensity, times the recruitment of each pulse relative to full
intensity, Eq. (30), summed over the pulses, plus the newest level of the baseline if the estimate
has one.  It is what the page draws beside the measured force; it is not the prediction that an
estimator makes before it learns from a sample.
"""

import math
from collections import deque

import numpy as np

from rpms_ros.identification.estimate import Estimate
from rpms_ros.muscle.identified_form import PARAMETER_NAMES
from rpms_ros.muscle.identified_form import RecruitmentParameters
from rpms_ros.muscle.identified_form import identified_recruitment
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# More than a second of pulses at the highest rate of a schedule.
_MOST_PULSES = 2000
_MOST_TIMES = 5000
# No response lasts so long; a much longer one could not be counted in nanoseconds.
_LONGEST_S = 100.0
# A response may become longer with the next estimate.
_LATEST_NS = 1_000_000_000


class ModelledForce:
    """Sums responses to pulses; all NaN before the first estimate that has one."""

    def __init__(self) -> None:
        self._pulses: deque[tuple[int, float]] = deque(maxlen=_MOST_PULSES)
        self._estimate: Estimate | None = None

    def pulse(self, onset_ns: int, intensity: float) -> None:
        """Take a pulse that was delivered; its intensity is within 0..1."""
        self._pulses.append((onset_ns, intensity))

    def estimate(self, estimate: Estimate) -> None:
        """Take the newest estimate, if it can be drawn."""
        time, force = estimate.response_time, estimate.response_force
        finite = len(time) > 1 and np.isfinite(time).all() and np.isfinite(force).all()
        bounded = len(time) <= _MOST_TIMES and finite and np.abs(time).max() <= _LONGEST_S
        if bounded and (np.diff(time) > 0.0).all():
            self._estimate = estimate

    def at(self, stamp_ns: IntArray) -> FloatArray:
        """Return the force [N] at stamps (n,), ascending."""
        if self._estimate is None or not len(stamp_ns):
            return np.full(len(stamp_ns), np.nan)
        time, response = self._estimate.response_time, self._estimate.response_force
        oldest = int(stamp_ns[0]) - math.ceil(float(time[-1]) * 1e9)
        self._forget(oldest - _LATEST_NS)
        acting = [pulse for pulse in self._pulses if oldest < pulse[0] <= int(stamp_ns[-1])]
        total = np.full(len(stamp_ns), _baseline(self._estimate))
        if acting:
            onset_ns = np.array([onset for onset, _ in acting], dtype=np.int64)
            share = _relative_recruitment(self._estimate, np.array([u for _, u in acting]))
            after = (stamp_ns[:, None] - onset_ns[None, :]) * 1e-9
            total += np.interp(after, time, response, left=0.0, right=0.0) @ share
        return total

    def _forget(self, stamp_ns: int) -> None:
        """Forget pulses before a stamp: looking at all of them takes longer than the rest."""
        while self._pulses and self._pulses[0][0] < stamp_ns:
            self._pulses.popleft()


def warm_up() -> None:
    """Compile beforehand: the page would stand still at the first pulse."""
    identified_recruitment(RecruitmentParameters(0.3, 0.7, 6.0), np.ones(1))


def _baseline(estimate: Estimate) -> float:
    levels = [
        float(value)
        for name, value in zip(estimate.linear_names, estimate.linear, strict=False)
        if name.startswith('baseline')
    ]
    return levels[-1] if levels and math.isfinite(levels[-1]) else 0.0


def _relative_recruitment(estimate: Estimate, intensity: FloatArray) -> FloatArray:
    """Return rho(u) / rho(1) of intensities (n,), NaN where the estimate cannot tell."""
    if estimate.nonlinear_names == PARAMETER_NAMES:
        parameters = RecruitmentParameters(*(float(value) for value in estimate.nonlinear))
        rho = identified_recruitment(parameters, np.append(intensity, 1.0))
    elif estimate.curve_known:
        grid, curve = estimate.curve_intensity, estimate.curve_force
        rho = np.interp(np.append(intensity, 1.0), grid, curve)
    else:
        return np.full(len(intensity), np.nan)
    return rho[:-1] / rho[-1] if rho[-1] else np.full(len(intensity), np.nan)
