# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Latency by intensity as in Table 1: mean, standard deviation, number, rejected twitches."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.onset import crossing_onset
from rpms_ros.identification.analysis.order_choice import spread
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.pulses import FloatArray

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
