# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The complete contraction, Eq. (11), of a muscle that may change: pulses in and force out.

An n-th order twitch with equal poles is a polynomial times one exponential, so the sum over any
number of past pulses is too.  With lags ``s`` in units of T_a it follows exactly from n moments

.. math:: M_j = \sum_q w_q s_q^j e^{-s_q}, \qquad j = 0 .. n-1

which advance by a time ``d`` by the binomial theorem,
``M_j' = e^{-d} sum_i C(j, i) d^(j-i) M_i``, and give the force as ``c M_(n-1)`` with
``c = (e / (n-1))^(n-1)``.  Every term is positive: nothing cancels, however long the history.

A chain whose time constant T_a(t) changes is the fixed chain in the time
``theta(t) = int dt / T_a(t)``, so its moments stay exact.  Everything that changes is held
constant within cells of 10 ms, which begin at multiples of 10 ms of the time stamp: the result
does not depend on how samples are cut into blocks.  Per cell:

- scripted values (`Timeline`) are those at its beginning;
- fatigue and potentiation are updated at its end, with the force there.

A pulse has the recruitment of its onset, and the gain of the time at which its twitch begins.
``gain`` and fatigue scale the *steady force*: the peak of a slower twitch is smaller in
proportion.  A pulse that is added after samples on which it should have acted acts from its own
onset on, but with the present T_a, and with its own rate if it is at most 2 s late.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.muscle.recruitment import REFRACTORY_NS
from rpms_ros.muscle.subject import Subject
from rpms_ros.muscle.time_varying import CHANGEABLE, LivingSettings, Timeline
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray


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


CELL_NS = 10_000_000
_CELL_S = CELL_NS / NANOSECONDS_PER_SECOND
# Pulses whose twitch has begun are before late ones for so long [ns].
_REMEMBERED_NS = 2 * NANOSECONDS_PER_SECOND
# What was before the first sample by more than this does not tire the muscle [ns].
_LONGEST_PAST_NS = 3600 * NANOSECONDS_PER_SECOND


class _Rates(NamedTuple):
    """Coefficients of one cell for `_advance`."""

    keep_fatigue: float
    loss: float
    slowing: float
    lowest_gain: float
    keep_potentiation: float
    per_pulse: float
    largest: float
    time_constant_ns: float


@numba.njit(cache=True)
def _move(moments: FloatArray, distance: float) -> None:
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
def _advance(
    stamp_ns: IntArray,
    pulses: tuple[IntArray, FloatArray, FloatArray],
    first_cell: int,
    scripted: FloatArray,
    rates: _Rates,
    moments: FloatArray,
    state: FloatArray,
    reference_ns: int,
) -> tuple[FloatArray, int, int]:
    """Advance the muscle to the last stamp; return force, pulses used and reference time.

    `scripted` (cells, 2) holds T_a / T_a(rest) and gain of each cell; `state` (3,) fatigue gain,
    slowing and potentiation; `pulses` (pulses,) when each twitch begins [ns], its peak [N] at rest
    and its recruitment; `moments` (n,) are in newtons, of lags in the time theta.
    """
    effective_ns, weight, share = pulses
    scale = rates.time_constant_ns
    force = np.empty(len(stamp_ns))
    at_sample = np.empty_like(moments)
    pulse = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while True:
            cell = reference_ns // CELL_NS
            boundary = (cell + 1) * CELL_NS
            slow = scripted[cell - first_cell, 0] * state[1]
            until = min(stamp, boundary)
            if pulse < len(effective_ns) and effective_ns[pulse] <= until:
                onset = effective_ns[pulse]
                if onset > reference_ns:
                    _move(moments, (onset - reference_ns) / (scale * slow))
                    reference_ns = onset
                    continue
                lag = (reference_ns - onset) / (scale * slow)
                gain = scripted[cell - first_cell, 1] * state[0] * (1.0 + state[2])
                term = weight[pulse] * gain / slow * np.exp(-lag)
                for j in range(len(moments)):
                    moments[j] += term
                    term *= lag
                state[2] += rates.per_pulse * share[pulse] * max(rates.largest - state[2], 0.0)
                pulse += 1
                continue
            if stamp < boundary:
                break
            _move(moments, (boundary - reference_ns) / (scale * slow))
            reference_ns = boundary
            use = moments[-1]
            faded = 1.0 + (state[0] - 1.0) * rates.keep_fatigue - rates.loss * use
            state[0] = max(faded, rates.lowest_gain)
            state[1] = 1.0 + (state[1] - 1.0) * rates.keep_fatigue + rates.slowing * use
            state[2] *= rates.keep_potentiation
        at_sample[:] = moments
        _move(at_sample, (stamp - reference_ns) / (scale * slow))
        force[index] = at_sample[-1]
    return force, pulse, reference_ns


