"""Coil temperature: a first-order model that takes over a measured value where there is one.

C dT/dt = s P - (T - T_ambient) C / tau: each pulse warms the coil by s E / C at once, in between
it cools exponentially.  Both are exact, whatever the time between pulses.
"""

import math
from dataclasses import dataclass

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import check_bounds
from rpms_ros.stimulation.fields import share

_CELSIUS = Bound(-20.0, 150.0, 'Celsius')


@dataclass(frozen=True)
class CoilThermal:
    """Thermal figures of a coil.

    Attributes
    ----------
    ambient : float
        Temperature of the room, and of the coil at the start [Celsius].
    coil_share : float
        Share of a pulse's energy that stays in the coil as heat.
    heat_capacity : float
        Of the coil [J/K].
    time_constant : float
        Of its cooling [s].
    cutout : float
        Temperature at which the device refuses to go on [Celsius].
    """

    ambient: float = bounded(_CELSIUS)
    coil_share: float = share()
    heat_capacity: float = bounded(Bound(0.0, 1e6, 'J/K', above=True))
    time_constant: float = bounded(Bound(0.0, 1e6, 's', above=True))
    cutout: float = bounded(_CELSIUS)

    def __post_init__(self) -> None:
        check_bounds(self)


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
        self._time_ns = time_ns
        self._celsius = thermal.ambient

    def at(self, time_ns: int) -> float:
        """Return the temperature [Celsius] at ``time_ns`` [ns] if nothing is fired until then."""
        elapsed = max(0, time_ns - self._time_ns) / NANOSECONDS_PER_SECOND
        above = self._celsius - self.thermal.ambient
        return self.thermal.ambient + above * math.exp(-elapsed / self.thermal.time_constant)

    def heat(self, time_ns: int, energy_j: float) -> float:
        """Take a pulse of ``energy_j`` [J] into account; return the temperature after it."""
        rise = self.thermal.coil_share * energy_j / self.thermal.heat_capacity
        self.measured(time_ns, self.at(time_ns) + rise)
        return self._celsius

    def measured(self, time_ns: int, celsius: float) -> None:
        """Go on from a measured temperature [Celsius]."""
        self._time_ns = max(time_ns, self._time_ns)
        self._celsius = celsius
