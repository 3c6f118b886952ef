# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulation artifacts in the force: the stimulus instant by the clock of the sensor.

The artifact lasts one or two samples, so the force minus its running median over five samples is
the artifact and noise.  Its maximum is the paper's stimulus instant (Sec. 2.1); its distance from
the stamp of the pulse shows the offset between the clocks of stimulator and sensor.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from rpms_ros.identification.analysis.cleaning import CleanTrace
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import nanoseconds

# Of 40 samples of white noise one in a million trials exceeds six standard deviations.
STANDS_OUT = 6.0
LEAST_SHARE = 0.5
LEAST_OF_RESPONSE = 0.02
MEDIAN_SPAN = 5


@dataclass(frozen=True)
class Artifacts:
    """Offset between the clocks of force and pulses, by the artifacts.

    Attributes
    ----------
    offset : ndarray, shape (pulses,)
        Artifact's maximum minus stamp [s]; NaN where no artifact stands out.
    found : bool
        Whether the recording shows artifacts at all.
    median_offset, spread : float
        Median and scaled interquartile range of the offsets [s].
    clock_offset : float
        Clock of the sensor minus clock of the stimulator [s]; 0 if the artifacts agree with the
        stamps within the sampling.
    """

    offset: FloatArray
    found: bool
    median_offset: float
    spread: float
    clock_offset: float

    @property
    def count(self) -> int:
        """Number of pulses with an artifact."""
        return int(np.isfinite(self.offset).sum())


def find_artifacts(trace: CleanTrace, onset_ns: IntArray, search: float) -> Artifacts:
    """Return the offsets of the artifacts of pulses.

    Parameters
    ----------
    trace : CleanTrace
        Force.
    onset_ns : ndarray of int64, shape (pulses,)
        Stamps of the pulses, ascending [ns].
    search : float
        Largest distance between artifact and stamp [s].
    """
    offset = np.full(len(onset_ns), np.nan)
    reach = _reaches(onset_ns, search)
    noise = max(trace.noise, 1e-12)
    least = max(STANDS_OUT * noise, LEAST_OF_RESPONSE * float(np.ptp(trace.force)))
    for index, onset in enumerate(onset_ns):
        part = trace.between(int(onset - reach[index]), int(onset + reach[index]) + 1)
        if part.stop - part.start < MEDIAN_SPAN:
            continue
        standing = _standing_out(trace.force[part])
        best = int(np.argmax(standing))
        if standing[best] > least:
            moment = trace.stamp_ns[part.start + best]
            offset[index] = (moment - onset) / NANOSECONDS_PER_SECOND
    return _judged(offset, trace.sample_period)


def near_pulses(
    stamp_ns: IntArray, onset_ns: IntArray, sample_period: float, blanking: float
) -> BoolArray:
    """Return the samples (samples,) that an artifact may affect.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    onset_ns : ndarray of int64, shape (pulses,)
        Pulses in the clock of the sensor, ascending, at least one [ns].
    sample_period : float
        Time between samples: clocks that count as equal may differ by 1.5 of it [s].
    blanking : float
        Span after a pulse [s].
    """
    margin = nanoseconds(1.5 * sample_period)
    latest = np.searchsorted(onset_ns, stamp_ns + margin, side='right') - 1
    since = stamp_ns - onset_ns[np.maximum(latest, 0)]
    touched: BoolArray = (latest >= 0) & (since < blanking * NANOSECONDS_PER_SECOND)
    return touched


def without_artifacts(trace: CleanTrace, onset_ns: IntArray, blanking: float) -> CleanTrace:
    """Return the trace with straight lines where artifacts were."""
    touched = near_pulses(trace.stamp_ns, onset_ns, trace.sample_period, blanking)
    clear = ~touched
    if not touched.any() or not clear.any():
        return trace
    force = trace.force.copy()
    time = trace.stamp_ns - trace.stamp_ns[0]
    force[touched] = np.interp(time[touched], time[clear], trace.force[clear])
    return replace(trace, force=force)


def _reaches(onset_ns: IntArray, search: float) -> IntArray:
    """Return how far from each stamp to search without reaching a neighbour (pulses,) [ns]."""
    reach = np.full(len(onset_ns), nanoseconds(search), dtype=np.int64)
    if len(onset_ns) > 1:
        half = np.diff(onset_ns) // 2
        reach = np.minimum(reach, np.minimum(np.append(half, half[-1]), np.append(half[0], half)))
    return reach


def _standing_out(force: FloatArray) -> FloatArray:
    """Return the force minus its running median."""
    padded = np.pad(force, MEDIAN_SPAN // 2, mode='edge')
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_SPAN)
    return force - np.median(windows, axis=1)


def _judged(offset: FloatArray, period: float) -> Artifacts:
    """Return the offsets, and whether they are artifacts: these have one distance from stamps."""
    seen = offset[np.isfinite(offset)]
    if not len(seen):
        return Artifacts(offset, False, float('nan'), float('nan'), 0.0)
    low, median, high = np.percentile(seen, [25, 50, 75])
    steady = np.abs(seen - median) <= 2.0 * period
    found = len(seen) >= 2 and bool(steady.mean() >= LEAST_SHARE)
    # The first sample after the pulse comes half a period late on average.
    shift = float(median - 0.5 * period)
    clock = shift if found and abs(shift) > 1.5 * period else 0.0
    return Artifacts(offset, found, float(median), float((high - low) / 1.349), clock)
