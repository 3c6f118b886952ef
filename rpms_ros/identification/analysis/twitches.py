# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of single pulses: latency, time constant, order, peaks (Tables 1 and 2).

The latency is found in two ways: by a fit of the whole twitch, and as in the paper (Sec. 2.1) by
the derivative of a filtered force.  There a moving average of nine samples, divided by nine (the
printed filter lacks the division), is applied forwards and backwards; the onset is the last
instant at which the derivative passes zero upwards before the steepest rise.  The paper says 'the
last positive zero crossing'; noise causes more of them near the flat top, which are no onsets.

The average, applied twice, extends over eight samples on either side: it moves the onset earlier
by up to that much, and noise moves the crossing later.  The joint fit has neither bias;
`docs/analysis.md` has the figures.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpms_ros.identification.analysis.responses import (
    FILTER_SPAN,
    LEAST_FIT,
    LEAST_RESPONSE,
    LONGEST_LATENCY,
    ORDERS,
    Response,
    counted_reasons,
)
from rpms_ros.identification.analysis.twitch_fits import (
    CONSTANT,
    ERROR,
    ONSET,
    PEAK,
    OrderChoice,
    Progress,
    TwitchFits,
    choose_order,
    fit_twitches,
    shared_fit,
    spread,
)
from rpms_ros.pulses import FloatArray
from rpms_ros.schema import INTERNAL

