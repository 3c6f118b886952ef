# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The complete contraction, Eq. (11), as a stream of pulses in and force out.

An n-th order twitch with equal poles is a polynomial times one exponential, so the sum over any
number of past pulses is too.  With lags ``s`` in units of T_a it follows exactly from n moments

.. math:: M_j = \sum_q w_q s_q^j e^{-s_q}, \qquad j = 0 .. n-1

which advance by a time ``d`` by the binomial theorem,
``M_j' = e^{-d} sum_i C(j, i) d^(j-i) M_i``, and give the force as ``c M_(n-1)`` with
``c = (e / (n-1))^(n-1)``.  Every term is positive: nothing cancels, however long the history.

Recent pulses are kept separately, so that one which arrives late, or between two others, still
gets its exact onset and repetition rate; older ones are added to the moments.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.muscle.subject import Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, nanoseconds

# A motor axon is absolutely refractory for about a millisecond: shorter intervals count as this.
REFRACTORY_PERIOD = 1e-3


class MuscleState(NamedTuple):
    """True state of a muscle at one time.

    Attributes
    ----------
    gain : float
        Steady force relative to the rested, unchanged subject, by scripted changes, fatigue and
        potentiation together.
    time_constant : float
        T_a [s].
    latency : float
        From the pulse to the onset of its twitch [s].
    threshold, saturation : float
        u_thr and u_sat, share of the maximum intensity.
    fatigue : float
        Steady force relative to the rested muscle, by fatigue alone.
    potentiation : float
        Growth of the twitch, as a share of the rested one.
    """

    gain: float
    time_constant: float
    latency: float
    threshold: float
    saturation: float
    fatigue: float
    potentiation: float


@numba.njit(cache=True)
def move_moments(moments: FloatArray, distance: float) -> None:
    """Advance the moments (n,) by `distance` (in units of T_a), in place."""
    decay = math.exp(-distance)
    for j in range(len(moments) - 1, -1, -1):
        total = 0.0
        factor = 1.0
        for i in range(j, -1, -1):
            total += factor * moments[i]
            # C(j, i-1) d^(j-i+1) out of C(j, i) d^(j-i)
            factor *= distance * i / (j - i + 1)
        moments[j] = decay * total


@numba.njit(cache=True)
def _fold(
    reference_ns: int,
    moments: FloatArray,
    onset_ns: IntArray,
    weight: FloatArray,
    time_constant_ns: float,
) -> int:
    """Add pulses, ascending in onset, to the moments; return the new reference time."""
    for index in range(len(onset_ns)):
        if onset_ns[index] > reference_ns:
            move_moments(moments, (onset_ns[index] - reference_ns) / time_constant_ns)
            reference_ns = onset_ns[index]
        lag = (reference_ns - onset_ns[index]) / time_constant_ns
        term = weight[index] * math.exp(-lag)
        for j in range(len(moments)):
            moments[j] += term
            term *= lag
    return reference_ns


@numba.njit(cache=True)
def _read(
    stamp_ns: IntArray,
    reference_ns: int,
    moments: FloatArray,
    onset_ns: IntArray,
    weight: FloatArray,
    time_constant_ns: float,
) -> FloatArray:
    """Return M_(n-1) at ascending stamps (samples,); overwrites `moments`."""
    result = np.empty(len(stamp_ns))
    at_sample = np.empty_like(moments)
    begun = 0
    for index in range(len(stamp_ns)):
        first = begun
        while begun < len(onset_ns) and onset_ns[begun] <= stamp_ns[index]:
            begun += 1
        if begun > first:
            reference_ns = _fold(
                reference_ns, moments, onset_ns[first:begun], weight[first:begun], time_constant_ns
            )
        at_sample[:] = moments
        move_moments(at_sample, (stamp_ns[index] - reference_ns) / time_constant_ns)
        result[index] = at_sample[-1]
    return result


