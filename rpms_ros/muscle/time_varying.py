# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""A muscle that changes while it is stimulated: fatigue, potentiation, scripted changes.

A chain of n equal poles whose time constant T_a(t) changes is the fixed chain of `contraction` in
the time ``theta(t) = int dt / T_a(t)``, so its moments stay exact.  Everything that changes is
held constant within cells of 10 ms, which begin at multiples of 10 ms of the time stamp: the
result does not depend on how samples are cut into blocks.  Per cell:

- scripted values (`Timeline`) are those at its beginning;
- fatigue and potentiation are updated at its end, with the force there.

A pulse has the recruitment of its onset, and the gain of the time at which its twitch begins.
``gain`` and fatigue scale the *steady force*: the peak of a slower twitch is smaller in
proportion.  A pulse that is added after samples on which it should have acted acts from its own
onset on, with the present T_a.

Fatigue has the form of Ding, Wexler and Binder-Macleod (J Electromyogr Kinesiol 13, 2003): the
scaling of the force and a time constant move away from their rested values in proportion to the
force, and return with one time constant,

.. math::
    \dot g = -\frac{g - 1}{\tau_{fat}} - a\,\frac{F}{F_{max}}, \qquad
    \dot s = -\frac{s - 1}{\tau_{fat}} + b\,\frac{F}{F_{max}}

with the steady force `g` and the time constant of the twitch `s` relative to the rested muscle.
Their value for human quadriceps is tau_fat = 127 s; their rates are per newton of that muscle, so
`a` and `b` are stated here per share of the subject's own maximum.

Potentiation is the growth of the twitch with the number of preceding pulses, which fades within
minutes (Rassier and MacIntosh, Braz J Med Biol Res 33, 2000): each pulse adds a share of the
difference to the largest potentiation, in proportion to its recruitment; it decays exponentially.
"""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.muscle.contraction import (
    Contraction,
    MuscleState,
    check_rate,
    checked_pulses,
    move_moments,
    repetition_rates,
    twitch_peak_factor,
)
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION
from rpms_ros.muscle.subject import Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray


@dataclass(frozen=True)
class Fatigue:
    """Fatigue and recovery; without effect by default.

    Attributes
    ----------
    force_loss : float
        `a`: loss of steady force while the muscle gives its maximum force [1/s].
    slowing : float
        `b`: growth of the time constant while the muscle gives its maximum force [1/s].
    recovery : float
        Time constant with which both return [s].
    lowest_gain : float
        The steady force never falls below this share of the rested one.

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    force_loss: float = 0.0
    slowing: float = 0.0
    recovery: float = 127.0
    lowest_gain: float = 0.05

    def __post_init__(self) -> None:
        for name in ('force_loss', 'slowing'):
            check_number(MuscleError, name, getattr(self, name), 0)
        check_number(MuscleError, 'recovery', self.recovery, 0, above=True, unit='s')
        check_number(MuscleError, 'lowest_gain', self.lowest_gain, 0, 1, above=True)


