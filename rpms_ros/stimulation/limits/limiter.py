# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a stimulator and of the dose of a patient, and the limiter, which every pulse passes.

The dose ledger holds the dose; the limiter holds everything else, right before the device is told
to fire.  It remembers what was fired, so that rates, trains, energy and totals hold whatever gave
the pulses: one schedule, several in a row, or a fault.  It outlives disarming and a device that
was closed and opened again; with a dose ledger it outlives the process.  A forecast runs a whole
schedule through a copy of it.

Times are whole nanoseconds.  The shortest interval at a rate is the period in whole nanoseconds,
rounded downwards: onsets of a plan are rounded to the nearest, so no interval of a plan at exactly
its rate limit is shorter than that, whatever the rate.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

from rpms_ros.errors import StimulationError
from rpms_ros.printable import counted, told_apart
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.schedule.fields import Bound, Bounded, bounded, share

_POSITIVE_S = Bound(0.0, 86_400.0, 's', above=True)
_COUNT = Bound(1, 10_000_000, whole=True)


@dataclass(frozen=True)
class Rest(Bounded):
    """Silence that a patient needs after so many pulses.

    Attributes
    ----------
    train_pulses : int
        Most pulses without a silence of ``pause_s``, whatever shorter ones are between them.
    pause_s : float
        That silence [s].
    """

    train_pulses: int = bounded(_COUNT)
    pause_s: float = bounded(_POSITIVE_S)


@dataclass(frozen=True)
class Limits(Bounded):
    """Bounds of every pulse.  Energies are 0 for a device that has no coil to heat.

    Attributes
    ----------
    maximum_intensity : float
        Share of the stimulator's maximum.
    maximum_intensity_step : float
        Change from one pulse to the next of a train, and of its first pulse from zero (share).
    maximum_intensity_rise : float
        How much stronger a pulse may be than the strongest of the ``rise_window_s`` before it, or
        than zero if there was none (share): a subject is led to an intensity step by step.
    rise_window_s : float
        How long an intensity counts as known to the subject [s].
    minimum_width_s, maximum_width_s : float
        Duration of a pulse [s].
    maximum_rate_hz : float
        Repetition rate at any intensity [Hz].
    rate_intensities, rate_limits_hz : tuple of float
        Highest rate [Hz] up to each intensity (share), both ascending and descending in step; no
        value is made up between them: the next intensity upwards counts.
    maximum_train_pulses : int
        Pulses of one train; a train ends with a gap of ``minimum_pause_s``.
    minimum_pause_s : float
        Silence between two trains [s].
    pulse_energy_j : float
        Energy of a pulse at full intensity [J]; goes with the square of the intensity.
    continuous_power_w : float
        Mean power over ``energy_window_s``, and over a train with the wait after it [W].
    energy_window_s : float
        Window of the mean power [s].
    session_pulses : int
        Pulses since the driver was started, and those that its dose ledger says the patient had
        before, in the last 24 h or in the window of the dose if that is longer.
    session_energy_j : float
        Energy of these [J].
    interval_tolerance_s : float
        How much earlier than its rate limit allows a pulse may come because the one before it
        was late [s]; it does not add up from pulse to pulse.
    idle_disarm_s : float
        Longest time armed without a pulse [s].
    rest : Rest or None
        Of the patient; None: the trains and pauses above are all.
    """

    maximum_intensity: float = share(1.0)
    maximum_intensity_step: float = share(1.0)
    maximum_intensity_rise: float = share(1.0)
    rise_window_s: float = bounded(_POSITIVE_S, 60.0)
    minimum_width_s: float = bounded(Bound(1e-6, 0.01, 's'), 10e-6)
    maximum_width_s: float = bounded(Bound(1e-6, 0.01, 's'), 1e-3)
    maximum_rate_hz: float = bounded(Bound(0.0, 1000.0, 'Hz', above=True), 50.0)
    rate_intensities: tuple[float, ...] = bounded(Bound(0.0, 1.0, several=True), (1.0,))
    rate_limits_hz: tuple[float, ...] = bounded(
        Bound(0.0, 1000.0, 'Hz', above=True, several=True), (1000.0,)
    )
    maximum_train_pulses: int = bounded(_COUNT, 10_000)
    minimum_pause_s: float = bounded(_POSITIVE_S, 0.5)
    pulse_energy_j: float = bounded(Bound(0.0, 10_000.0, 'J'), 0.0)
    continuous_power_w: float = bounded(Bound(0.0, 100_000.0, 'W', above=True), 1000.0)
    energy_window_s: float = bounded(_POSITIVE_S, 60.0)
    session_pulses: int = bounded(_COUNT, 100_000)
    session_energy_j: float = bounded(Bound(0.0, 1e9, 'J', above=True), 1e8)
    interval_tolerance_s: float = bounded(Bound(0.0, 0.01, 's'), 2e-3)
    idle_disarm_s: float = bounded(_POSITIVE_S, 60.0)
    rest: Rest | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        u, f = self.rate_intensities, self.rate_limits_hz
        if len(u) != len(f) or sorted(set(u)) != list(u) or sorted(f, reverse=True) != list(f):
            raise StimulationError(
                'expected as many rate_limits_hz, descending, as rate_intensities, ascending, '
                f'got {f} and {u}'
            )
        if u[-1] < self.maximum_intensity:
            raise StimulationError(
                f'expected a rate limit up to the maximum intensity {self.maximum_intensity:g}, '
                f'got one up to {u[-1]:g}'
            )
        if self.minimum_width_s > self.maximum_width_s:
            raise StimulationError(
                f'expected minimum_width_s <= maximum_width_s, got {self.minimum_width_s:g} and '
                f'{self.maximum_width_s:g}'
            )

    def highest_rate_hz(self, intensity: float) -> float:
        """Return the highest rate [Hz] at an intensity (share 0..1)."""
        step = bisect_left(self.rate_intensities, intensity, hi=len(self.rate_limits_hz) - 1)
        return min(self.rate_limits_hz[step], self.maximum_rate_hz)

    def energy_j(self, intensity: float) -> float:
        """Return the energy of one pulse [J], E = E_max u^2."""
        return self.pulse_energy_j * intensity * intensity