def twitch_peak_factor(order: int) -> float:
    """Return c = (e / (n-1))^(n-1), 1 for n = 1: the force is c times M_(n-1)."""
    power = order - 1
    return 1.0 if power == 0 else (math.e / power) ** power


def check_rate(rate_hz: float | None) -> None:
    """Raise `MuscleError` if a fixed repetition rate is not above 0 Hz."""
    if rate_hz is not None:
        check_number(MuscleError, 'repetition rate', rate_hz, 0, above=True, unit='Hz')


def repetition_rates(onset_ns: IntArray) -> FloatArray:
    """Return the rate [Hz] of each of ascending pulses (pulses,), 0 of the first."""
    rate = np.zeros(len(onset_ns))
    interval = np.diff(onset_ns) / NANOSECONDS_PER_SECOND
    rate[1:] = 1.0 / np.maximum(interval, REFRACTORY_PERIOD)
    return rate


def checked_pulses(
    onset_ns: npt.ArrayLike, intensity: npt.ArrayLike
) -> tuple[IntArray, FloatArray]:
    """Return onsets (pulses,) [ns] and intensities (pulses,) as arrays.

    Raises
    ------
    MuscleError
        If their lengths differ, or an intensity is not between 0 and 1.
    """
    onsets = np.atleast_1d(np.asarray(onset_ns, dtype=np.int64))
    values = np.atleast_1d(np.asarray(intensity, dtype=np.float64))
    if onsets.shape != values.shape:
        raise MuscleError(
            f'expected as many intensities as onsets, got {values.size} and {onsets.size}'
        )
    valid = (values >= 0.0) & (values <= 1.0)
    if not valid.all():
        raise MuscleError(f'expected intensities from 0 to 1, got {values[~valid][0]}')
    return onsets, values


