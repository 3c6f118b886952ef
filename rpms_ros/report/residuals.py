# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Residual of the model: whether it is white, and whether it is correlated with the pulses.

A residual (measured minus predicted) that is correlated with itself contains dynamics or drift
that the model lacks; one correlated with the pulses contains a response that the model lacks.

The sample autocorrelation at lag k is r(k) = sum_i e_i e_(i+k) / sum_i e_i^2, its cumulated test
Q = N (N + 2) sum_(k=1..K) r(k)^2 / (N - k) (Ljung and Box, Biometrika 65, 1978), which is
chi-square with K degrees of freedom if the residual is white.  The cross-correlation c(k) of the
input with the residual k samples later has, if the two are independent, the variance
sum_l r_ee(l) r_uu(l) / N (Bartlett's formula; Box and Jenkins, Time Series Analysis, Ch. 11):
a band made for white residuals would call every periodic input correlated.

Beside it stands the fit of the end of the recording, from which the estimator did not learn.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate
from scipy.special import chdtrc

from rpms_ros.errors import ReportError
from rpms_ros.identification import Estimator, IdentifiedSession
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, PulseTrain
from rpms_ros.schema import internal

# Two-sided quantile of the normal distribution at 95 %.
BAND_95 = 1.959963984540054
LONGEST_LAG = 0.4
"""How far the correlations are shown [s]: longer than a pulse acts."""
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
    ljung_box, ljung_box_lags, ljung_box_p : float, int, float
        Test of whiteness: statistic, lags, probability of a larger one if white.
    cross_lag_s : ndarray (cross lags,)
        Time from a pulse to the residual [s]; negative lags are before the pulse.
    cross_correlation : ndarray (cross lags,)
        c(k); empty if the span holds no pulse or pulses of one intensity at every sample.
    cross_correlation_band : float
        95 % band if residual and input are independent.
    cross_correlation_outside : float
        Share of the lags from 0 on that lie outside it.
    share_of_session : float
        Share of the time of the session that the span is.
    """

    samples: int
    sample_period_s: float
    root_mean_square: float
    mean: float
    lag_s: FloatArray
    autocorrelation: FloatArray
    autocorrelation_band: float
    autocorrelation_outside: float
    ljung_box: float
    ljung_box_lags: int
    ljung_box_p: float
    cross_lag_s: FloatArray
    cross_correlation: FloatArray
    cross_correlation_band: float
    cross_correlation_outside: float
    share_of_session: float = 1.0


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
    count = len(residual)
    if count < _FEWEST_SAMPLES:
        raise ReportError(f'expected at least {_FEWEST_SAMPLES} residuals, got {count}')
    if np.any(np.diff(stamp_ns) <= 0):
        raise ReportError('expected residuals with ascending stamps, got a clock that jumped')
    # the variance of differences below 1e-154 N is zero, too
    if residual.var() == 0.0:
        raise ReportError(f'expected residuals that differ, got {residual[0]} only')
    period = float(np.median(np.diff(stamp_ns))) / NANOSECONDS_PER_SECOND
    longest = min(round(LONGEST_LAG / period), count // 4)
    centred = residual - residual.mean()
    auto = correlation(centred, centred, 0, longest)
    band = BAND_95 / np.sqrt(count)
    statistic, p_value = ljung_box(auto[1:], count)
    early = min(round(_EARLIEST_LAG / period), longest)
    stimulation = stimulation_at(stamp_ns, pulses)
    cross, cross_band = _cross(stimulation, centred, auto, early, longest)
    return ResidualAnalysis(
        samples=count,
        sample_period_s=period,
        root_mean_square=float(np.sqrt(np.mean(residual**2))),
        mean=float(residual.mean()),
        lag_s=period * np.arange(longest + 1.0),
        autocorrelation=auto,
        autocorrelation_band=float(band),
        autocorrelation_outside=_share(np.abs(auto[1:]) > band),
        ljung_box=statistic,
        ljung_box_lags=longest,
        ljung_box_p=p_value,
        cross_lag_s=period * np.arange(-early, longest + 1.0) if len(cross) else np.empty(0),
        cross_correlation=cross,
        cross_correlation_band=cross_band,
        cross_correlation_outside=_share(np.abs(cross[early:]) > cross_band),
    )


def ljung_box(autocorrelation: FloatArray, count: int) -> tuple[float, float]:
    """Return Ljung and Box's Q and the probability of a larger one if white.

    Parameters
    ----------
    autocorrelation : ndarray (lags,)
        r(1), r(2), ...
    count : int
        Samples that they come from.
    """
    lags = np.arange(1, len(autocorrelation) + 1)
    statistic = float(count * (count + 2) * np.sum(autocorrelation**2 / (count - lags)))
    return statistic, float(chdtrc(len(lags), statistic))


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
    scale = float(np.linalg.norm(first) * np.linalg.norm(second))
    chosen: FloatArray = product[: before + after + 1] / scale
    return chosen


def stimulation_at(stamp_ns: IntArray, pulses: PulseTrain) -> FloatArray:
    """Return the intensity of the pulses since the sample before (samples,) [1].

    A pulse counts for the first sample at or after its onset; those outside the span do not.
    """
    index = np.searchsorted(stamp_ns, pulses.onset_ns, side='left')
    inside = (index < len(stamp_ns)) & (pulses.onset_ns >= stamp_ns[0])
    inside &= np.isfinite(pulses.intensity)
    return np.bincount(
        index[inside], weights=pulses.intensity[inside], minlength=len(stamp_ns)
    ).astype(np.float64)


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


HELD_OUT_SHARE = 0.2


class FrozenFrom:
    """An estimator that learns nothing from samples at or after a stamp, but predicts them.

    It offers no `predict`: no sample is left out as an outlier.

    Parameters
    ----------
    estimator : Estimator
        Fresh estimator.
    stamp_ns : int
        First stamp that is held out [ns].
    """

    def __init__(self, estimator: Estimator, stamp_ns: int) -> None:
        self._estimator = estimator
        self._stamp_ns = stamp_ns
        self.name, self.on_line = estimator.name, estimator.on_line
        self.add_pulses, self.forget_pulses = estimator.add_pulses, estimator.forget_pulses
        self.estimate = estimator.estimate

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self._estimator.memory

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from the samples (samples,) before the held-out part; predict all [N]."""
        return self._estimator.update(stamp_ns, force, usable & (stamp_ns < self._stamp_ns))


@dataclass(frozen=True)
class HeldOutFit:
    """How well the end of a session is predicted from its beginning.

    Attributes
    ----------
    learnt_s, held_out_s : float
        Lengths of the two parts [s].
    samples : int
        Samples of the held-out part, without those that lost pulses affect.
    error_n, error_of_range : float
        Root mean square of the residual [N], and as a share of the range of the whole session's
        force.
    stamp_ns, force, prediction : ndarray (samples,)
        The held-out part [ns], [N], [N].
    """

    learnt_s: float
    held_out_s: float
    samples: int
    error_n: float
    error_of_range: float
    stamp_ns: IntArray = internal()
    force: FloatArray = internal()
    prediction: FloatArray = internal()


def boundary(stamp_ns: IntArray, share: float) -> int:
    """Return the first held-out stamp [ns] if the last `share` of the time is held out.

    Raises
    ------
    ReportError
        If the share does not lie between 0 and 1.
    """
    if not 0.0 < share < 1.0:
        raise ReportError(f'expected to hold out a share between 0 and 1, got {share}')
    first, last = int(stamp_ns.min()), int(stamp_ns.max())
    return last - round(share * (last - first))


def held_out_fit(session: IdentifiedSession, first_ns: int) -> HeldOutFit | None:
    """Return the fit from `first_ns` on of a session run with `FrozenFrom`.

    None if nothing is left there or before it, or the force does not change.
    """
    kept = (session.stamp_ns >= first_ns) & session.usable
    force, prediction = session.force[kept], session.prediction[kept]
    # the variance of a change below 1e-154 N is zero, too
    if len(force) < 2 or force.var() == 0.0 or session.stamp_ns.min() >= first_ns:
        return None
    residual = force - prediction
    error = float(np.sqrt(np.mean(residual**2)))
    return HeldOutFit(
        learnt_s=float(first_ns - session.stamp_ns[0]) * 1e-9,
        held_out_s=float(session.stamp_ns[-1] - first_ns) * 1e-9,
        samples=len(force),
        error_n=error,
        error_of_range=error / float(np.ptp(session.force[session.usable])),
        stamp_ns=session.stamp_ns[kept],
        force=force,
        prediction=prediction,
    )