class Refused(StimulationError):
    """A driver does not do what it was asked to; ``limit`` names the limit or interlock."""

    def __init__(self, limit: str, reason: str) -> None:
        super().__init__(reason)
        self.limit = limit


class Interlocked(Refused):
    """A stop is latched, or something that has to hold for any pulse does not."""


class LedgerError(StimulationError):
    """A pulse cannot be put on the account, so it must not be fired."""


class DoseExceeded(LedgerError, Refused):
    """A pulse would be more than the patient may get.

    Attributes
    ----------
    limit : str
        Name of the limit: ``dose_pulses`` or ``dose_energy_j``.
    """

    def __init__(self, limit: str, fault: str) -> None:
        Refused.__init__(self, limit, f'{limit}: {fault}')


class BookedPulse(NamedTuple):
    """A pulse that is going to be fired, or counts as delivered.

    Attributes
    ----------
    time_ns : int
        When at the latest, monotonic clock of this process [ns]; may be negative.
    intensity : float
        Share of the maximum.
    energy_j : float
        Energy [J].
    on_device : bool
        Whether this device gave it: its coil and its rest have to do with it.
    on_patient : bool
        Whether this patient got it: it is part of the dose.
    """

    time_ns: int
    intensity: float
    energy_j: float
    on_device: bool = True
    on_patient: bool = True


@dataclass(frozen=True)
class DoseLimits(Bounded):
    """What one patient may get within a window that ends now.

    Attributes
    ----------
    pulses : int
        Number of pulses.
    energy_j : float
        Energy [J].
    window_h : float
        Length of the window [h].
    """

    pulses: int = bounded(Bound(1, 10_000_000, whole=True))
    energy_j: float = bounded(Bound(0.0, 1e9, 'J'))
    window_h: float = bounded(Bound(1.0, 168.0, 'h'))


TIMING_LIMITS = ('maximum_rate_hz', 'rate_limits_hz')
"""Limits that a pulse can break by the jitter of the one before it alone."""

# relative rounding of a sum of thousands of energies
ENERGY_ROUNDING = 1e-9
# the difference of two shares is rounded once
_SHARE_ROUNDING = math.ulp(1.0)
_OF_PATIENT = ('session_pulses', 'session_energy_j', 'rested_pulses', 'patient_ns')


class Refusal(NamedTuple):
    """Why a pulse may not be fired.

    Attributes
    ----------
    limit : str
        Name of the limit, as in `Limits` or in a device specification.
    reason : str
        What was expected and what came, in plain words.
    """

    limit: str
    reason: str


