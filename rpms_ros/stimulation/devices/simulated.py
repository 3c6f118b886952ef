# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stimulator that exists only as a program, with the faults that real ones have."""

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.registry import (
    Delivery,
    DeviceError,
    DeviceOptions,
    DeviceStatus,
    Shares,
    TooLate,
    quantized_down,
)
from rpms_ros.stimulation.schedule.fields import Bound, Bounded, bounded, share

_SECONDS = Bound(0.0, 60.0, 's')
# A device that listens every 0.5 s allows one message to be lost.
KEEP_ALIVE_LIMIT_NS = 1_100_000_000


@dataclass(frozen=True)
class SimulatedFaults(Bounded):
    """What a simulated device does wrong; by default nothing.

    Attributes
    ----------
    silent_loss : float
        Probability that a pulse is not given and nothing said about it.
    extra_intensity : float
        Added to the intensity of every pulse (share).
    foreign_intensity : float or None
        Set by somebody else on the line, whatever is prepared (share).
    slow_s : float
        Delay from the command to the pulse [s].
    stuck_s : float
        How long a trigger hangs, interrupted only by silencing [s].
    heating_per_pulse : float
        Rise of temperature with every pulse [K].
    vanish_after : int
        Pulses after which the device is gone; 0 for never.
    coil_absent, replace_coil, error, not_ready : bool
        What it says of itself, in every answer.
    disarms : bool
        Whether it disarms by itself, at any moment.
    """

    silent_loss: float = share(0.0)
    extra_intensity: float = bounded(Bound(-1.0, 1.0), 0.0)
    foreign_intensity: float | None = bounded(Bound(0.0, 1.0, optional=True), None)
    slow_s: float = bounded(_SECONDS, 0.0)
    stuck_s: float = bounded(_SECONDS, 0.0)
    heating_per_pulse: float = bounded(Bound(0.0, 100.0, 'K'), 0.0)
    vanish_after: int = bounded(Bound(0, 10_000_000, whole=True), 0)
    coil_absent: bool = False
    replace_coil: bool = False
    error: bool = False
    not_ready: bool = False
    disarms: bool = False


@dataclass(frozen=True)
class WireTimes(Bounded):
    """How long the exchanges of a simulated device take; by default no time.

    Attributes
    ----------
    prepare_s, keep_alive_s : float
        From the call to the answer [s].
    trigger_s : float
        From the call of a trigger to the pulse [s].
    answer_s : float
        From the pulse to the answer to its trigger [s].
    """

    prepare_s: float = bounded(_SECONDS, 0.0)
    keep_alive_s: float = bounded(_SECONDS, 0.0)
    trigger_s: float = bounded(_SECONDS, 0.0)
    answer_s: float = bounded(_SECONDS, 0.0)