class Contraction:
    """Isometric force of a stimulated muscle, Eq. (11).

    Pulses may be added in any order; force may be read at any time that is not more than `window`
    before the latest time read.  A pulse that is added later than that acts from its own onset
    on, but has the weight of a pulse without a predecessor.  The cost of a sample does not depend
    on how many pulses there have been.

    Parameters
    ----------
    subject : Subject
        The muscle.
    fixed_rate_hz : float or None
        Repetition rate from which every pulse gets its weight [Hz]; None takes each pulse's own,
        from the interval to the pulse before it (0 Hz for the first).
    window : float
        How long pulses are kept separately [s].

    Raises
    ------
    MuscleError
        If the rate or the window is not above zero.
    """

    def __init__(
        self, subject: Subject, fixed_rate_hz: float | None = None, window: float = 2.0
    ) -> None:
        check_rate(fixed_rate_hz)
        check_number(MuscleError, 'window', window, 0, above=True, unit='s')
        self.subject = subject
        self._fixed_rate = fixed_rate_hz
        self._window_ns = nanoseconds(window)
        self._latency_ns = nanoseconds(subject.latency)
        self._time_constant_ns = subject.time_constant * NANOSECONDS_PER_SECOND
        self._peak = twitch_peak_factor(subject.order)
        self._moments = np.zeros(subject.order)
        self._reference_ns: int | None = None
        self._last_folded_ns: int | None = None
        self._onset_ns = np.empty(0, dtype=np.int64)
        self._intensity = np.empty(0)

    def begin(self, start_ns: int) -> None:
        """Do nothing: a steady muscle does not depend on the time."""

    def state(self, stamp_ns: int) -> MuscleState:
        """Return the state, the same at any time."""
        del stamp_ns
        curve = self.subject.recruitment
        return MuscleState(
            gain=1.0,
            time_constant=self.subject.time_constant,
            latency=self.subject.latency,
            threshold=curve.threshold,
            saturation=curve.saturation,
            fatigue=1.0,
            potentiation=0.0,
        )

    def steady_force(self, stamp_ns: int, intensity: FloatArray, rate_hz: float) -> FloatArray:
        """Return the recruitment curve: steady mean force [N] (intensities,)."""
        del stamp_ns
        return self.subject.steady_force(intensity, rate_hz)

    def add_pulses(self, onset_ns: npt.ArrayLike, intensity: npt.ArrayLike) -> None:
        """Add pulses.

        Parameters
        ----------
        onset_ns : array_like of int, shape (pulses,) or ()
            Onsets of the pulses [ns], in any order.
        intensity : array_like, shape (pulses,) or ()
            Shares of the maximum, 0..1.

        Raises
        ------
        MuscleError
            If an intensity is not between 0 and 1; nothing is added then.
        """
        onsets, values = checked_pulses(onset_ns, intensity)
        begun = np.zeros(len(onsets), dtype=np.bool_)
        if self._reference_ns is not None:
            begun = onsets + self._latency_ns <= self._reference_ns
        if begun.any():
            # late ones each have the weight of a single pulse
            weight = self.subject.pulse_weight(values[begun], self._fixed_rate or 0.0)
            self._fold(onsets[begun] + self._latency_ns, weight)
        merged = np.concatenate((self._onset_ns, onsets[~begun]))
        order = np.argsort(merged, kind='stable')
        self._onset_ns = merged[order]
        self._intensity = np.concatenate((self._intensity, values[~begun]))[order]

    def force(self, stamp_ns: npt.ArrayLike) -> FloatArray:
        """Return the force at the given times.

        Parameters
        ----------
        stamp_ns : array_like of int, shape (samples,) or ()
            Times [ns], in any order.

        Returns
        -------
        ndarray, shape (samples,)
            Force of the pulses added so far [N].

        Raises
        ------
        MuscleError
            If a time is before pulses that are no longer kept separately.
        """
        stamps = np.atleast_1d(np.asarray(stamp_ns, dtype=np.int64))
        if not len(stamps):
            return np.empty(0)
        order = np.argsort(stamps, kind='stable')
        ascending = stamps[order]
        effective = self._onset_ns + self._latency_ns
        reference = self._reference_ns
        if reference is None:
            # The moments hold no pulse yet: they are zero at any time.
            reference = int(np.concatenate((ascending[:1], effective[:1])).min())
        if ascending[0] < reference:
            raise MuscleError(f'expected times from {reference} ns on, got {ascending[0]} ns')
        top = _read(
            ascending,
            reference,
            self._moments.copy(),
            effective,
            self._weights(),
            self._time_constant_ns,
        )
        result = np.empty(len(stamps))
        result[order] = self._peak * top
        self._fold_before(int(ascending[-1]) - self._window_ns)
        return result

    def _weights(self) -> FloatArray:
        """Return the peak force of each separate pulse's twitch (pulses,) [N]."""
        if self._fixed_rate is not None:
            return self.subject.pulse_weight(self._intensity, self._fixed_rate)
        before = [] if self._last_folded_ns is None else [self._last_folded_ns]
        rate = repetition_rates(np.append(np.array(before, dtype=np.int64), self._onset_ns))
        return self.subject.pulse_weight(self._intensity, rate[len(before) :])

    def _fold_before(self, limit_ns: int) -> None:
        """Add the pulses whose twitch began before `limit_ns` to the moments."""
        effective = self._onset_ns + self._latency_ns
        count = int(np.searchsorted(effective, limit_ns))
        if not count:
            return
        self._fold(effective[:count], self._weights()[:count])
        self._last_folded_ns = int(self._onset_ns[count - 1])
        self._onset_ns = self._onset_ns[count:]
        self._intensity = self._intensity[count:]

    def _fold(self, effective_ns: IntArray, weight: FloatArray) -> None:
        reference = int(effective_ns[0]) if self._reference_ns is None else self._reference_ns
        self._reference_ns = int(
            _fold(reference, self._moments, effective_ns, weight, self._time_constant_ns)
        )