class PulseLimiter:
    """Holds pulses, one by one, against limits, and counts those that are fired.

    Parameters
    ----------
    limits : Limits
        What no pulse may go beyond.

    Attributes
    ----------
    tolerance_ns : int
        Tolerance of an interval [ns].
    last_ns : int or None
        Onset of the last pulse [ns].
    last_intensity : float
        Its intensity (share).
    counted_ns : int
        When it was due at its rate limit: intervals are counted from there, so the tolerance of
        many pulses does not add up [ns].
    train_start_ns, train_pulses, train_energy_j : int, int, float
        First onset [ns], pulses and energy [J] of the train that it belongs to.
    rested_pulses, patient_ns : int, int or None
        Pulses since the last rest of the patient, and the onset of the last one [ns].
    window : deque of (int, float)
        Onset [ns] and energy [J] of the pulses within the window of the mean power.
    window_energy_j : float
        Their energy [J].
    known : deque of (int, float)
        Onsets [ns] and intensities (shares) that the subject knows, each stronger than all after
        it, so that the first is the strongest.
    session_pulses, session_energy_j : int, float
        Pulses and energy [J] of the session.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.tolerance_ns = nanoseconds(limits.interval_tolerance_s)
        self._pause_ns = nanoseconds(limits.minimum_pause_s)
        self._window_ns = nanoseconds(limits.energy_window_s)
        self._rise_ns = nanoseconds(limits.rise_window_s)
        self._rest_ns = nanoseconds(limits.rest.pause_s) if limits.rest else 0
        self.last_ns: int | None = None
        self.last_intensity = 0.0
        self.counted_ns = 0
        self.train_start_ns = 0
        # the wait of the trains before this one that is over last: see _longest_wait
        self.earlier = 0, 0.0, ''
        self.train_pulses = 0
        self.train_energy_j = 0.0
        self.rested_pulses = 0
        self.patient_ns: int | None = None
        self.window: deque[tuple[int, float]] = deque()
        self.window_energy_j = 0.0
        self.known: deque[tuple[int, float]] = deque()
        self.session_pulses = 0
        self.session_energy_j = 0.0

    def copy(self) -> 'PulseLimiter':
        """Return one with the same history, whose pulses this one does not count."""
        other = copy(self)
        other.window, other.known = deque(self.window), deque(self.known)
        return other

    # ---- what was fired

    def book(self, time_ns: int, intensity: float) -> None:
        """Count a pulse that is about to be fired: booked first, so that a fault counts too."""
        self._book(time_ns, intensity, self.limits.energy_j(intensity))

    def book_history(self, pulses: Iterable[BookedPulse]) -> None:
        """Count what earlier processes fired, oldest first.

        Trains and power count whatever this device or this patient had; rest and session are the
        patient's.  No intensity counts as known: the subject may be another one, or have rested.
        """
        for pulse in pulses:
            before = {name: getattr(self, name) for name in _OF_PATIENT}
            # clocks of two processes agree to some microseconds: time does not go back here
            latest = pulse.time_ns if self.last_ns is None else max(pulse.time_ns, self.last_ns)
            self._book(latest, pulse.intensity, pulse.energy_j)
            if not pulse.on_patient:
                vars(self).update(before)
        self.known.clear()

    def _book(self, time_ns: int, intensity: float, energy_j: float) -> None:
        if self.starts_train(time_ns):
            self.earlier = self._longest_wait()
            self.train_start_ns, self.train_pulses, self.train_energy_j = time_ns, 0, 0.0
            self.counted_ns = time_ns
        else:
            due = self._due_ns(intensity)[0]
            # what was booked against the limit leaves no debt to the next one
            self.counted_ns = time_ns if time_ns < due - self.tolerance_ns else max(time_ns, due)
        self.train_pulses += 1
        self.rested_pulses = 1 if self._has_rested(time_ns) else self.rested_pulses + 1
        self.session_pulses += 1
        self.book_more(time_ns, energy_j)
        self.last_ns, self.last_intensity, self.patient_ns = time_ns, intensity, time_ns
        while self.known and self.known[-1][1] <= intensity:
            self.known.pop()
        self.known.append((time_ns, intensity))
        self._forget(time_ns)

    def book_more(self, time_ns: int, energy_j: float) -> None:
        """Count energy [J] that pulses turn out at ``time_ns`` [ns] to have had besides."""
        self.train_energy_j += energy_j
        self.window.append((time_ns, energy_j))
        self.window_energy_j += energy_j
        self.session_energy_j += energy_j

    def correct(self, time_ns: int) -> None:
        """Move the last pulse to when the device gave it [ns], if that was later than booked."""
        if self.last_ns is None or time_ns <= self.last_ns:
            return
        if self.train_pulses == 1:
            self.train_start_ns = time_ns
        self.last_ns = self.patient_ns = time_ns
        self.counted_ns = max(self.counted_ns, time_ns)
        self.window[-1] = (time_ns, self.window[-1][1])
        if self.known:
            self.known[-1] = (time_ns, self.known[-1][1])

    def _forget(self, time_ns: int) -> None:
        """Forget what has left the windows of mean power and of rise."""
        while self.window and self.window[0][0] <= time_ns - self._window_ns:
            self.window_energy_j -= self.window.popleft()[1]
        if not self.window:
            self.window_energy_j = 0.0
        while self.known and self.known[0][0] < time_ns - self._rise_ns:
            self.known.popleft()

    def starts_train(self, time_ns: int) -> bool:
        """Return whether a pulse at ``time_ns`` [ns] would be the first of a train."""
        return self.last_ns is None or time_ns - self.last_ns >= self._pause_ns

    def _has_rested(self, time_ns: int) -> bool:
        return self.patient_ns is None or time_ns - self.patient_ns >= self._rest_ns

    @property
    def rest_s(self) -> float:
        """Silence that the patient needs before the next pulse [s]; 0 for none."""
        rest = self.limits.rest
        return rest.pause_s if rest and self.rested_pulses >= rest.train_pulses else 0.0

    def _due_ns(self, intensity: float) -> tuple[int, float]:
        """Return when the next pulse is due at its rate limit [ns], and that rate [Hz]."""
        # both pulses of an interval take part: the stronger one decides
        rate = self.limits.highest_rate_hz(max(intensity, self.last_intensity))
        return self.counted_ns + math.floor(NANOSECONDS_PER_SECOND / rate), rate

    def earliest_ns(self, intensity: float) -> int:
        """Return when the rate limits let a pulse of this intensity come [ns]; 0 for at once."""
        if self.last_ns is None:
            return 0
        return max(self.last_ns + 1, self._due_ns(intensity)[0] - self.tolerance_ns)

    @property
    def wait_s(self) -> float:
        """Silence that the train so far has to be followed by [s]; 0 before the first pulse.

        max(t_min, E/P - n/f), for n pulses at rate f with energy E = n J and continuous power P:
        the same as n (f J - P) / (P f).
        """
        if self.last_ns is None:
            return 0.0
        pulses, energy_s = self.train_pulses, self.train_energy_j / self.limits.continuous_power_w
        span_s = (self.last_ns - self.train_start_ns) / NANOSECONDS_PER_SECOND
        # n/f: a train of n pulses lasts one period longer than the time between its ends
        lasted = span_s * pulses / (pulses - 1) if pulses > 1 else 0.0
        return max(self.limits.minimum_pause_s, energy_s - lasted)

    def _longest_wait(self) -> tuple[int, float, str]:
        """Return when the last wait of all trains is over [ns], how long it is [s], and of what.

        In what a crash has left the train before may be younger than its wait.
        """
        until_ns = (self.last_ns or 0) + math.floor(self.wait_s * NANOSECONDS_PER_SECOND)
        train = f'a train of {counted(self.train_pulses, "pulse")} and {self.train_energy_j:.4g} J'
        return max(self.earlier, (until_ns, self.wait_s, train))

    # ---- what may be fired

    def refusal(self, time_ns: int, intensity: float, width_s: float) -> Refusal | None:
        """Return why a pulse may not be fired, or None if it may.

        Parameters
        ----------
        time_ns : int
            Its onset [ns], on a clock that never jumps.
        intensity : float
            Share of the maximum, 0..1.
        width_s : float
            Duration [s].
        """
        return next(self.refusals(time_ns, intensity, width_s), None)

    def refusals(self, time_ns: int, intensity: float, width_s: float) -> Iterator[Refusal]:
        """Yield everything that stands against a pulse, as `refusal` does the first."""
        self._forget(time_ns)
        yield from self._by_intensity(time_ns, intensity, width_s)
        if self.last_ns is not None:
            yield from self._by_time(time_ns, self.last_ns, intensity)
        rest = self.limits.rest
        if rest and self.rest_s and not self._has_rested(time_ns):
            yield Refusal(
                'rest',
                f'expected a pause of {rest.pause_s:g} s after at most {rest.train_pulses} '
                'pulses, got one pulse more',
            )
        yield from self._by_energy(self.limits.energy_j(intensity))

    def _by_intensity(self, time_ns: int, intensity: float, width_s: float) -> Iterator[Refusal]:
        limits = self.limits
        # written so that NaN fails
        if not 0.0 <= intensity <= limits.maximum_intensity:
            yield Refusal(
                'maximum_intensity',
                f'expected an intensity in [0, {limits.maximum_intensity:g}], got {intensity:g}',
            )
        elif not limits.minimum_width_s <= width_s <= limits.maximum_width_s:
            yield Refusal(
                'minimum_width_s' if width_s < limits.minimum_width_s else 'maximum_width_s',
                f'expected a width in [{limits.minimum_width_s:g}, {limits.maximum_width_s:g}] s, '
                f'got {width_s:g} s',
            )
        before = 0.0 if self.starts_train(time_ns) else self.last_intensity
        if not abs(intensity - before) <= limits.maximum_intensity_step + _SHARE_ROUNDING:
            yield Refusal(
                'maximum_intensity_step',
                f'expected a step of at most {limits.maximum_intensity_step:g} from {before:g}, '
                f'got {intensity:g}',
            )
        known = self.known[0][1] if self.known else 0.0
        if not intensity - known <= limits.maximum_intensity_rise + _SHARE_ROUNDING:
            yield Refusal(
                'maximum_intensity_rise',
                f'expected at most {limits.maximum_intensity_rise:g} more than {known:g}, the '
                f'strongest of the {limits.rise_window_s:g} s before, got {intensity:g}',
            )

    def _by_time(self, time_ns: int, last_ns: int, intensity: float) -> Iterator[Refusal]:
        limits = self.limits
        gap_s = (time_ns - last_ns) / NANOSECONDS_PER_SECOND
        if time_ns < self.earliest_ns(intensity):
            rate = self._due_ns(intensity)[1]
            yield Refusal(
                'maximum_rate_hz' if rate == limits.maximum_rate_hz else 'rate_limits_hz',
                f'expected at most {rate:g} Hz at intensity '
                f'{max(intensity, self.last_intensity):.3g}, got {gap_s:.4g} s after the pulse '
                'before',
            )
        if not self.starts_train(time_ns):
            if self.train_pulses >= limits.maximum_train_pulses:
                yield Refusal(
                    'maximum_train_pulses',
                    f'expected a pause of {limits.minimum_pause_s:g} s after at most '
                    f'{limits.maximum_train_pulses} pulses, got one pulse more',
                )
        elif time_ns < (longest := self._longest_wait())[0]:
            until_ns, wait_s, train = longest
            got_s = wait_s - (until_ns - time_ns) / NANOSECONDS_PER_SECOND
            wait, got = told_apart(wait_s, got_s)
            yield Refusal('wait', f'expected a wait of {wait} s after {train}, got {got} s')

    def _by_energy(self, energy_j: float) -> Iterator[Refusal]:
        limits = self.limits
        most_j = limits.continuous_power_w * limits.energy_window_s
        window_j = self.window_energy_j + energy_j
        if not window_j <= most_j * (1.0 + ENERGY_ROUNDING):
            yield Refusal(
                'continuous_power_w',
                f'expected at most {most_j:.4g} J in {limits.energy_window_s:g} s '
                f'({limits.continuous_power_w:g} W), got {window_j:.4g} J',
            )
        session_j = self.session_energy_j + energy_j
        if self.session_pulses >= limits.session_pulses:
            yield Refusal(
                'session_pulses',
                f'expected at most {limits.session_pulses} pulses a session, got one more',
            )
        elif not session_j <= limits.session_energy_j:
            yield Refusal(
                'session_energy_j',
                f'expected at most {limits.session_energy_j:g} J a session, got {session_j:.6g} J',
            )


def too_quiet(limits: Limits, silence_ns: int) -> Refusal | None:
    """Return why a pulse, or the end, may not come after a silence [ns], or None if it may."""
    if silence_ns <= nanoseconds(limits.idle_disarm_s):
        return None
    silence_s = silence_ns / NANOSECONDS_PER_SECOND
    return Refusal(
        'idle_disarm_s',
        f'expected at most {limits.idle_disarm_s:g} s without a pulse, got {silence_s:.4g} s',
    )