def repetition_rates(onset_ns: IntArray) -> FloatArray:
    """Return the rate [Hz] of each of ascending pulses (pulses,), 0 of the first."""
    rate = np.zeros(len(onset_ns))
    rate[1:] = 1.0 / (np.maximum(np.diff(onset_ns), REFRACTORY_NS) / NANOSECONDS_PER_SECOND)
    return rate


class Contraction:
    """Isometric force of a stimulated muscle, Eq. (11); read forwards in time only.

    Pulses may be added in any order.  The cost of a sample does not depend on how many pulses
    there have been.

    Parameters
    ----------
    subject : Subject
        The muscle at rest.
    fixed_rate_hz : float or None
        Repetition rate from which every pulse gets its weight [Hz]; None takes each pulse's own,
        from the interval to the pulse before it (0 Hz for the first).
    settings : LivingSettings or None
        What changes in it; nothing if not given.

    Raises
    ------
    MuscleError
        If the rate is not above zero.
    """

    def __init__(
        self,
        subject: Subject,
        fixed_rate_hz: float | None = None,
        settings: LivingSettings | None = None,
    ) -> None:
        if fixed_rate_hz is not None:
            check_number(MuscleError, 'repetition rate', fixed_rate_hz, 0, above=True, unit='Hz')
        settings = settings or LivingSettings()
        self.subject = subject
        self._start_ns = 0
        self._fixed_rate = fixed_rate_hz
        curve, power = subject.recruitment, subject.order - 1
        rested = {
            'gain': 1.0,
            'time_constant': subject.time_constant,
            'latency': subject.latency,
            'threshold': curve.threshold,
            'saturation': curve.saturation,
        }
        self._timeline = Timeline(rested, settings.changes)
        self._peak = (math.e / power) ** power if power else 1.0
        self._moments = np.zeros(subject.order)
        self._state = np.array([1.0, 1.0, 0.0])
        self._rates = self._rates_of(settings)
        self._reference_ns: int | None = None
        self._begun_ns = np.empty(0, dtype=np.int64)
        self._onset_ns, self._intensity = np.empty(0, dtype=np.int64), np.empty(0)

    def begin(self, start_ns: int) -> None:
        """Count the times of scripted changes from `start_ns` [ns]."""
        self._start_ns = start_ns

    def add_pulses(self, onset_ns: npt.ArrayLike, intensity: npt.ArrayLike) -> None:
        """Add pulses (pulses,) at onsets [ns] with intensities (share 0..1), in any order.

        Raises
        ------
        MuscleError
            If their numbers differ, or an intensity is not from 0 to 1; nothing is added then.
        """
        onsets = np.atleast_1d(np.asarray(onset_ns, dtype=np.int64))
        values = np.atleast_1d(np.asarray(intensity, dtype=np.float64))
        if onsets.shape != values.shape:
            fault = f'expected as many intensities as onsets, got {values.size} and {onsets.size}'
            raise MuscleError(fault)
        valid = (values >= 0.0) & (values <= 1.0)
        if not valid.all():
            raise MuscleError(f'expected intensities from 0 to 1, got {values[~valid][0]}')
        merged = np.concatenate((self._onset_ns, onsets))
        order = np.argsort(merged, kind='stable')
        self._onset_ns = merged[order]
        self._intensity = np.concatenate((self._intensity, values))[order]

    def force(self, stamp_ns: npt.ArrayLike) -> FloatArray:
        """Return the force [N] (samples,) at ascending times [ns] not before those read already.

        Raises
        ------
        MuscleError
            If a time is before one that has been read, or the times do not ascend.
        """
        stamps = np.atleast_1d(np.asarray(stamp_ns, dtype=np.int64))
        if not len(stamps):
            return np.empty(0)
        if (np.diff(stamps) < 0).any():
            raise MuscleError('expected ascending times, got one that goes back')
        effective, weight, share = self._acting()
        if self._reference_ns is None:
            # a pulse of a clock that was never set: no memory would hold its cells
            first = max(int(effective.min(initial=stamps[0])), int(stamps[0]) - _LONGEST_PAST_NS)
            self._reference_ns = first // CELL_NS * CELL_NS
        if stamps[0] < self._reference_ns:
            fault = f'expected times from {self._reference_ns} ns on, got {stamps[0]} ns'
            raise MuscleError(fault)
        order = np.argsort(effective, kind='stable')
        first_cell = self._reference_ns // CELL_NS
        cells = np.arange(first_cell, int(stamps[-1]) // CELL_NS + 2, dtype=np.int64)
        at = self._elapsed(cells * CELL_NS)
        slow = self._timeline('time_constant', at) / self.subject.time_constant
        scripted = np.column_stack((slow, self._timeline('gain', at)))
        pulses = effective[order], weight[order], share[order]
        muscle = self._rates, self._moments, self._state, self._reference_ns
        force, used, self._reference_ns = _advance(stamps, pulses, first_cell, scripted, *muscle)
        self._drop(order[:used])
        return self._peak * force

    def state(self, stamp_ns: int) -> MuscleState:
        """Return the state at a time [ns]; fatigue and potentiation as of the last `force`."""
        at = self._elapsed(np.array(stamp_ns))
        script = {name: float(self._timeline(name, at)) for name in CHANGEABLE}
        fatigue, slow, potentiation = self._state.tolist()
        script['gain'] *= fatigue * (1.0 + potentiation)
        script['time_constant'] *= slow
        return MuscleState(**script, fatigue=fatigue, potentiation=potentiation)

    def steady_force(self, stamp_ns: int, intensity: FloatArray, rate_hz: float) -> FloatArray:
        """Return the true recruitment curve at a time: steady mean force [N] (intensities,)."""
        state = self.state(stamp_ns)
        curve = self._recruitment(intensity, np.array(state.threshold), np.array(state.saturation))
        full = float(self.subject.steady_force(1.0, rate_hz) / self.subject.recruitment(1.0))
        return state.gain * full * curve

    def _rates_of(self, settings: LivingSettings) -> _Rates:
        fatigue, potentiation = settings.fatigue, settings.potentiation
        # the moments give the force without its peak factor
        use = _CELL_S * self._peak / self.subject.maximum_force
        return _Rates(
            keep_fatigue=float(np.exp(-_CELL_S / fatigue.recovery)),
            loss=fatigue.force_loss * use,
            slowing=fatigue.slowing * use,
            lowest_gain=fatigue.lowest_gain,
            keep_potentiation=float(np.exp(-_CELL_S / potentiation.decay)),
            per_pulse=potentiation.per_pulse,
            largest=potentiation.largest,
            time_constant_ns=self.subject.time_constant * NANOSECONDS_PER_SECOND,
        )

    def _elapsed(self, time_ns: IntArray) -> FloatArray:
        """Return seconds from the start of the session."""
        return (time_ns - self._start_ns) / NANOSECONDS_PER_SECOND

    def _acting(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return twitch onset [ns], peak at rest [N] and recruitment of the pulses to come."""
        at = self._elapsed(self._onset_ns)
        latency = np.rint(self._timeline('latency', at) * NANOSECONDS_PER_SECOND)
        # a late pulse may belong between pulses whose twitch has begun
        every = np.concatenate((self._begun_ns, self._onset_ns))
        order = np.argsort(every, kind='stable')
        rate = np.empty(len(every))
        rate[order] = self._fixed_rate or repetition_rates(every[order])
        rate = rate[len(self._begun_ns) :]
        bends = (self._timeline(name, at) for name in ('threshold', 'saturation'))
        share = self._recruitment(self._intensity, *bends)
        unit = self.subject.pulse_weight(1.0, rate) / float(self.subject.recruitment(1.0))
        return self._onset_ns + latency.astype(np.int64), unit * share, share

    def _recruitment(
        self, intensity: FloatArray, threshold: FloatArray, saturation: FloatArray
    ) -> FloatArray:
        """Return rho_u with changed threshold and saturation, the same gain, 0 at intensity 0."""
        curve = self.subject.recruitment
        moved = (threshold != curve.threshold) | (saturation != curve.saturation)
        zero = curve.bend(np.zeros_like(intensity), threshold, saturation)
        none = np.where(moved, -curve.gain * zero, curve.offset)
        return curve.gain * curve.bend(intensity, threshold, saturation) + none

    def _drop(self, used: IntArray) -> None:
        """Drop pulses whose twitch has begun."""
        if not len(used):
            return
        begun = np.concatenate((self._begun_ns, self._onset_ns[used]))
        self._begun_ns = begun[begun >= begun.max() - _REMEMBERED_NS]
        self._onset_ns = np.delete(self._onset_ns, used)
        self._intensity = np.delete(self._intensity, used)
