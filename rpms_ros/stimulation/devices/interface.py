"""What a driver asks of a stimulator."""

from typing import NamedTuple
from typing import Protocol

from rpms_ros.errors import StimulationError


class DeviceError(StimulationError):
    """A device did not answer, refused, or answered nonsense."""


class Delivery(NamedTuple):
    """What a device says it did.

    Attributes
    ----------
    time_ns : int
        Onset of the pulse on the driver's monotonic clock [ns].
    intensity : float
        Share of the maximum.
    """

    time_ns: int
    intensity: float


class Device(Protocol):
    """A stimulator.  Every method but `disarm` is called by one thread at a time.

    `disarm` may be called at any time, by any thread, also while another call hangs, also twice:
    intensity goes to zero first, everything else after.  It must not wait for the other calls.
    """

    @property
    def real(self) -> bool:
        """Whether it can hurt somebody."""

    def open(self) -> None:
        """Connect; intensity zero, disarmed."""

    def arm(self) -> None:
        """Make pulses possible."""

    def disarm(self) -> None:
        """Make pulses impossible."""

    def close(self) -> None:
        """Disarm and let go of it."""

    def keep_alive(self) -> None:
        """Tell an armed device that its driver is there; without it, it disarms by itself."""

    def prepare(self, intensity: float) -> None:
        """Do ahead of time what the next pulse, of this intensity, allows."""

    def fire(self, intensity: float, width_s: float) -> Delivery | None:
        """Give one pulse now; return what was delivered, None if nothing was."""

    def temperature(self) -> float | None:
        """Return the coil's temperature [Celsius], None if the device does not measure it."""
