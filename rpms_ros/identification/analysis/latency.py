# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Latency by intensity as in Table 1: mean, standard deviation, number, rejected twitches.

Onset of a twitch as in the paper (Sec. 2.1): by the derivative of a filtered force.

A moving average of nine samples, divided by nine (the printed filter lacks the division), is
applied forwards and backwards; the onset is the last instant at which the derivative passes zero
upwards before the steepest rise.  The paper says 'the last positive zero crossing'; noise causes
more of them near the flat top, which are no onsets.

The average, applied twice, extends over eight samples on either side: it moves the onset earlier
by up to that much, and noise moves the crossing later.  The joint fit has neither bias;
`docs/analysis.md` has the figures.

When the force leaves its baseline: measured, not a parameter of a model.

The latency of a fitted twitch is the onset of that twitch; it is later if the force of the muscle
rises slower than that of the model.  The onset of the force is the first sample from which on the
force stays outside the noise before the pulse: an upper bound, since noise hides the beginning.
The lower bound is the last sample before it that is a standard deviation below the baseline, which
is improbable after the force has begun.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.twitch_fits import spread
from rpms_ros.pulses import FloatArray


def smoothed(force: FloatArray, samples: int) -> FloatArray:
    """Return the force after a moving average forwards and backwards, shape (samples,).

    Parameters
    ----------
    force : ndarray, shape (samples,)
        Force [N], evenly sampled.
    samples : int
        Length of the average; before its beginning the force is taken as constant.
    """
    once = _averaged(force, samples)
    back: FloatArray = _averaged(once[::-1], samples)[::-1]
    return back


def _averaged(force: FloatArray, samples: int) -> FloatArray:
    padded = np.concatenate((np.full(samples - 1, force[0]), force))
    total = np.concatenate(([0.0], np.cumsum(padded - force[0])))
    mean: FloatArray = (total[samples:] - total[:-samples]) / samples + force[0]
    return mean


def crossing_onset(lag: FloatArray, force: FloatArray, samples: int) -> float:
    """Return the onset by the derivative [s], or NaN if there is no upward crossing.

    Parameters
    ----------
    lag : ndarray, shape (samples,)
        Time since the stimulus [s], evenly spaced; only an onset after 0 is returned.
    force : ndarray, shape (samples,)
        Force [N].
    samples : int
        Length of the moving average.

    Returns
    -------
    float
        Lag at which the derivative passes zero, interpolated between samples [s].
    """
    filtered = smoothed(force, samples)
    slope = np.diff(filtered)
    middle = 0.5 * (lag[1:] + lag[:-1])
    after = np.flatnonzero(middle > 0)
    if len(after) < 2:
        return float('nan')
    peak = after[0] + int(np.argmax(filtered[after[0] + 1 :]))
    steepest = after[0] + int(np.argmax(slope[after[0] : peak + 1]))
    before = slope[after[0] : steepest + 1]
    upward = np.flatnonzero((before[:-1] <= 0) & (before[1:] > 0))
    if not len(upward):
        return float('nan')
    at = after[0] + int(upward[-1])
    share = -slope[at] / (slope[at + 1] - slope[at])
    return float(middle[at] + share * (middle[at + 1] - middle[at]))


INTENSITY_STEP = 1e-3
EVENNESS = 0.01


@dataclass(frozen=True)
class LatencyRow:
    """Latencies at one intensity.

    Attributes
    ----------
    intensity : float
        Share of the maximum; NaN if it is not recorded.
    count : int
        Twitches.
    mean, spread : float
        Mean and standard deviation [s].
    """

    intensity: float
    count: int
    mean: float
    spread: float


@dataclass(frozen=True)
class LatencyTable:
    """Latencies found with one method.

    Attributes
    ----------
    method : str
        ``joint fit`` or ``zero crossing``.
    reference : str
        Definition of the stimulus instant: ``stamp`` or ``artifact``.
    rows : tuple of LatencyRow
        One for each intensity, ascending.
    count : int
        Twitches of all rows.
    mean, spread : float
        Over all twitches [s].
    rejected : mapping of str to int
        Twitches that did not qualify, by reason.
    """

    method: str
    reference: str
    rows: tuple[LatencyRow, ...]
    count: int
    mean: float
    spread: float
    rejected: Mapping[str, int]


def latency_table(
    method: str,
    reference: str,
    latency: FloatArray,
    intensity: FloatArray,
    rejected: Mapping[str, int],
) -> LatencyTable:
    """Return the table of latencies (twitches,) [s] at intensities (twitches,).

    Latencies that are NaN count as rejected, because there is no crossing.
    """
    known = np.isfinite(latency)
    reasons = dict(rejected)
    if not known.all():
        reasons['no zero crossing before the steepest rise'] = int((~known).sum())
    latency, intensity = latency[known], intensity[known]
    level = np.round(intensity / INTENSITY_STEP) * INTENSITY_STEP
    rows = []
    for value in np.unique(level):
        same = latency[np.isnan(level) if np.isnan(value) else level == value]
        rows.append(LatencyRow(float(value), len(same), float(same.mean()), spread(same)))
    mean = float(latency.mean()) if len(latency) else float('nan')
    return LatencyTable(
        method, reference, tuple(rows), len(latency), mean, spread(latency), reasons
    )


def crossing_latency(
    response: Response, filter_span: float, period: float, to_artifact: bool
) -> float:
    """Return the latency as the paper defines it [s]; NaN without a crossing.

    Parameters
    ----------
    response : Response
        A twitch.
    filter_span : float
        Span of the moving average [s].
    period : float
        Sample period [s]; uneven samples are interpolated to it.
    to_artifact : bool
        Measure from the maximum of the artifact if there is one, else from the stamp.
    """
    lag, force = response.lag, response.force
    step = np.diff(lag)
    if np.ptp(step) > EVENNESS * period:
        even = np.arange(lag[0], lag[-1], period)
        force = np.interp(even, lag, force)
        lag = even
    samples = max(2, round(filter_span / period))
    zero = 0.0
    if to_artifact and np.isfinite(response.artifact):
        zero = response.artifact
    return crossing_onset(lag - zero, force, samples)


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
