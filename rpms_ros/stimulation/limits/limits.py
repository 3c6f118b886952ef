# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a stimulator, which its specification states, and of the dose of a patient.

The limiter enforces the former, the dose ledger the latter.
"""

from bisect import bisect_left
from dataclasses import dataclass
from typing import NamedTuple

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.schedule.fields import Bound, bounded, check_bounds, share

_POSITIVE_S = Bound(0.0, 86_400.0, 's', above=True)
_COUNT = Bound(1, 10_000_000, whole=True)


@dataclass(frozen=True)
class Limits:
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

    def __post_init__(self) -> None:
        check_bounds(self)
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

    @property
    def window_energy_j(self) -> float:
        """Energy that fits into the window [J]."""
        return self.continuous_power_w * self.energy_window_s

    def wait_s(self, pulses: int, energy_j: float, span_s: float) -> float:
        """Return the silence that a train has to be followed by [s].

        max(t_min, E/P - n/f), for n pulses at rate f with energy E = n J and continuous power P:
        the same as n (f J - P) / (P f).

        Parameters
        ----------
        pulses : int
            Pulses of the train.
        energy_j : float
            Their energy [J].
        span_s : float
            Time from its first pulse to its last [s].
        """
        # n/f: a train of n pulses lasts one period longer than the time between its ends
        lasted = span_s * pulses / (pulses - 1) if pulses > 1 else 0.0
        return max(self.minimum_pause_s, energy_j / self.continuous_power_w - lasted)


LONGEST_WINDOW_H = 168.0


class LedgerError(StimulationError):
    """A pulse cannot be put on the account, so it must not be fired."""


class DoseExceeded(LedgerError):
    """A pulse would be more than the patient may get.

    Attributes
    ----------
    limit : str
        Name of the limit: ``dose_pulses`` or ``dose_energy_j``.
    """

    def __init__(self, limit: str, fault: str) -> None:
        super().__init__(f'{limit}: {fault}')
        self.limit = limit


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
class DoseLimits:
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
    window_h: float = bounded(Bound(0.0, LONGEST_WINDOW_H, 'h', above=True))

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def window_ns(self) -> int:
        """Length of the window [ns]."""
        return nanoseconds(self.window_h * 3600.0)
