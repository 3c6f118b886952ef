# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Coil temperature: a first-order model that takes over a measured value where there is one.

C dT/dt = s P - (T - T_ambient) C / tau: each pulse warms the coil by s E / C at once, in between
it cools exponentially.  Both are exact, whatever the time between pulses.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.limits.limiter import BookedPulse
from rpms_ros.stimulation.schedule.fields import Bound, Bounded, DescriptionError, bounded, share

# A room, and a coil; nobody stands below or above these.
_ROOM, _COIL = Bound(0.0, 50.0, 'Celsius'), Bound(0.0, 150.0, 'Celsius')
# How much colder a coil may be than the specification of the room, or of the coil, lets it be.
_COLDER_K = 10.0


@dataclass(frozen=True)
class CoilThermal(Bounded):
    """Thermal figures of a coil.

    Attributes
    ----------
    ambient : float
        Temperature of the room, and of a coil that has given no pulse for long [Celsius].
    coil_share : float
        Share of a pulse's energy that stays in the coil as heat.
    heat_capacity : float
        Of the coil [J/K].
    time_constant : float
        Of its cooling [s].
    cutout : float
        Temperature at which the device refuses to go on [Celsius].
    """

    ambient: float = bounded(_ROOM)
    coil_share: float = share()
    heat_capacity: float = bounded(Bound(0.0, 1e6, 'J/K', above=True))
    time_constant: float = bounded(Bound(0.0, 1e6, 's', above=True))
    cutout: float = bounded(_COIL)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.cutout > self.ambient:
            raise DescriptionError(
                'cutout', f'expected more than ambient, {self.ambient:g}, got {self.cutout:g}'
            )


class CoilTemperature:
    """Temperature of one coil over time.

    Parameters
    ----------
    thermal : CoilThermal
        Its figures.
    time_ns : int
        Now [ns]; the coil is as warm as the room.
    """

    def __init__(self, thermal: CoilThermal, time_ns: int = 0) -> None:
        self.thermal = thermal
        # time and temperature as one value: other threads read it at any moment
        self._known = time_ns, thermal.ambient
        # the same if nothing is measured
        self._alone = self._known

    def at(self, time_ns: int) -> float:
        """Return the temperature [Celsius] at ``time_ns`` [ns] if nothing is fired until then."""
        return self._cooled(self._known, time_ns)

    def doubt(self, time_ns: int, celsius: float) -> str | None:
        """Return what is wrong with a measured temperature [Celsius], None if it may be right."""
        least = max(self.thermal.ambient, self._cooled(self._alone, time_ns)) - _COLDER_K
        # written so that NaN is wrong
        if celsius >= least:
            return None
        return f'expected a sensor that works, at least {least:.3g} Celsius, got {celsius:g}'

    def _cooled(self, known: tuple[int, float], time_ns: int) -> float:
        known_ns, celsius = known
        elapsed = max(0, time_ns - known_ns) / NANOSECONDS_PER_SECOND
        above = celsius - self.thermal.ambient
        return self.thermal.ambient + above * math.exp(-elapsed / self.thermal.time_constant)

    def heat(self, time_ns: int, energy_j: float) -> float:
        """Take a pulse of ``energy_j`` [J] into account; return the temperature after it."""
        rise = self.thermal.coil_share * energy_j / self.thermal.heat_capacity
        celsius = self.at(time_ns) + rise
        self.measured(time_ns, celsius)
        self._alone = self._known[0], self._cooled(self._alone, time_ns) + rise
        return celsius

    def measured(self, time_ns: int, celsius: float) -> None:
        """Go on from a measured temperature [Celsius]."""
        self._known = max(time_ns, self._known[0]), celsius


def coil_after(
    pulses: Iterable[BookedPulse], thermal: CoilThermal, time_ns: int
) -> CoilTemperature:
    """Return a coil as warm as earlier pulses have left it.

    Parameters
    ----------
    pulses : iterable of BookedPulse
        Oldest first; before the first one of this device its coil was as warm as the room.
    thermal : CoilThermal
        Its figures.
    time_ns : int
        Now [ns].
    """
    given = [pulse for pulse in pulses if pulse.on_device]
    coil = CoilTemperature(thermal, given[0].time_ns if given else time_ns)
    for pulse in given:
        coil.heat(pulse.time_ns, pulse.energy_j)
    return coil
