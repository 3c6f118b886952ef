# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of single pulses: latency, time constant, order, peaks (Tables 1 and 2)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.latency import LatencyTable, crossing_latency, latency_table
from rpms_ros.identification.analysis.responses import AnalysisSettings, Response
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
    signal_to_noise,
    spread,
)
from rpms_ros.identification.analysis.twitch_kernel import shared_fit
from rpms_ros.pulses import FloatArray


@dataclass(frozen=True)
class SharedTwitch:
    """One shape fitted to all twitches at once.

    Attributes
    ----------
    order : int
        Number of equal poles.
    latency, latency_deviation : float
        Onset after the pulse and its standard deviation [s].
    time_constant, time_constant_deviation : float
        T_a and its standard deviation [s].
    """

    order: int
    latency: float
    latency_deviation: float
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

    fits: TwitchFits
    choice: OrderChoice
    shared: SharedTwitch
    time_constant: float
    time_constant_spread: float
    latency: LatencyTable
    crossing_latency: LatencyTable
    rejected: Mapping[str, int]
    example: Response

    @property
    def relative_peak(self) -> FloatArray:
        """Peaks relative to the mean peak at the greatest intensity (twitches,), as in Fig. 5."""
        peak = self.fits.column(PEAK, self.choice.order)
        top = np.nan_to_num(self.fits.intensity, nan=1.0)
        return np.asarray(peak / peak[top >= top.max() - 1e-3].mean())


def analyze_twitches(
    responses: Sequence[Response],
    rejected: Mapping[str, int],
    sample_period: float,
    settings: AnalysisSettings,
    progress: Progress | None = None,
) -> TwitchAnalysis | str:
    """Analyse responses to single pulses; return a sentence if none qualifies.

    Parameters
    ----------
    responses : sequence of Response
        Those whose samples are complete.
    rejected : mapping of str to int
        Those that were not, by reason.
    sample_period : float
        Time between samples [s].
    settings : AnalysisSettings
        Thresholds.
    progress : callable, optional
        Called with the number of twitches done and of all.
    """
    reasons = Counter(rejected)
    if not responses:
        return _none_left(reasons)
    fits = fit_twitches(responses, settings.orders, progress)
    verdict = _verdicts(fits, responses, settings)
    reasons.update(reason for reason in verdict if reason)
    kept = np.array([not reason for reason in verdict])
    if not kept.any():
        return _none_left(reasons)
    good = [item for item, keep in zip(responses, kept, strict=True) if keep]
    return _summary(good, fits.chosen(kept), dict(reasons), sample_period, settings)


def _none_left(reasons: Mapping[str, int]) -> str:
    why = ', '.join(f'{count} x {reason}' for reason, count in reasons.items())
    return f'no response to a single pulse qualifies ({why})'


def _summary(
    responses: Sequence[Response],
    fits: TwitchFits,
    rejected: Mapping[str, int],
    sample_period: float,
    settings: AnalysisSettings,
) -> TwitchAnalysis:
    choice = choose_order(fits)
    constants = fits.column(CONSTANT, choice.order)
    marked = any(np.isfinite(item.artifact) for item in responses)
    crossing = np.array(
        [crossing_latency(item, settings.filter_span, sample_period, marked) for item in responses]
    )
    return TwitchAnalysis(
        fits=fits,
        choice=choice,
        shared=shared_twitch(responses, fits, choice.order),
        time_constant=float(constants.mean()),
        time_constant_spread=spread(constants),
        latency=latency_table(
            'joint fit', 'stamp', fits.column(ONSET, choice.order), fits.intensity, rejected
        ),
        crossing_latency=latency_table(
            'zero crossing',
            'artifact' if marked else 'stamp',
            crossing,
            fits.intensity,
            rejected,
        ),
        rejected=rejected,
        example=responses[int(np.argmax(fits.column(PEAK, choice.order)))],
    )


def _verdicts(
    fits: TwitchFits, responses: Sequence[Response], settings: AnalysisSettings
) -> list[str]:
    """Return for each twitch why it does not qualify, empty if it does."""
    best = np.argmin(fits.table[:, :, ERROR], axis=1)
    row = np.arange(len(fits))
    strength = np.stack([signal_to_noise(fits, order) for order in fits.orders], axis=1)
    verdicts = []
    for index, item in enumerate(responses):
        onset, error = fits.table[row[index], best[index]][[ONSET, ERROR]]
        force = item.force[item.usable]
        explained = 1.0 - np.sqrt(error / max(float(np.sum((force - force.mean()) ** 2)), 1e-300))
        if not strength[index, best[index]] >= settings.least_response:
            verdicts.append(f'peak below {settings.least_response:g} x noise')
        elif not 0.0 <= onset <= settings.longest_latency:
            verdicts.append(f'onset not within {settings.longest_latency * 1e3:g} ms')
        elif explained < settings.least_fit:
            verdicts.append(f'fit below {settings.least_fit:.0%}')
        else:
            verdicts.append('')
    return verdicts


def shared_twitch(responses: Sequence[Response], fits: TwitchFits, order: int) -> SharedTwitch:
    """Return one onset and time constant for all responses."""
    lag = np.concatenate([item.lag[item.usable] for item in responses])
    force = np.concatenate([item.force[item.usable] for item in responses])
    starts = np.concatenate(([0], np.cumsum(fits.samples)))
    onset = float(np.median(fits.column(ONSET, order)))
    constant = float(np.median(fits.column(CONSTANT, order)))
    start = np.array([onset, np.log(constant), float(order)])
    theta, normal, error = shared_fit(lag, force, starts, start, 2)
    free = max(1, len(lag) - 2 * len(responses) - 2)
    covariance = np.linalg.pinv(normal) * (error / free)
    constant = float(np.exp(theta[1]))
    return SharedTwitch(
        order,
        float(theta[0]),
        float(np.sqrt(covariance[0, 0])),
        constant,
        constant * float(np.sqrt(covariance[1, 1])),
    )
