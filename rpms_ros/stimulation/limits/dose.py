# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dose: the pulses and the energy that a patient may get within some hours."""

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