_INTENSITY_STEP = 1e-3
_EVENNESS = 0.01


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
    """Latencies found with one method, as in Table 1.

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


@dataclass(frozen=True)
class SharedTwitch:
    """One shape fitted to all twitches at once.

    Attributes
    ----------
    order : int
        Number of equal poles.
    latency : float
        Onset after the pulse [s].
    time_constant, time_constant_deviation : float
        T_a and its standard deviation [s].
    """

    order: int
    latency: float
    time_constant: float
    time_constant_deviation: float


@dataclass(frozen=True)
class TwitchAnalysis:
    """Results of the analysis of single pulses.

    Attributes
    ----------
    fits : TwitchFits
        Twitches that qualified.
    choice : OrderChoice
        Order and evidence.
    shared : SharedTwitch
        Common shape at that order.
    time_constant, time_constant_spread : float
        Mean and standard deviation of T_a over the twitches [s] (Table 2).
    latency : LatencyTable
        From the joint fit of each twitch.
    crossing_latency : LatencyTable
        By the zero crossing, as in the paper (Table 1).
    rejected : mapping of str to int
        Twitches that did not qualify, by reason.
    example : Response
        The strongest twitch.
    """

    fits: TwitchFits = field(metadata=INTERNAL)
    choice: OrderChoice
    shared: SharedTwitch
    time_constant: float
    time_constant_spread: float
    latency: LatencyTable
    crossing_latency: LatencyTable
    rejected: Mapping[str, int]
    example: Response = field(metadata=INTERNAL)


def analyze_twitches(
    responses: Sequence[Response], rejected: Mapping[str, int], period: float, progress: Progress
) -> TwitchAnalysis | str:
    """Analyse responses to single pulses; return a sentence if none qualifies.

    Parameters
    ----------
    responses : sequence of Response
        Those whose samples are complete.
    rejected : mapping of str to int
        Those that were not, by reason.
    period : float
        Time between samples [s].
    progress : callable
        Called with the number of twitches done and of all.
    """
    fits = fit_twitches(responses, ORDERS, progress)
    verdicts = list(map(_verdict, responses, fits.table))
    reasons = Counter(rejected) + Counter(filter(None, verdicts))
    good = [item for item, reason in zip(responses, verdicts, strict=True) if not reason]
    if not good:
        return f'no response to a single pulse qualifies ({counted_reasons(reasons)})'
    fits = fits.chosen(np.array([not reason for reason in verdicts]))
    choice = choose_order(fits)
    onset, constant, peak = (fits.column(one, choice.order) for one in (ONSET, CONSTANT, PEAK))
    marked = any(np.isfinite(item.artifact) for item in good)
    crossing = np.array([crossing_latency(item, period, marked) for item in good])
    evidence = fits.intensity, reasons
    reference = 'artifact' if marked else 'stamp'
    return TwitchAnalysis(
        fits=fits,
        choice=choice,
        shared=_shared_twitch(good, fits, choice.order),
        time_constant=float(constant.mean()),
        time_constant_spread=spread(constant),
        latency=latency_table('joint fit', 'stamp', onset, *evidence),
        crossing_latency=latency_table('zero crossing', reference, crossing, *evidence),
        rejected=dict(reasons),
        example=good[int(np.argmax(peak))],
    )


def _verdict(item: Response, table: FloatArray) -> str:
    """Return why a twitch does not qualify, empty if it does; `table` is its (orders, 6)."""
    best = table[np.argmin(table[:, ERROR])]
    _, force = item.samples
    noise = max(math.sqrt(best[ERROR] / len(force)), 1e-300)
    power = max(float(np.sum((force - force.mean()) ** 2)), 1e-300)
    if not best[PEAK] / noise >= LEAST_RESPONSE:
        return f'peak below {LEAST_RESPONSE:g} x noise'
    if not 0.0 <= best[ONSET] <= LONGEST_LATENCY:
        return f'onset not within {LONGEST_LATENCY * 1e3:g} ms'
    if 1.0 - math.sqrt(best[ERROR] / power) < LEAST_FIT:
        return f'fit below {LEAST_FIT:.0%}'
    return ''


def _shared_twitch(responses: Sequence[Response], fits: TwitchFits, order: int) -> SharedTwitch:
    """Return one onset and time constant for all responses."""
    lag, force = np.concatenate([item.samples for item in responses], axis=1)
    medians = np.median([fits.column(ONSET, order), fits.column(CONSTANT, order)], axis=1)
    start = np.array([medians[0], np.log(medians[1]), float(order)])
    found = shared_fit(lag, force, np.append(0, np.cumsum(fits.samples)), start)
    free = max(1, len(lag) - 2 * len(responses) - 2)
    deviation = math.sqrt(np.linalg.pinv(found.normal)[1, 1] * found.cost[0] / free)
    onset, constant = float(found.theta[0]), float(np.exp(found.theta[1]))
    return SharedTwitch(order, onset, constant, constant * deviation)


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
    level = np.round(intensity / _INTENSITY_STEP) * _INTENSITY_STEP
    rows = []
    for value in np.unique(level):
        same = latency[np.isnan(level) if np.isnan(value) else level == value]
        rows.append(LatencyRow(float(value), len(same), float(same.mean()), spread(same)))
    mean = float(latency.mean()) if len(latency) else math.nan
    every = len(latency), mean, spread(latency)
    return LatencyTable(method, reference, tuple(rows), *every, reasons)


def crossing_latency(response: Response, period: float, to_artifact: bool) -> float:
    """Return the latency as the paper defines it [s]; NaN without a crossing.

    Parameters
    ----------
    response : Response
        A twitch.
    period : float
        Sample period [s]; uneven samples are interpolated to it.
    to_artifact : bool
        Measure from the maximum of the artifact if there is one, else from the stamp.
    """
    lag, force = response.lag, response.force
    if np.isfinite(response.artifact):
        # upwards, as that of the paper: the way back of a downward one would be the steepest rise
        clean = np.interp(lag, *response.samples)
        downward = (force < clean)[np.abs(lag - response.artifact).argmin()]
        force = 2.0 * clean - force if downward else force
    if np.ptp(np.diff(lag)) > _EVENNESS * period:
        even = np.arange(lag[0], lag[-1], period)
        lag, force = even, np.interp(even, lag, force)
    zero = response.artifact if to_artifact and np.isfinite(response.artifact) else 0.0
    return crossing_onset(lag - zero, force, max(2, round(FILTER_SPAN / period)))


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
        return math.nan
    first = after[0]
    peak = first + int(np.argmax(filtered[first + 1 :]))
    steepest = first + int(np.argmax(slope[first : peak + 1]))
    before = slope[first : steepest + 1]
    upward = np.flatnonzero((before[:-1] <= 0) & (before[1:] > 0))
    if not len(upward):
        return math.nan
    at = first + int(upward[-1])
    share = -slope[at] / (slope[at + 1] - slope[at])
    return float(middle[at] + share * (middle[at + 1] - middle[at]))


def smoothed(force: FloatArray, samples: int) -> FloatArray:
    """Return the force (samples,) [N] after a moving average forwards and backwards.

    Before its beginning the force is taken as constant.
    """
    for _ in range(2):
        padded = np.pad(force, (samples - 1, 0), mode='edge')
        force = np.convolve(padded, np.full(samples, 1.0 / samples), mode='valid')[::-1]
    return force
