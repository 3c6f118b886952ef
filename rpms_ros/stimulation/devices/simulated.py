# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stimulator that exists only as a program."""

import math
import time
from collections.abc import Callable

from rpms_ros.stimulation.devices.registry import (
    Delivery,
    DeviceError,
    DeviceOptions,
    DeviceStatus,
    Shares,
    TooLate,
)

# Longer than a driver of a simulated device may stand still, 2 s.
KEEP_ALIVE_LIMIT_NS = 2_500_000_000


class SimulatedDevice:
    """Counts pulses and gives none.

    Parameters
    ----------
    clock : callable
        Monotonic time [ns].
    """

    # nobody can be hurt; nothing takes time; any width is taken; every answer tells the intensity
    real = False
    sets_width = True
    arm_s = prepare_s = trigger_s = 0.0
    read_back_s = math.inf

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.opened = self.armed = False
        self.intensity = 0.0
        self._clock = clock
        self._last_sign_ns = 0

    def quantized(self, intensity: Shares) -> Shares:
        """Return ``intensity``: any can be set."""
        return intensity

    def open(self) -> None:
        """Connect."""
        self.opened = True
        self.silence()

    def arm(self) -> DeviceStatus:
        """Make pulses possible."""
        if not self.opened:
            raise DeviceError('expected an open device to arm, got a closed one')
        self.intensity, self.armed = 0.0, True
        self._last_sign_ns = self._clock()
        return self.read_back()

    def prepare(self, intensity: float, spare_s: float = math.inf) -> DeviceStatus:
        """Set the intensity of the next pulse."""
        del spare_s
        if self.armed:
            self.intensity = intensity
        status = self.read_back()
        self._last_sign_ns = self._clock()
        return status

    def fire(
        self, intensity: float, width_s: float, latest_ns: int | None = None
    ) -> Delivery | None:
        """Give one pulse."""
        del intensity, width_s
        now_ns = self._clock()
        if latest_ns is not None and now_ns > latest_ns:
            raise TooLate(f'expected a trigger until {latest_ns} ns, got one at {now_ns}')
        if not self.read_back().armed:
            return None
        self._last_sign_ns = now_ns
        return Delivery(now_ns, self.intensity)

    def read_back(self) -> DeviceStatus:
        """Say what is set."""
        if self._clock() - self._last_sign_ns > KEEP_ALIVE_LIMIT_NS:
            self.silence()
        return DeviceStatus(self.armed, self.armed, True, False, False, self.intensity)

    def keep_alive(self) -> DeviceStatus:
        """Note that the driver is there."""
        self._last_sign_ns = self._clock()
        return self.read_back()

    def beat(self) -> None:
        """Do nothing: there is no guard."""

    def rest(self) -> None:
        """Set intensity zero."""
        self.intensity = 0.0

    def silence(self) -> None:
        """Make pulses impossible."""
        self.intensity, self.armed = 0.0, False

    def close(self) -> None:
        """Disarm and close."""
        self.silence()
        self.opened = False


def build(options: DeviceOptions) -> SimulatedDevice:
    """Return a simulated device, which uses no option."""
    del options
    return SimulatedDevice()