@dataclass(frozen=True)
class Potentiation:
    """Growth of the twitch with use; without effect by default.

    Attributes
    ----------
    largest : float
        Largest growth of the twitch, as a share of the rested one.
    per_pulse : float
        Share of the difference to `largest` that one pulse at full recruitment adds.
    decay : float
        Time constant with which it fades [s].

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    largest: float = 0.0
    per_pulse: float = 0.01
    decay: float = 180.0

    def __post_init__(self) -> None:
        check_number(MuscleError, 'largest', self.largest, 0)
        check_number(MuscleError, 'per_pulse', self.per_pulse, 0, 1)
        check_number(MuscleError, 'decay', self.decay, 0, above=True, unit='s')


# Distance of the two knots of a step, shorter than any sampling period [s].
_STEP_S = 1e-9
# No muscle becomes stronger or slower than that; a number beyond has the wrong unit.
_LARGEST_GAIN, _LONGEST_S = 100.0, 1.0


@dataclass(frozen=True)
class Change:
    """A change of the muscle from a time on; a field that is None does not change.

    Attributes
    ----------
    at : float
        When it begins, from the start of the session [s].
    over : float
        Duration of the linear transition [s]; 0 for a step.
    gain : float or None
        Factor on the steady force afterwards, relative to the unchanged subject.
    time_constant : float or None
        T_a [s].
    latency : float or None
        From the pulse to the onset of its twitch [s].
    threshold, saturation : float or None
        u_thr and u_sat of the recruitment curve; a coil that moves changes these two.

    Raises
    ------
    MuscleError
        If a value is not possible, or nothing changes.
    """

    at: float
    over: float = 0.0
    gain: float | None = None
    time_constant: float | None = None
    latency: float | None = None
    threshold: float | None = None
    saturation: float | None = None

    def __post_init__(self) -> None:
        for name in ('at', 'over'):
            check_number(MuscleError, name, getattr(self, name), 0, unit='s')
        for name, least, most in (
            ('gain', 0.0, _LARGEST_GAIN),
            ('time_constant', 0.0, _LONGEST_S),
            ('latency', 0.0, _LONGEST_S),
            ('threshold', -1.0, 3.0),
            ('saturation', -1.0, 3.0),
        ):
            if (value := getattr(self, name)) is not None:
                above = name == 'time_constant'
                check_number(MuscleError, name, value, least, most, above=above)
        if self.threshold is not None and self.saturation is not None:
            _require_apart(self.at + self.over, self.threshold, self.saturation)
        if all(getattr(self, name) is None for name in CHANGEABLE):
            raise MuscleError(f'expected a change of {", ".join(CHANGEABLE)}, got none')


CHANGEABLE = tuple(field.name for field in fields(Change) if field.name not in ('at', 'over'))
"""Names of what a `Change` can change."""


class Timeline:
    """Values over time; each change starts from the value reached so far.

    Parameters
    ----------
    start : dict of str to float
        Values of `CHANGEABLE` before any change.
    changes : sequence of Change
        In any order.

    Raises
    ------
    MuscleError
        If threshold and saturation come too close to each other: beyond each other the muscle
        would push.
    """

    def __init__(self, start: dict[str, float], changes: Sequence[Change] = ()) -> None:
        ordered = sorted(changes, key=lambda change: change.at)
        self._knots = {name: _knots(name, start[name], ordered) for name in CHANGEABLE}
        self._check_recruitment(start)

    def _check_recruitment(self, start: dict[str, float]) -> None:
        names = ('threshold', 'saturation')
        # both are linear from knot to knot, and so is their distance
        knots = np.unique(np.concatenate([self._knots[name][0] for name in names]))
        values = (self(name, knots).tolist() for name in names)
        for time, *pair in zip(knots.tolist(), *values, strict=True):
            # a subject of one's own is taken as it is
            if pair != [start[name] for name in names]:
                _require_apart(time, *pair)

    def __call__(self, name: str, time: FloatArray) -> FloatArray:
        """Return the values of `name` at times from the start (...) [s], same shape."""
        at, value = self._knots[name]
        return np.interp(time, at, value)


def _require_apart(time: float, threshold: float, saturation: float) -> None:
    # differences of decimal numbers are rounded
    if not saturation - threshold > SMALLEST_SEPARATION - 1e-9:
        raise MuscleError(
            f'expected a saturation at least {SMALLEST_SEPARATION} above the threshold, '
            f'got {saturation:g} and {threshold:g} at {time:g} s'
        )


def _knots(name: str, start: float, changes: Sequence[Change]) -> tuple[FloatArray, FloatArray]:
    """Return times and values (knots,) of the piecewise linear course of the changes."""
    at, value = [0.0], [start]
    for change in changes:
        target = getattr(change, name)
        if target is None:
            continue
        # a change that begins during the one before it replaces the rest of that one
        begin = change.at if change.over > 0.0 else change.at - _STEP_S
        here = float(np.interp(begin, at, value))
        kept = bisect.bisect_left(at, begin)
        at = [*at[:kept], begin, change.at + change.over]
        value = [*value[:kept], here, target]
    return np.array(at), np.array(value)


CELL_NS = 10_000_000
_CELL_S = CELL_NS / NANOSECONDS_PER_SECOND
# Pulses whose twitch has begun are before late ones for so long [ns].
_REMEMBERED_NS = 2 * NANOSECONDS_PER_SECOND


class _Rates(NamedTuple):
    """Coefficients of one cell for `_advance`."""

    keep_fatigue: float
    loss: float
    slowing: float
    lowest_gain: float
    keep_potentiation: float
    per_pulse: float
    largest: float


@dataclass(frozen=True)
class LivingSettings:
    """What changes in a muscle.

    Attributes
    ----------
    fatigue : Fatigue
        Changes caused by its force.
    potentiation : Potentiation
        Changes caused by the pulses.
    changes : tuple of Change
        Scripted changes.
    """

    fatigue: Fatigue = Fatigue()
    potentiation: Potentiation = Potentiation()
    changes: tuple[Change, ...] = ()


@numba.njit(cache=True)
def _advance(
    stamp_ns: IntArray,
    effective_ns: IntArray,
    weight: FloatArray,
    share: FloatArray,
    first_cell: int,
    scripted: FloatArray,
    rates: _Rates,
    scale: float,
    moments: FloatArray,
    state: FloatArray,
    reference_ns: int,
) -> tuple[FloatArray, int, int]:
    """Advance the muscle to the last stamp; return force, pulses used and reference time.

    `scripted` (cells, 2) holds T_a / T_a(rest) and gain of each cell; `state` (3,) fatigue gain,
    slowing and potentiation; `weight` (pulses,) the peak of each twitch [N] at rest, `share` its
    recruitment; `moments` (n,) are in newtons, of lags in the time theta.
    """
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
                    move_moments(moments, (onset - reference_ns) / (scale * slow))
                    reference_ns = onset
                    continue
                lag = (reference_ns - onset) / (scale * slow)
                gain = scripted[cell - first_cell, 1] * state[0] * (1.0 + state[2])
                term = weight[pulse] * gain / slow * np.exp(-lag)
                for j in range(len(moments)):
                    moments[j] += term
                    term *= lag
                left = rates.largest - state[2]
                state[2] += rates.per_pulse * share[pulse] * max(left, 0.0)
                pulse += 1
                continue
            if stamp < boundary:
                break
            move_moments(moments, (boundary - reference_ns) / (scale * slow))
            reference_ns = boundary
            use = moments[-1]
            faded = 1.0 + (state[0] - 1.0) * rates.keep_fatigue - rates.loss * use
            state[0] = max(faded, rates.lowest_gain)
            state[1] = 1.0 + (state[1] - 1.0) * rates.keep_fatigue + rates.slowing * use
            state[2] *= rates.keep_potentiation
        at_sample[:] = moments
        move_moments(at_sample, (stamp - reference_ns) / (scale * slow))
        force[index] = at_sample[-1]
    return force, pulse, reference_ns


class LivingContraction:
    """Isometric force of a stimulated muscle that changes; read forwards in time only.

    Parameters
    ----------
    subject : Subject
        The muscle at rest.
    settings : LivingSettings
        What changes in it.
    start_ns : int
        Start of the session, from which scripted changes count [ns].
    fixed_rate_hz : float or None
        As in `Contraction`.

    Raises
    ------
    MuscleError
        If the rate is not above zero.
    """

    def __init__(
        self,
        subject: Subject,
        settings: LivingSettings,
        start_ns: int,
        fixed_rate_hz: float | None = None,
    ) -> None:
        check_rate(fixed_rate_hz)
        self.subject = subject
        self.settings = settings
        self._start_ns = start_ns
        self._fixed_rate = fixed_rate_hz
        rested = Contraction(subject).state(0)._asdict()
        self._timeline = Timeline({name: rested[name] for name in CHANGEABLE}, settings.changes)
        self._peak = twitch_peak_factor(subject.order)
        self._moments = np.zeros(subject.order)
        self._state = np.array([1.0, 1.0, 0.0])
        self._rates = self._rates_of(settings)
        self._reference_ns: int | None = None
        self._begun_ns = np.empty(0, dtype=np.int64)
        self._onset_ns = np.empty(0, dtype=np.int64)
        self._intensity = np.empty(0)

    def begin(self, start_ns: int) -> None:
        """Count the times of scripted changes from `start_ns` [ns]."""
        self._start_ns = start_ns

    def add_pulses(self, onset_ns: npt.ArrayLike, intensity: npt.ArrayLike) -> None:
        """Add pulses (pulses,) at onsets [ns] with intensities (share 0..1), in any order.

        Raises
        ------
        MuscleError
            If an intensity is not between 0 and 1; nothing is added then.
        """
        onsets, values = checked_pulses(onset_ns, intensity)
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
            first = min(int(stamps[0]), int(effective.min(initial=stamps[0])))
            self._reference_ns = first // CELL_NS * CELL_NS
        if stamps[0] < self._reference_ns:
            raise MuscleError(
                f'expected times from {self._reference_ns} ns on, got {stamps[0]} ns'
            )
        order = np.argsort(effective, kind='stable')
        first_cell = self._reference_ns // CELL_NS
        force, used, self._reference_ns = _advance(
            stamps,
            effective[order],
            weight[order],
            share[order],
            first_cell,
            self._scripted(first_cell, int(stamps[-1]) // CELL_NS + 1),
            self._rates,
            self.subject.time_constant * NANOSECONDS_PER_SECOND,
            self._moments,
            self._state,
            self._reference_ns,
        )
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
        )

    def _elapsed(self, time_ns: IntArray) -> FloatArray:
        """Return seconds from the start of the session."""
        elapsed: FloatArray = (time_ns - self._start_ns) / NANOSECONDS_PER_SECOND
        return elapsed

    def _scripted(self, first: int, end: int) -> FloatArray:
        """Return T_a / T_a(rest) and gain of the cells from `first` to `end` (cells, 2)."""
        at = self._elapsed(np.arange(first, end + 1, dtype=np.int64) * CELL_NS)
        slow = self._timeline('time_constant', at) / self.subject.time_constant
        return np.column_stack((slow, self._timeline('gain', at)))

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
        share = self._recruitment(
            self._intensity, self._timeline('threshold', at), self._timeline('saturation', at)
        )
        unit = self.subject.pulse_weight(1.0, rate) / float(self.subject.recruitment(1.0))
        return self._onset_ns + latency.astype(np.int64), unit * share, share

    def _recruitment(
        self, intensity: FloatArray, threshold: FloatArray, saturation: FloatArray
    ) -> FloatArray:
        """Return rho_u with changed threshold and saturation, the same gain, 0 at intensity 0."""
        curve = self.subject.recruitment

        def shape(u: FloatArray) -> FloatArray:
            above, beyond = u - threshold, u - saturation
            bend: FloatArray = above * np.arctan(curve.threshold_slope * above)
            return bend - beyond * np.arctan(curve.saturation_slope * beyond)

        moved = (threshold != curve.threshold) | (saturation != curve.saturation)
        none = np.where(moved, -curve.gain * shape(np.zeros_like(intensity)), curve.offset)
        return curve.gain * shape(intensity) + none

    def _drop(self, used: IntArray) -> None:
        """Drop pulses whose twitch has begun."""
        if not len(used):
            return
        begun = np.concatenate((self._begun_ns, self._onset_ns[used]))
        self._begun_ns = begun[begun >= begun.max() - _REMEMBERED_NS]
        keep = np.ones(len(self._onset_ns), dtype=np.bool_)
        keep[used] = False
        self._onset_ns, self._intensity = self._onset_ns[keep], self._intensity[keep]


Muscle = Contraction | LivingContraction
"""Pulses in, isometric force out."""


def muscle_of(
    subject: Subject, settings: LivingSettings, fixed_rate_hz: float | None = None
) -> Muscle:
    """Return a `LivingContraction`, or a `Contraction` if the settings change nothing."""
    if settings == LivingSettings():
        return Contraction(subject, fixed_rate_hz)
    return LivingContraction(subject, settings, 0, fixed_rate_hz)
