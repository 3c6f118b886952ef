"""A stimulator that exists only as a program, with the faults that real ones have."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import check_bounds
from rpms_ros.stimulation.fields import share

_SECONDS = Bound(0.0, 60.0, 's')
# A device that listens every 0.5 s allows one message to be lost.
KEEP_ALIVE_LIMIT_NS = 1_100_000_000


@dataclass(frozen=True)
class SimulatedFaults:
    """What a simulated device does wrong; by default nothing.

    Attributes
    ----------
    silent_loss : float
        Probability that a pulse is not given and nothing said about it.
    extra_intensity : float
        Added to the intensity of every pulse (share).
    slow_s : float
        Delay from the command to the pulse [s].
    stuck_s : float
        How long a command hangs, interrupted only by disarming [s].
    heating_per_pulse : float
        Rise of temperature with every pulse [K].
    vanish_after : int
        Pulses after which the device is gone; 0 for never.
    """

    silent_loss: float = share(0.0)
    extra_intensity: float = bounded(Bound(-1.0, 1.0), 0.0)
    slow_s: float = bounded(_SECONDS, 0.0)
    stuck_s: float = bounded(_SECONDS, 0.0)
    heating_per_pulse: float = bounded(Bound(0.0, 100.0, 'K'), 0.0)
    vanish_after: int = bounded(Bound(0, 10_000_000, whole=True), 0)

    def __post_init__(self) -> None:
        check_bounds(self)


class SimulatedDevice:
    """Gives pulses at once, in mind only.

    Parameters
    ----------
    faults : SimulatedFaults
        What it does wrong; may be replaced at any time.
    clock : callable
        Monotonic time [ns].
    wait : callable
        Waits for a duration [s]; disarming cannot be waited for in another way in a test.
    """

    def __init__(
        self,
        faults: SimulatedFaults | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        wait: Callable[[float], None] = time.sleep,
        seed: int = 0,
    ) -> None:
        self.faults = faults or SimulatedFaults()
        self.opened = False
        self.armed = False
        # the last ones only: a session has no end
        self.fired: deque[Delivery] = deque(maxlen=10_000)
        self._clock = clock
        self._wait = wait
        self._random = np.random.default_rng(seed)
        self._last_sign_ns = 0
        self._heat = 0.0
        self._count = 0

    @property
    def real(self) -> bool:
        """False: nobody can be hurt."""
        return False

    def open(self) -> None:
        """Connect."""
        self._require_present()
        self.opened = True
        self.armed = False

    def arm(self) -> None:
        """Make pulses possible."""
        self._require_present()
        if not self.opened:
            raise DeviceError('expected an open device to arm, got a closed one')
        self._last_sign_ns = self._clock()
        self.armed = True

    def disarm(self) -> None:
        """Make pulses impossible."""
        self.armed = False

    def close(self) -> None:
        """Disarm and let go."""
        self.disarm()
        self.opened = False

    def keep_alive(self) -> None:
        """Note that the driver is there."""
        self._require_present()
        self._last_sign_ns = self._clock()

    def prepare(self, intensity: float) -> None:
        """Nothing takes time here."""
        del intensity

    def fire(self, intensity: float, width_s: float) -> Delivery | None:
        """Give one pulse, or do what the faults say."""
        del width_s
        self._require_present()
        if self._clock() - self._last_sign_ns > KEEP_ALIVE_LIMIT_NS:
            self.disarm()
        self._hang(self.faults.slow_s + self.faults.stuck_s)
        if not self.armed:
            return None
        self._count += 1
        if self.faults.silent_loss > 0 and self._random.random() < self.faults.silent_loss:
            return None
        self._heat += self.faults.heating_per_pulse
        given = Delivery(self._clock(), intensity + self.faults.extra_intensity)
        self.fired.append(given)
        return given

    def temperature(self) -> float | None:
        """Return the simulated temperature, None unless it is part of a fault."""
        return 25.0 + self._heat if self.faults.heating_per_pulse > 0 else None

    def _hang(self, duration: float) -> None:
        end = self._clock() + round(duration * 1e9)
        while self.armed and self._clock() < end:
            self._wait(1e-3)

    def _require_present(self) -> None:
        if 0 < self.faults.vanish_after <= self._count:
            raise DeviceError('expected an answer from the device, got none: it is gone')
