# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dose: the pulses and the energy that a patient may get within some hours, and an account of it.

A pulse goes on the account when it is reserved, before it is fired.  One that was reserved and
certainly never triggered is given back.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.schedule.fields import Bound, bounded, check_bounds

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


class PlannedPulse(NamedTuple):
    """A pulse that is going to be fired.

    Attributes
    ----------
    time_ns : int
        When, monotonic clock [ns].
    intensity : float
        Share of the maximum.
    energy_j : float
        Energy [J].
    """

    time_ns: int
    intensity: float
    energy_j: float


class BookedPulse(NamedTuple):
    """A pulse that counts as delivered.

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


class DoseTotals(NamedTuple):
    """What a patient got within the window, reserved pulses included.

    Attributes
    ----------
    pulses : int
        Number of pulses.
    energy_j : float
        Energy [J].
    """

    pulses: int
    energy_j: float


@dataclass
class _Entry:
    time_ns: int
    energy_j: float
    counts: bool = True


class DoseAccount:
    """What one patient got, in memory; a window that ends now.

    Parameters
    ----------
    limits : DoseLimits or None
        What the patient may get; None for no bound.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self, limits: DoseLimits | None = None, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.limits = limits
        self._clock = clock
        self._lock = threading.Lock()
        self._entries: deque[_Entry] = deque()
        self._open: dict[int, _Entry] = {}
        self._numbers = 0
        self._pulses = 0
        self._energy_j = 0.0

    @property
    def totals(self) -> DoseTotals:
        """Pulses and energy within the window."""
        with self._lock:
            self._forget()
            return DoseTotals(self._pulses, self._energy_j)

    def check(self, pulses: Sequence[PlannedPulse]) -> None:
        """Raise DoseExceeded if these pulses would be more than the patient may get."""
        self.check_total(len(pulses), sum(pulse.energy_j for pulse in pulses))

    def check_total(self, more: int, energy_j: float) -> None:
        """Raise DoseExceeded if so many pulses of so much energy [J] would be too much."""
        if self.limits is None:
            return
        count, energy = self.totals
        if count + more > self.limits.pulses:
            raise DoseExceeded(
                'dose_pulses',
                f'expected at most {self.limits.pulses} pulses in {self.limits.window_h:g} h, '
                f'got {count + more}',
            )
        energy += energy_j
        # relative rounding of a sum of many thousand pulses
        if energy > self.limits.energy_j * (1.0 + 1e-9):
            raise DoseExceeded(
                'dose_energy_j',
                f'expected at most {self.limits.energy_j:g} J in {self.limits.window_h:g} h, '
                f'got {energy:.6g} J',
            )

    def add(self, pulses: Sequence[PlannedPulse | BookedPulse], reserved: bool = True) -> range:
        """Count pulses; return the numbers of those that are reserved."""
        with self._lock:
            first = self._numbers
            for pulse in pulses:
                entry = _Entry(pulse.time_ns, pulse.energy_j)
                if self.limits is not None:
                    self._entries.append(entry)
                self._pulses += 1
                self._energy_j += pulse.energy_j
                if reserved:
                    self._open[self._numbers] = entry
                    self._numbers += 1
            return range(first, self._numbers)

    def take(self, number: int) -> None:
        """Mark a reserved pulse as fired, once.

        Raises
        ------
        LedgerError
            If there is no such pulse, or it was taken or given back already.
        """
        with self._lock:
            if self._open.pop(number, None) is None:
                raise LedgerError(f'expected a reserved pulse, got number {number}')

    def give_back(self, numbers: Iterable[int] | None = None) -> list[int]:
        """Stop counting reserved pulses that were not taken; all of them by default."""
        with self._lock:
            given = list(self._open if numbers is None else dict.fromkeys(numbers))
            wrong = [number for number in given if number not in self._open]
            if wrong:
                raise LedgerError(f'expected reserved pulses to give back, got numbers {wrong}')
            for number in given:
                entry = self._open.pop(number)
                if entry.counts:
                    entry.counts = False
                    self._pulses -= 1
                    self._energy_j -= entry.energy_j
            return given

    def _forget(self) -> None:
        """Drop what has left the window."""
        if self.limits is None:
            return
        start = self._clock() - self.limits.window_ns
        while self._entries and self._entries[0].time_ns <= start:
            entry = self._entries.popleft()
            if entry.counts:
                entry.counts = False
                self._pulses -= 1
                self._energy_j -= entry.energy_j
        if not self._pulses:
            self._energy_j = 0.0
