# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Steady force of long levels, to which the recruitment field is fitted (Sec. 2.2, Fig. 9).

It is the mean over whole periods of the pulses, after the force has settled, above a baseline that
is linear from the rest before one group to the rest before the next.
"""

from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.cleaning import CleanTrace
from rpms_ros.identification.analysis.segmentation import Level
from rpms_ros.identification.analysis.segmentation import PulseGroup
from rpms_ros.identification.analysis.settings import AnalysisSettings
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import nanoseconds

LEAST_PERIODS = 4
REST_SPAN = 0.2


@dataclass(frozen=True)
class SteadyPoint:
    """A level whose force was steady.

    Attributes
    ----------
    intensity : float
        Share of the maximum.
    rate_hz : float
        Repetition rate [Hz].
    force : float
        Mean force above the baseline [N].
    ripple : float
        Greatest minus least mean over the phase of the period [N].
    start_ns : int
        First pulse of the level [ns].
    rest : int
        Index of the rest before the level; the baseline is interpolated to the next one.
    rest_share : float
        Weight of the next rest, 0..1.
    rest_deviation : float
        Standard deviation of the baseline at one rest [N]; its error is common to all levels
        between two rests.
    """

    intensity: float
    rate_hz: float
    force: float
    ripple: float
    start_ns: int
    rest: int = 0
    rest_share: float = 0.0
    rest_deviation: float = 0.0


@dataclass(frozen=True)
class Baseline:
    """Force at rest, between groups of pulses.

    Attributes
    ----------
    time_ns : ndarray of int64, shape (rests,)
        Middles of the rests [ns].
    force : ndarray, shape (rests,)
        Means [N].
    deviation : float
        Standard deviation of each of them, by the scatter of the samples at rest [N].
    """

    time_ns: IntArray
    force: FloatArray
    deviation: float

    def at(self, moment_ns: float) -> float:
        """Return the baseline at a time [ns]."""
        return float(np.interp(moment_ns, self.time_ns, self.force))

    def place(self, moment_ns: float) -> tuple[int, float]:
        """Return the index of the rest before a time [ns], and the weight of the next rest."""
        place = float(np.interp(moment_ns, self.time_ns, np.arange(len(self.time_ns))))
        return int(place), place - int(place)


def resting_force(
    trace: CleanTrace, groups: tuple[PulseGroup, ...], onset_ns: IntArray
) -> Baseline | None:
    """Return the baseline before each group and at the end; None without any rest."""
    span = nanoseconds(REST_SPAN)
    ends = [int(onset_ns[group.first]) for group in groups]
    if groups and trace.stamp_ns[-1] - onset_ns[-1] > NANOSECONDS_PER_SECOND:
        ends.append(int(trace.stamp_ns[-1]) + 1)
    times, forces, variances = [], [], []
    for end in ends:
        part = trace.between(end - span, end)
        if part.stop > part.start:
            times.append(end - span // 2)
            forces.append(float(np.mean(trace.force[part])))
            variances.append(float(np.var(trace.force[part])) / (part.stop - part.start))
    if not times:
        return None
    return Baseline(np.array(times), np.array(forces), float(np.sqrt(np.mean(variances))))


def steady_point(
    trace: CleanTrace,
    onset_ns: IntArray,
    level: Level,
    baseline: Baseline,
    settings: AnalysisSettings,
) -> SteadyPoint | str:
    """Return the steady force of a level, or why there is none."""
    if not np.isfinite(level.intensity):
        return 'intensity not recorded'
    start = int(onset_ns[level.first])
    period = NANOSECONDS_PER_SECOND / level.rate_hz
    end = float(onset_ns[level.last - 1]) + period
    settled = start + settings.settling * NANOSECONDS_PER_SECOND
    periods = int((end - settled) / period + 1e-6)
    if periods < LEAST_PERIODS:
        return f'level shorter than {settings.settling:g} s and {LEAST_PERIODS} periods'
    first = end - periods * period
    part = trace.between(round(first), round(end))
    if part.stop - part.start < 0.9 * (end - first) / (
        trace.sample_period * NANOSECONDS_PER_SECOND
    ):
        return 'force samples missing'
    if trace.saturated[part].any():
        return 'sensor saturated'
    force: FloatArray = trace.force[part] - baseline.at(0.5 * (first + end))
    phase = np.asarray((trace.stamp_ns[part] - first) / period % 1.0, dtype=np.float64)
    ripple = _ripple(phase, force)
    rest, share = baseline.place(0.5 * (first + end))
    return SteadyPoint(
        level.intensity,
        level.rate_hz,
        float(force.mean()),
        ripple,
        start,
        rest,
        share,
        baseline.deviation,
    )


def _ripple(phase: FloatArray, force: FloatArray) -> float:
    """Return the span of the force averaged over the phase of the period [N]."""
    part = np.minimum((phase * 10).astype(np.int64), 9)
    means = [float(np.mean(force[part == k])) for k in range(10) if (part == k).any()]
    return max(means) - min(means)
