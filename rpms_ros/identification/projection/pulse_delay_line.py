# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses between their onset and the onset of their twitch."""

import numpy as np

from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.identification.temporal_summation import PulseHistory
from rpms_ros.identification.temporal_summation import TemporalSummation
from rpms_ros.muscle.recruitment import RateRecruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import nanoseconds

# A motor axon is absolutely refractory for about a millisecond: no interval counts as shorter.
_REFRACTORY_NS = 1_000_000


class PulseDelayLine(Restorable):
    """Pulses whose twitch has not begun, with their weights.

    Parameters
    ----------
    latency : float
        From the pulse to the onset of its twitch [s].
    by_rate : RateRecruitment or None
        Weight by the interval to the pulse before; None weights all alike.
    rate_hz : float
        Rate at which the weight is 1 [Hz].
    history : TemporalSummation or None
        Weight by all pulses before, instead of by the interval.
    """

    _last_ns: int | None
    begin_ns: IntArray
    intensity: FloatArray
    weight: FloatArray
    _history: PulseHistory | None

    def __init__(
        self,
        latency: float,
        by_rate: RateRecruitment | None,
        rate_hz: float,
        history: TemporalSummation | None = None,
    ) -> None:
        self._latency_ns = nanoseconds(latency)
        self._by_rate = by_rate
        self._unit = float(by_rate.per_pulse(rate_hz)) if by_rate is not None else 1.0
        self._history = PulseHistory(history, rate_hz) if history is not None else None
        self._last_ns = None
        self.begin_ns = np.empty(0, dtype=np.int64)
        self.intensity = np.empty(0)
        self.weight = np.empty(0)

    def add(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if not len(onset_ns):
            return
        self.begin_ns = np.concatenate((self.begin_ns, onset_ns + self._latency_ns))
        self.intensity = np.concatenate((self.intensity, intensity))
        self.weight = np.concatenate((self.weight, self._weights(onset_ns, intensity)))
        self._last_ns = int(onset_ns[-1])

    def latency(self, latency: float) -> None:
        """Set the latency of pulses that are added from now on [s]."""
        self._latency_ns = nanoseconds(latency)

    def restart(
        self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray, latency: float
    ) -> None:
        """Replace all pulses by these (pulses,), with another latency [s]."""
        self.latency(latency)
        self.begin_ns = onset_ns + self._latency_ns
        self.intensity = intensity.copy()
        self.weight = weight.copy()

    def drop(self, count: int) -> None:
        """Drop the first pulses, whose twitch has begun."""
        if count:
            self.begin_ns = self.begin_ns[count:]
            self.intensity = self.intensity[count:]
            self.weight = self.weight[count:]

    def begin_until(self, stamp_ns: int) -> int:
        """Return how many twitches begin before a stamp [ns]."""
        return int(np.searchsorted(self.begin_ns, stamp_ns))

    def forget(self) -> None:
        """Drop all pulses; the next one counts as the first."""
        self.begin_ns = np.empty(0, dtype=np.int64)
        self.intensity = np.empty(0)
        self.weight = np.empty(0)
        self._last_ns = None
        if self._history is not None:
            self._history.forget()

    def _check_restored(self) -> None:
        lengths = {self.begin_ns.shape, self.intensity.shape, self.weight.shape}
        expect(len(lengths) == 1 and self.begin_ns.ndim == 1, 'PulseDelayLine', 'as many onsets')

    def _weights(self, onset_ns: IntArray, intensity: FloatArray) -> FloatArray:
        if self._history is not None:
            return self._history.weights(onset_ns, intensity)
        if self._by_rate is None:
            return np.ones(len(onset_ns))
        rate = np.zeros(len(onset_ns))
        interval = np.diff(onset_ns)
        rate[1:] = NANOSECONDS_PER_SECOND / np.maximum(interval, _REFRACTORY_NS)
        if self._last_ns is not None:
            since = max(int(onset_ns[0]) - self._last_ns, _REFRACTORY_NS)
            rate[0] = NANOSECONDS_PER_SECOND / since
        return self._by_rate.per_pulse(rate) / self._unit
