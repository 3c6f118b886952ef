# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Responses to groups of pulses, cut out of a recording, or the reason for rejecting them."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.artifact import Artifacts
from rpms_ros.identification.analysis.artifact import near_pulses
from rpms_ros.identification.analysis.cleaning import CleanTrace
from rpms_ros.identification.analysis.segmentation import PulseGroup
from rpms_ros.identification.analysis.settings import AnalysisSettings
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

LEAST_SAMPLES = 50
LEAST_BEFORE = 10
GAP = 5.0


@dataclass(frozen=True)
class Response:
    """Force around the pulses of one group.

    Attributes
    ----------
    onset : ndarray, shape (pulses,)
        Pulses, the first at 0 [s].
    lag : ndarray, shape (samples,)
        Time since the first pulse [s].
    force : ndarray, shape (samples,)
        Force [N].
    usable : ndarray of bool, shape (samples,)
        Samples that no artifact affects.
    intensity : float
        Of the first pulse, share of the maximum; NaN if it is not recorded.
    artifact : float
        Time of the artifact of the first pulse after that pulse [s]; NaN without one.
    start_ns : int
        Stamp of the first pulse, in the sensor's clock [ns].
    """

    onset: FloatArray
    lag: FloatArray
    force: FloatArray
    usable: BoolArray
    intensity: float
    artifact: float
    start_ns: int

    @property
    def baseline(self) -> float:
        """Mean force before the first pulse [N]."""
        return float(np.mean(self.force[self.lag < 0]))


class Cutter:
    """Cuts responses out of one recording.

    Parameters
    ----------
    trace : CleanTrace
        Force.
    pulses : PulseTrain
        Pulses, ascending, in the stimulator's clock.
    artifacts : Artifacts
        Offset of the two clocks.
    settings : AnalysisSettings
        Spans.
    """

    def __init__(
        self,
        trace: CleanTrace,
        pulses: PulseTrain,
        artifacts: Artifacts,
        settings: AnalysisSettings,
    ) -> None:
        self._trace = trace
        self._artifacts = artifacts
        self._settings = settings
        self._intensity = pulses.intensity
        shift = nanoseconds(artifacts.clock_offset)
        self.onset_ns = pulses.onset_ns + shift

    def cut(self, group: PulseGroup) -> Response | str:
        """Return the response to a group of pulses, or why it does not qualify."""
        settings, trace = self._settings, self._trace
        start = int(self.onset_ns[group.first])
        before = nanoseconds(settings.before)
        after = nanoseconds(settings.after)
        end = int(self.onset_ns[group.last - 1]) + after
        if group.last < len(self.onset_ns):
            end = min(end, int(self.onset_ns[group.last]))
        part = trace.between(start - before, end)
        stamps = trace.stamp_ns[part]
        lag = (stamps - start) / NANOSECONDS_PER_SECOND
        if reason := self._missing(lag, end - start):
            return reason
        if trace.saturated[part].any():
            return 'sensor saturated'
        usable = self._usable(stamps, self.onset_ns[group.first : group.last])
        # the fits divide by the spread of the force
        if not usable.any() or not np.ptp(trace.force[part][usable]):
            return 'the force never changes'
        onset = (self.onset_ns[group.first : group.last] - start) / NANOSECONDS_PER_SECOND
        return Response(
            onset,
            lag,
            trace.force[part],
            usable,
            float(self._intensity[group.first]),
            float(self._artifacts.offset[group.first] - self._artifacts.clock_offset),
            start,
        )

    def _missing(self, lag: FloatArray, length_ns: int) -> str:
        """Return why samples are missing, empty if none is."""
        if (lag < 0).sum() < LEAST_BEFORE:
            return 'no force before the pulse'
        if len(lag) < LEAST_SAMPLES:
            return 'too few force samples'
        step = np.diff(lag)
        if step.max() > GAP * np.median(step):
            return 'force samples missing'
        if lag[-1] < length_ns / NANOSECONDS_PER_SECOND - GAP * float(np.median(step)):
            return 'recording ends within the response'
        return ''

    def _usable(self, stamp_ns: IntArray, onset_ns: IntArray) -> BoolArray:
        """Return the samples (samples,) that no artifact affects."""
        if not self._artifacts.found:
            return np.ones(len(stamp_ns), dtype=np.bool_)
        period, blanking = self._trace.sample_period, self._settings.blanking
        return ~near_pulses(stamp_ns, onset_ns, period, blanking)
