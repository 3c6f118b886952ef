# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated stimulator with the faults that real ones have, and the time that they take."""

import time
from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.registry import Delivery, DeviceError, TooLate, quantized_down
from rpms_ros.stimulation.devices.simulated import SimulatedDevice


@dataclass(frozen=True)
class SimulatedFaults:
    """What a device does wrong, or says of itself in every answer; by default nothing."""

    # probability that a pulse is not given and nothing said about it
    silent_loss: float = 0.0
    # added to the intensity of every pulse
    extra_intensity: float = 0.0
    # set by somebody else on the line, whatever is prepared
    foreign_intensity: float | None = None
    # from the command to the pulse [s]
    slow_s: float = 0.0
    # how long a trigger hangs, interrupted only by silencing [s]
    stuck_s: float = 0.0
    # rise of temperature with every pulse [K]
    heating_per_pulse: float = 0.0
    # pulses after which the device is gone; 0 for never
    vanish_after: int = 0
    coil_absent: bool = False
    replace_coil: bool = False
    error: bool = False
    not_ready: bool = False
    # by itself, at any moment
    disarms: bool = False


@dataclass(frozen=True)
class WireTimes:
    """How long exchanges take [s]: until the pulse, and from it to the answer to its trigger."""

    prepare_s: float = 0.0
    keep_alive_s: float = 0.0
    trigger_s: float = 0.0
    answer_s: float = 0.0


class FaultyDevice(SimulatedDevice):
    """Its faults may be replaced at any time; ``steps`` of intensity, 0 for any."""

    def __init__(self, clock=time.monotonic_ns, wait=time.sleep, wire=None, steps=0):
        super().__init__(clock)
        self.faults, self.fired = SimulatedFaults(), []
        self._wait, self._wire, self._steps = wait, wire or WireTimes(), steps
        self.prepare_s, self.trigger_s = self._wire.prepare_s, self._wire.trigger_s
        self._random = np.random.default_rng(0)
        self._heat, self._count = 0.0, 0

    def quantized(self, intensity):
        return quantized_down(intensity, self._steps) if self._steps else intensity

    def open(self):
        self._require_present()
        super().open()

    def prepare(self, intensity, spare_s=0.0):
        self._require_present()
        self._hang(self._wire.prepare_s)
        return super().prepare(intensity, spare_s)

    def fire(self, intensity, width_s, latest_ns=None):
        del intensity, width_s
        self._require_present()
        began_ns = self._clock()
        if latest_ns is not None and began_ns > latest_ns:
            raise TooLate(f'expected a trigger until {latest_ns} ns, got one at {began_ns}')
        takes_s = self._wire.trigger_s + self.faults.slow_s + self.faults.stuck_s
        self._hang(takes_s)
        status = self.read_back()
        if not status.armed:
            return None
        if status.error or status.replace_coil or not (status.coil_present and status.ready):
            raise DeviceError(f'expected a device in order with a coil, got {status}')
        self._last_sign_ns = self._clock()
        self._count += 1
        if self._random.random() < self.faults.silent_loss:
            return None
        self._heat += self.faults.heating_per_pulse
        # a real one fires by itself, whenever this thread has its next turn
        onset_ns = began_ns + nanoseconds(takes_s)
        given = Delivery(onset_ns, status.intensity + self.faults.extra_intensity)
        self.fired.append(given)
        self._hang(self._wire.answer_s)
        return given

    def read_back(self):
        self._require_present()
        faults = self.faults
        if faults.disarms:
            self.silence()
        status = super().read_back()
        foreign = faults.foreign_intensity
        return status._replace(
            ready=status.armed and not faults.not_ready,
            coil_present=not faults.coil_absent,
            replace_coil=faults.replace_coil,
            error=faults.error,
            intensity=status.intensity if foreign is None else foreign,
            temperature=25.0 + self._heat if faults.heating_per_pulse > 0 else None,
        )

    def keep_alive(self):
        self._require_present()
        self._hang(self._wire.keep_alive_s)
        return super().keep_alive()

    def rest(self):
        self._require_present()
        super().rest()

    def _hang(self, duration):
        end = self._clock() + nanoseconds(duration)
        while self.armed and self._clock() < end:
            self._wait(min(1e-3, (end - self._clock()) / 1e9))

    def _require_present(self):
        if 0 < self.faults.vanish_after <= self._count:
            raise DeviceError('expected an answer from the device, got none: it is gone')
