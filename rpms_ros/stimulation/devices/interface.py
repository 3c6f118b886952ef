"""What a driver asks of a stimulator."""

import math
from typing import NamedTuple
from typing import Protocol

from rpms_ros.errors import StimulationError


class DeviceError(StimulationError):
    """A device did not answer, refused, or answered nonsense."""


class DeviceStatus(NamedTuple):
    """What a device says about itself; None where it cannot tell.

    Attributes
    ----------
    armed : bool or None
        Whether a trigger would give a pulse.
    ready : bool or None
        Whether it is charged.
    coil_present : bool or None
        Whether a coil is connected.
    replace_coil : bool or None
        Whether the coil has to be replaced.
    error : bool or None
        Whether it reports an error.
    intensity : float or None
        The intensity that is set in it, read back (share).
    temperature : float or None
        Of the coil [Celsius].
    """

    armed: bool | None = None
    ready: bool | None = None
    coil_present: bool | None = None
    replace_coil: bool | None = None
    error: bool | None = None
    intensity: float | None = None
    temperature: float | None = None


UNVERIFIED = ('delivery', 'intensity', 'coil', 'ready', 'error')
"""What a device may be unable to confirm for a pulse."""


class Delivery(NamedTuple):
    """What a device says it did.

    Attributes
    ----------
    time_ns : int
        Onset of the pulse on the driver's monotonic clock [ns].
    intensity : float
        Read back if the device can tell, else what was set (share).
    unverified : frozenset of str
        What of `UNVERIFIED` the device could not confirm for this pulse.
    """

    time_ns: int
    intensity: float
    unverified: frozenset[str] = frozenset()


class Device(Protocol):
    """A stimulator.  Every method but `silence` is called by one thread, its owner.

    Whatever a method raises, of any type, is taken as a fault of the device.
    """

    @property
    def real(self) -> bool:
        """Whether it can hurt somebody."""

    @property
    def trigger_s(self) -> float:
        """Time from the call of `fire` to the onset that the device takes for itself [s]."""

    def quantized(self, intensity: float) -> float:
        """Return the largest intensity it can be set to that is not above ``intensity``."""

    def open(self) -> None:
        """Connect; intensity zero, disarmed."""

    def arm(self) -> DeviceStatus:
        """Make pulses possible, at intensity zero."""

    def prepare(self, intensity: float) -> DeviceStatus | None:
        """Set the intensity of the next pulse, verified as far as the device tells."""

    def fire(self, intensity: float, width_s: float) -> Delivery | None:
        """Trigger a pulse of the intensity that was prepared; return None if it did not come.

        Raises on any doubt: no coil or one to be replaced, an error, not ready, not armed, as far
        as the answer to the trigger tells.
        """

    def keep_alive(self) -> DeviceStatus:
        """Tell the device that its driver is there; an armed one disarms by itself without."""

    def rest(self) -> None:
        """Set intensity zero, armed or not as it is."""

    def silence(self) -> None:
        """Set intensity zero, then disarm: by any thread, at any time, waiting for nobody.

        Also while another call hangs, also twice.
        """

    def close(self) -> None:
        """Silence it and let go of it."""


def quantized_down(intensity: float, steps: int) -> float:
    """Return the largest multiple of ``1 / steps`` that is not above ``intensity`` (share).

    A share that is written as a multiple, such as 0.29 of a hundred, stays what it is, although
    its product with the number of steps is rounded.
    """
    step = math.floor(intensity * steps)
    while step + 1 <= steps and (step + 1) / steps <= intensity:
        step += 1
    while step > 0 and step / steps > intensity:
        step -= 1
    return step / steps