class SimulatedDevice:
    """Counts pulses and gives none.

    Parameters
    ----------
    faults : SimulatedFaults
        What it does wrong; may be replaced at any time.
    clock : callable
        Monotonic time [ns].
    wait : callable
        Waits for a duration [s]; silencing cannot be waited for in another way in a test.
    seed : int
        Of its losses.
    wire : WireTimes
        How long it takes over everything.
    steps : int
        How many intensities above zero it can be set to; 0 for any.
    """

    # nobody can be hurt; any width is taken; every answer tells the intensity
    real = False
    sets_width = True
    arm_s = 0.0
    read_back_s = math.inf

    def __init__(
        self,
        faults: SimulatedFaults | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        wait: Callable[[float], None] = time.sleep,
        seed: int = 0,
        wire: WireTimes | None = None,
        steps: int = 0,
    ) -> None:
        self.faults = faults or SimulatedFaults()
        self.opened = False
        self.armed = False
        self.intensity = 0.0
        # the last ones only: a session has no end
        self.fired: deque[Delivery] = deque(maxlen=10_000)
        self._clock = clock
        self._wait = wait
        self._random = np.random.default_rng(seed)
        self._wire = wire or WireTimes()
        self.prepare_s, self.trigger_s = self._wire.prepare_s, self._wire.trigger_s
        self._steps = steps
        self._last_sign_ns = 0
        self._heat = 0.0
        self._count = 0

    def quantized(self, intensity: Shares) -> Shares:
        """Return the largest steps that are not above ``intensity``."""
        return quantized_down(intensity, self._steps) if self._steps else intensity

    def open(self) -> None:
        """Connect."""
        self._require_present()
        self.opened = True
        self.silence()

    def arm(self) -> DeviceStatus:
        """Make pulses possible."""
        self._require_present()
        if not self.opened:
            raise DeviceError('expected an open device to arm, got a closed one')
        self._last_sign_ns = self._clock()
        self.intensity, self.armed = 0.0, True
        return self._status()

    def prepare(self, intensity: float, spare_s: float = math.inf) -> DeviceStatus:
        """Set the intensity of the next pulse."""
        del spare_s
        self._require_present()
        self._hang(self._wire.prepare_s)
        if self.armed:
            self.intensity = intensity
        status = self._status()
        self._last_sign_ns = self._clock()
        return status

    def fire(
        self, intensity: float, width_s: float, latest_ns: int | None = None
    ) -> Delivery | None:
        """Give one pulse, or do what the faults say."""
        del intensity, width_s
        self._require_present()
        began_ns = self._clock()
        if latest_ns is not None and began_ns > latest_ns:
            raise TooLate(f'expected a trigger until {latest_ns} ns, got one at {began_ns}')
        takes_s = self._wire.trigger_s + self.faults.slow_s + self.faults.stuck_s
        self._hang(takes_s)
        status = self._status()
        if not status.armed:
            return None
        if status.error or status.replace_coil or not (status.coil_present and status.ready):
            raise DeviceError(f'expected a device in order with a coil, got {status}')
        self._last_sign_ns = self._clock()
        self._count += 1
        if self.faults.silent_loss > 0 and self._random.random() < self.faults.silent_loss:
            return None
        self._heat += self.faults.heating_per_pulse
        strength = status.intensity or 0.0
        # a real one fires by itself, whenever this thread has its next turn
        onset_ns = began_ns + nanoseconds(takes_s)
        given = Delivery(onset_ns, strength + self.faults.extra_intensity)
        self.fired.append(given)
        self._hang(self._wire.answer_s)
        return given

    def read_back(self) -> DeviceStatus:
        """Say what is set."""
        self._require_present()
        return self._status()

    def keep_alive(self) -> DeviceStatus:
        """Note that the driver is there."""
        self._require_present()
        self._hang(self._wire.keep_alive_s)
        self._last_sign_ns = self._clock()
        return self._status()

    def beat(self) -> None:
        """Do nothing: there is no guard."""

    def rest(self) -> None:
        """Set intensity zero."""
        self._require_present()
        self.intensity = 0.0

    def silence(self) -> None:
        """Make pulses impossible."""
        self.intensity, self.armed = 0.0, False

    def close(self) -> None:
        """Disarm and close."""
        self.silence()
        self.opened = False

    def _status(self) -> DeviceStatus:
        unheard = self._clock() - self._last_sign_ns > KEEP_ALIVE_LIMIT_NS
        faults = self.faults
        if unheard or faults.disarms:
            self.silence()
        foreign = faults.foreign_intensity
        return DeviceStatus(
            armed=self.armed,
            ready=self.armed and not faults.not_ready,
            coil_present=not faults.coil_absent,
            replace_coil=faults.replace_coil,
            error=faults.error,
            intensity=self.intensity if foreign is None else foreign,
            temperature=25.0 + self._heat if faults.heating_per_pulse > 0 else None,
        )

    def _hang(self, duration: float) -> None:
        end = self._clock() + nanoseconds(duration)
        while self.armed and self._clock() < end:
            self._wait(min(1e-3, (end - self._clock()) / 1e9))

    def _require_present(self) -> None:
        if 0 < self.faults.vanish_after <= self._count:
            raise DeviceError('expected an answer from the device, got none: it is gone')


def build(options: DeviceOptions) -> SimulatedDevice:
    """Return a simulated device, which uses no option."""
    del options
    return SimulatedDevice()
