# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tremor: found in the prediction errors, and subtracted from the samples.

A tremor is a narrow line between 3 and 13 Hz, where the piecewise linear disturbance is too slow
and a twitch has much of its power.  So it is modelled separately: force and errors of the last
seconds are kept in bins, the spectrum of the smaller one is searched for a line far above its
surroundings, and a sinusoid with amplitude and phase of the newest bins is subtracted before the
estimator learns from a sample.  Harmonics of the repetition rate are excluded: they are lines of
the muscle itself.
"""

import numpy as np

from rpms_ros.identification.estimation.blocks import BlockStatistics, ring_order
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

_BIN_NS = 10_000_000
# Bins that are searched for a line, and to which its amplitude is fitted.
_SEARCHED, _FITTED = 400, 150
SEARCHED_NS = _SEARCHED * _BIN_NS
# After a line was rejected, until it is looked for again.
_PAUSE = 100
_LOWEST, _HIGHEST, _RESOLUTION = 3.0, 13.0, 0.25
# Ratio to the median of the spectrum above which a line appears, and below which it ends.
_APPEARS, _GOES = 25.0, 8.0
# The line's least share of the power between the lowest and the highest frequency.
_LEAST_SHARE, _KEPT_SHARE = 0.7, 0.3
_BESIDE_RATE = 0.6
_LEAST_BINS = 0.8
# Bins of a second and a half resolve two lines of 3 Hz or more beside each other.
_FEWEST_BINS = 150
# Repetition rates are those of so many newest pulses; of more rates than this, none is a line.
_RECENT_PULSES, _MOST_RATES = 100, 3
_SHORTEST_INTERVAL = 1e-3
_FREQUENCIES: FloatArray = np.arange(_LOWEST, _HIGHEST + 0.5 * _RESOLUTION, _RESOLUTION)
# Of the spectrum of the bins that are searched, whose resolution is this one.
_BAND = slice(round(_LOWEST / _RESOLUTION), round(_HIGHEST / _RESOLUTION) + 1)


def repetition_rates(blocks: BlockStatistics) -> FloatArray:
    """Return the rates of the newest pulses (rates,) [Hz], none if they are many."""
    order = ring_order(blocks)
    recent = blocks.start_ns[order][blocks.intensity[order] > 0.0][-_RECENT_PULSES:]
    intervals = 1e-9 * np.diff(recent)
    rates = np.unique(np.round(1.0 / intervals[intervals > _SHORTEST_INTERVAL], 1))
    return rates if len(rates) <= _MOST_RATES else rates[:0]


class Tremor:
    """A sinusoidal force that the stimulation does not cause.

    Attributes
    ----------
    frequency : float
        Frequency [Hz], 0 without a tremor.
    """

    def __init__(self) -> None:
        self._sum = np.zeros((2, _SEARCHED))
        self._count = np.zeros(_SEARCHED)
        self.forget()

    def forget(self) -> None:
        """Forget everything: the clock has jumped."""
        self.frequency = 0.0
        self._cosine = self._sine = 0.0
        self._sum[:] = 0.0
        self._count[:] = 0.0
        self._newest = -(2**62)
        self._rejected = -(2**62)

    @property
    def amplitude(self) -> float:
        """Half of the peak-to-peak force [N]."""
        return float(np.hypot(self._cosine, self._sine))

    def force(self, stamp_ns: IntArray) -> FloatArray:
        """Return the tremor's force at stamps (samples,) [N]."""
        if self.frequency == 0.0:
            return np.zeros(len(stamp_ns))
        wave = waves(self.frequency, seconds(stamp_ns - self._newest * _BIN_NS))
        return self._cosine * wave[:, 0] + self._sine * wave[:, 1]

    def add(
        self, stamp_ns: IntArray, force: FloatArray, muscle: FloatArray, usable: BoolArray
    ) -> None:
        """Add ascending samples (samples,) [N], and the predicted force of the muscle [N]."""
        bins = stamp_ns[usable] // _BIN_NS
        if not len(bins):
            return
        last = int(bins[-1])
        if last > self._newest:
            passed = np.arange(max(self._newest + 1, last - _SEARCHED + 1), last + 1)
            self._turn(last)
            self._sum[:, passed % _SEARCHED] = 0.0
            self._count[passed % _SEARCHED] = 0.0
        kept = bins > last - _SEARCHED
        place = bins[kept] % _SEARCHED
        np.add.at(self._sum[0], place, force[usable][kept])
        np.add.at(self._sum[1], place, (force - muscle)[usable][kept])
        np.add.at(self._count, place, 1.0)

    def follow(self, rates_hz: FloatArray) -> bool:
        """Search for a line, or follow it; return whether it has just appeared.

        Parameters
        ----------
        rates_hz : ndarray (rates,)
            Repetition rates of the newest pulses: their harmonics are the muscle's.
        """
        both, filled = self._means()
        was = self.frequency
        self.frequency = self._cosine = self._sine = 0.0
        if filled.sum() < _LEAST_BINS * _SEARCHED:
            return False
        if not was and self._newest < self._rejected + _PAUSE:
            return False
        # while the muscle is not known its prediction may be worse than none
        power = [_power(one, filled) for one in both]
        quieter = int(power[1].sum() <= power[0].sum())
        self.frequency = _line(power[quieter], rates_hz, was > 0.0)
        if self.frequency:
            self._follow_amplitude(quieter)
        return bool(self.frequency and not was)

    def accept(
        self, hertz: float, stamp_ns: IntArray, force: FloatArray, rest: FloatArray
    ) -> None:
        """Take up a line that was found in what a muscle leaves of the samples.

        Parameters
        ----------
        hertz : float
            Its frequency.
        stamp_ns, force, rest : ndarray (samples,)
            Samples, ascending [ns], [N], and what the muscle leaves of them [N]: its prediction
            at the time was not that good.
        """
        self._sum[:] = 0.0
        self._count[:] = 0.0
        self.add(stamp_ns, force, force - rest, np.ones(len(force), dtype=np.bool_))
        self.frequency = hertz
        self._follow_amplitude(1)

    def reject(self) -> None:
        """Take back a line that has just appeared; another look follows in a second."""
        self.frequency = self._cosine = self._sine = 0.0
        self._rejected = self._newest

    def _turn(self, newest: int) -> None:
        """Change the reference of the phase to another bin."""
        if self.frequency:
            ahead = 2.0 * np.pi * self.frequency * 1e-9 * _BIN_NS * (newest - self._newest)
            cosine, sine = np.cos(ahead), np.sin(ahead)
            self._cosine, self._sine = (
                float(self._cosine * cosine + self._sine * sine),
                float(self._sine * cosine - self._cosine * sine),
            )
        self._newest = newest

    def _means(self) -> tuple[FloatArray, BoolArray]:
        """Return force and errors in bins (2, bins), ascending, and which of them hold samples."""
        order = np.arange(self._newest - _SEARCHED + 1, self._newest + 1) % _SEARCHED
        count = self._count[order]
        filled = count > 0.0
        return np.where(filled, self._sum[:, order] / np.maximum(count, 1.0), 0.0), filled

    def _follow_amplitude(self, which: int) -> None:
        """Fit amplitude and phase to the newest forces (0) or errors (1)."""
        both, filled = self._means()
        error, filled = both[which, -_FITTED:], filled[-_FITTED:]
        time = seconds(_BIN_NS * np.arange(1 - len(error), 1) + _BIN_NS // 2)
        # the mean over a bin has a smaller amplitude
        shrunk = np.sinc(1e-9 * _BIN_NS * self.frequency)
        columns = np.hstack((shrunk * waves(self.frequency, time), polynomials(time, 4)))
        found = np.linalg.lstsq(columns[filled], error[filled], rcond=None)[0]
        self._cosine, self._sine = float(found[0]), float(found[1])


def line_in(stamp_ns: IntArray, rest: FloatArray, rates_hz: FloatArray) -> float:
    """Return the frequency of a tremor in what a muscle leaves of samples [Hz], 0 for none.

    Parameters
    ----------
    stamp_ns, rest : ndarray (samples,)
        Ascending [ns], [N]; the newest four seconds count.
    rates_hz : ndarray (rates,)
        Repetition rates of the newest pulses.
    """
    if not len(stamp_ns):
        return 0.0
    bins = stamp_ns // _BIN_NS
    place = bins - (bins[-1] - _SEARCHED + 1)
    kept = place >= 0
    count = np.bincount(place[kept], minlength=_SEARCHED).astype(np.float64)
    total = np.bincount(place[kept], rest[kept], minlength=_SEARCHED)
    filled = count > 0.0
    if filled.sum() < _FEWEST_BINS:
        return 0.0
    return _line(_power(total / np.maximum(count, 1.0), filled), rates_hz, False)


def _power(error: FloatArray, filled: BoolArray) -> FloatArray:
    """Return the spectrum (frequencies,) of errors (bins,) [N^2], less a slow trend."""
    time = seconds(_BIN_NS * np.arange(len(error)))
    weight = np.hanning(len(error)) * filled
    trend = polynomials(time, 4) * weight[:, None]
    known = trend @ np.linalg.lstsq(trend, error * weight, rcond=None)[0]
    return np.abs(np.fft.rfft(error * weight - known)[_BAND]) ** 2


def _line(power: FloatArray, rates_hz: FloatArray, known: bool) -> float:
    """Return the frequency of a line in a spectrum (frequencies,) [Hz], 0 if there is none."""
    harmonics = np.outer(rates_hz, np.arange(1.0, 6.0)).ravel()
    distance = np.abs(_FREQUENCIES[:, None] - harmonics[None, :])
    allowed = np.all(distance > _BESIDE_RATE, axis=1)
    peak = int(np.argmax(np.where(allowed, power, 0.0)))
    if not allowed[peak] or not 0 < peak < len(power) - 1:
        return 0.0
    least, share = (_GOES, _KEPT_SHARE) if known else (_APPEARS, _LEAST_SHARE)
    line = float(power[max(peak - 2, 0) : peak + 3].sum())
    if power[peak] <= least * float(np.median(power)) or line <= share * float(power.sum()):
        return 0.0
    left, top, right = np.log(power[peak - 1 : peak + 2] + 1e-300)
    bend = left - 2.0 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(_FREQUENCIES[peak] + _RESOLUTION * np.clip(shift, -0.5, 0.5))


def waves(hertz: float, time: FloatArray) -> FloatArray:
    """Return cosine and sine (samples, 2) of a frequency [Hz] at times (samples,) [s]."""
    phase = 2.0 * np.pi * hertz * time
    return np.column_stack((np.cos(phase), np.sin(phase)))


def polynomials(time: FloatArray, count: int) -> FloatArray:
    """Return powers (samples, count) of times (samples,) [s], from 0 on, scaled to within 1."""
    middle = 0.5 * (time[0] + time[-1])
    half = max(0.5 * float(time[-1] - time[0]), 1e-9)
    return np.vander((time - middle) / half, count, increasing=True)


def seconds(duration_ns: IntArray) -> FloatArray:
    """Return times (times,) [ns] in seconds."""
    return 1e-9 * duration_ns.astype(np.float64)
