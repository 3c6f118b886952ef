# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Residual of the model: whether it is white, and whether it is correlated with the pulses.

A residual (measured minus predicted) that is correlated with itself contains dynamics or drift
that the model lacks; one correlated with the pulses contains a response that the model lacks.

The sample autocorrelation at lag k is r(k) = sum_i e_i e_(i+k) / sum_i e_i^2; of white noise 95 %
lie within +-1.96 / sqrt(N).  The cross-correlation c(k) of the input with the residual k samples
later has, if the two are independent, the variance sum_l r_ee(l) r_uu(l) / N (Bartlett's formula;
Box and Jenkins, Time Series Analysis, Ch. 11): a band made for white residuals would call every
periodic input correlated.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from rpms_ros.errors import ReportError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, PulseTrain

# Two-sided quantile of the normal distribution at 95 %.
BAND_95 = 1.959963984540054
# How far the correlations are shown [s]: longer than a pulse acts.
_LONGEST_LAG = 0.4
_EARLIEST_LAG = 0.1
_FEWEST_SAMPLES = 50


@dataclass(frozen=True)
class ResidualAnalysis:
    """Residuals of a span of a session.

    Attributes
    ----------
    samples : int
        Number of residuals.
    sample_period_s : float
        Median time between two samples [s].
    root_mean_square, mean : float
        Of the residuals [N].
    lag_s : ndarray (lags,)
        Lags of the autocorrelation [s], from 0.
    autocorrelation : ndarray (lags,)
        r(k); 1 at lag 0.
    autocorrelation_band : float
        95 % band if the residual is white.
    autocorrelation_outside : float
        Share of the lags above 0 whose autocorrelation lies outside the band; 0.05 if white.
    cross_lag_s : ndarray (cross lags,)
        Time from a pulse to the residual [s]; negative lags are before the pulse.
    cross_correlation : ndarray (cross lags,)
        c(k); empty if the span holds no pulse or pulses of one intensity at every sample.
    cross_correlation_band : float
        95 % band if residual and input are independent.
    cross_correlation_outside : float
        Share of the lags from 0 on that lie outside it.
    """

    samples: int
    sample_period_s: float
    root_mean_square: float
    mean: float
    lag_s: FloatArray
    autocorrelation: FloatArray
    autocorrelation_band: float
    autocorrelation_outside: float
    cross_lag_s: FloatArray
    cross_correlation: FloatArray
    cross_correlation_band: float
    cross_correlation_outside: float


def analyse_residuals(
    stamp_ns: IntArray, residual: FloatArray, pulses: PulseTrain
) -> ResidualAnalysis:
    """Return the correlations of a residual with itself and with the pulses.

    Parameters
    ----------
    stamp_ns : ndarray of int64 (samples,)
        Ascending times [ns]; lags are counted in samples, so they should be regular.
    residual : ndarray (samples,)
        Measured minus predicted [N].
    pulses : PulseTrain
        Pulses of the session, in any order.

    Raises
    ------
    ReportError
        If there are fewer than 50 samples, their stamps do not ascend, or the residual never
        changes.
    """
    if (count := len(residual)) < _FEWEST_SAMPLES:
        raise ReportError(f'expected at least {_FEWEST_SAMPLES} residuals, got {count}')
    if np.any(np.diff(stamp_ns) <= 0):
        raise ReportError('expected residuals with ascending stamps, got a clock that jumped')
    # the variance of differences below 1e-154 N is zero, too
    if residual.var() == 0.0:
        raise ReportError(f'expected residuals that differ, got {residual[0]} only')
    period = float(np.median(np.diff(stamp_ns))) / NANOSECONDS_PER_SECOND
    longest = min(round(_LONGEST_LAG / period), count // 4)
    centred = residual - residual.mean()
    auto = correlation(centred, centred, 0, longest)
    band = BAND_95 / np.sqrt(count)
    early = min(round(_EARLIEST_LAG / period), longest)
    cross, cross_band = _cross(stimulation_at(stamp_ns, pulses), centred, auto, early, longest)
    return ResidualAnalysis(
        samples=count,
        sample_period_s=period,
        root_mean_square=float(np.sqrt(np.mean(residual**2))),
        mean=float(residual.mean()),
        lag_s=period * np.arange(longest + 1.0),
        autocorrelation=auto,
        autocorrelation_band=float(band),
        autocorrelation_outside=_share(np.abs(auto[1:]) > band),
        cross_lag_s=period * np.arange(-early, longest + 1.0) if len(cross) else np.empty(0),
        cross_correlation=cross,
        cross_correlation_band=cross_band,
        cross_correlation_outside=_share(np.abs(cross[early:]) > cross_band),
    )


def correlation(first: FloatArray, second: FloatArray, before: int, after: int) -> FloatArray:
    """Return sum_i first_i second_(i+k) / (|first| |second|) for k = -before..after.

    Parameters
    ----------
    first, second : ndarray (samples,)
        Of zero mean, neither of them zero everywhere.
    before, after : int
        Lags on either side, fewer than samples.

    Returns
    -------
    ndarray (before + after + 1,)
    """
    product = correlate(second, first, method='fft')[len(first) - 1 - before :]
    return product[: before + after + 1] / (np.linalg.norm(first) * np.linalg.norm(second))


def stimulation_at(stamp_ns: IntArray, pulses: PulseTrain) -> FloatArray:
    """Return the intensity of the pulses since the sample before (samples,) [1].

    A pulse counts for the first sample at or after its onset; those outside the span do not.
    """
    index = np.searchsorted(stamp_ns, pulses.onset_ns, side='left')
    inside = (index < len(stamp_ns)) & (pulses.onset_ns >= stamp_ns[0])
    inside &= np.isfinite(pulses.intensity)
    return np.bincount(index[inside], pulses.intensity[inside], len(stamp_ns)).astype(np.float64)


def _share(chosen: BoolArray) -> float:
    return float(np.mean(chosen)) if len(chosen) else 0.0


def _cross(
    stimulation: FloatArray, centred: FloatArray, auto: FloatArray, early: int, longest: int
) -> tuple[FloatArray, float]:
    """Return c(k), k = -early..longest, and its band."""
    if np.ptp(stimulation) == 0.0:
        return np.empty(0), 0.0
    stimulation = stimulation - stimulation.mean()
    cross = correlation(stimulation, centred, early, longest)
    own = correlation(stimulation, stimulation, 0, longest)
    # Both autocorrelations are even; they are taken as zero beyond the longest lag.
    variance = (1.0 + 2.0 * float(auto[1:] @ own[1:])) / len(centred)
    # An estimate of a variance may come out below that of white noise over few samples.
    return cross, float(BAND_95 * np.sqrt(max(variance, 1.0 / len(centred))))
