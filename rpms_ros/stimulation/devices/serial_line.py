# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stimulator of the Rapid2 class on a serial line, behind a guard.

The protocol stands in `rpms_ros.guard.rapid2`, with its sources.  Every answer is checked: a
refusal, a status that contradicts itself, no coil, a coil to be replaced or an error raise, in the
answer in which they show.

This has been tested against a simulated instrument on a pseudo-terminal only.  It has not met
hardware: hold it against the manual of your device before a coil is connected.
"""

import itertools
import math
import time
from collections.abc import Callable

from rpms_ros.guard import rapid2
from rpms_ros.guard.rapid2 import wire_s
from rpms_ros.guard.relay import GuardLimits
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.guarded_line import GuardedLine
from rpms_ros.stimulation.devices.registry import (
    Delivery,
    DeviceError,
    DeviceOptions,
    DeviceStatus,
    Shares,
    TooLate,
    quantized_down,
)

_SECOND = 1_000_000_000
_FOREVER_S = 1e6
_STEPS = 100
# Published: about 1 s to charge.
_CHARGE_S = 3.0
# Published: 10 ms for every percent upwards.
_FROM_ZERO_S = 1.0
# The time that instrument and processes take over an exchange besides the line's.
_TURNAROUND_S = 0.003
_TEMPERATURE_INTERVAL_NS = 2 * _SECOND
_FRAME_LENGTH = 3
# The protocol has no word on whether a trigger gave a pulse; the intensity is read back later.
_UNVERIFIED = frozenset({'delivery', 'intensity'})


class SerialDevice:
    """One stimulator on one serial line.

    Parameters
    ----------
    port : str
        Name of the serial port, e.g. ``/dev/ttyUSB0``.
    maximum_intensity : float
        The guard refuses triggers above it (share), rounded down to a whole percent.
    clock : callable
        Monotonic time [ns].
    timeout_s : float
        How long an answer may take [s].
    beat_limit_s : float
        Longest silence between the driver and its guard, either way [s].
    """

    # a coil hangs on it
    real = True
    # the protocol has no word for it
    sets_width = False
    # to charge, and to begin with a quiet line
    arm_s = _CHARGE_S + 1.0
    # from zero to the largest intensity
    prepare_s = _FROM_ZERO_S
    # the frame of a trigger on the line
    trigger_s = wire_s(_FRAME_LENGTH)

    def __init__(
        self,
        port: str,
        maximum_intensity: float = 1.0,
        clock: Callable[[], int] = time.monotonic_ns,
        timeout_s: float = 0.15,
        beat_limit_s: float = 0.25,
    ) -> None:
        bound = round(_STEPS * quantized_down(maximum_intensity, _STEPS))
        self._line = GuardedLine(port, GuardLimits(bound, beat_limit_s, timeout_s), clock)
        self._clock = clock
        self._parameters_length: int | None = None
        # percent that was asked for
        self._set: int | None = None
        self._armed = False
        self._temperature_ns: int | None = None
        # a silence in the middle of a call shows as another number
        self._silences = itertools.count(1)
        self._silenced = 0
        self._answered_silences = 0

    @property
    def read_back_s(self) -> float:
        """Time that reading the intensity back takes [s]; endless for one without a version."""
        length = self._parameters_length
        return math.inf if length is None else wire_s(_FRAME_LENGTH + length) + _TURNAROUND_S

    @property
    def guard_pid(self) -> int | None:
        """Process of the guard, None if there is none."""
        return self._line.guard_pid

    def quantized(self, intensity: Shares) -> Shares:
        """Return the largest whole percents that are not above ``intensity`` (share)."""
        return quantized_down(intensity, _STEPS)

    def open(self) -> None:
        """Start a guard, take remote control, intensity zero, disarmed; or hold nothing."""
        self._line.open()
        try:
            self._begin()
            version = self._line.exchange(rapid2.VERSION, rapid2.UNTIL_ZERO)
            self._parameters_length = _length_of_parameters(version.answer if version else b'')
            self._set_percent(0)
            if self.read_back().intensity:
                raise DeviceError('expected intensity 0 % in the device, got more')
        except BaseException:
            self._line.close()
            raise

    def arm(self) -> DeviceStatus:
        """Charge, at intensity zero; return when the instrument says armed and ready."""
        self._begin()
        self._refuse_what_is_wrong(self._set_percent(0), armed=False)
        self._ask(rapid2.ARM)
        end = self._clock() + nanoseconds(_CHARGE_S)
        while True:
            status = self._ask(rapid2.ENABLE)
            self._refuse_what_is_wrong(status, armed=False)
            if status & rapid2.READY:
                self._armed = True
                return self._status_of(status)
            if self._clock() > end:
                self.silence()
                raise DeviceError(
                    f'expected a device that is ready within {_CHARGE_S:g} s, '
                    f'got status {status:#04x}'
                )

    def prepare(self, intensity: float, spare_s: float = math.inf) -> DeviceStatus | None:
        """Set the intensity of the next pulse, again also if it is the same.

        At 9600 baud that takes 8 ms; the temperature, which is due every 2 s, 16 ms more, and is
        left out where it does not fit into ``spare_s``.
        """
        if self._is_silenced:
            return None
        end = self._clock() + round(min(spare_s, _FOREVER_S) * _SECOND)
        percent = round(_STEPS * self.quantized(intensity))
        status = self._set_percent(percent)
        temperature = None
        if self._temperature_is_due and self._fits(rapid2.TEMPERATURE_LENGTH, end):
            temperature = self._read_temperature()
        self._refuse_what_is_wrong(status, self._armed)
        return self._status_of(status, temperature)

    def fire(
        self, intensity: float, width_s: float, latest_ns: int | None = None
    ) -> Delivery | None:
        """Trigger; the device has one width, the only one of its specification."""
        del intensity, width_s
        percent = self._set
        if self._is_silenced:
            return None
        if percent is None or not self._armed:
            raise DeviceError('expected an armed device with an intensity, got none')
        reply = self._line.exchange(rapid2.TRIGGER, rapid2.STATUS_LENGTH, latest_ns)
        if reply is None:
            raise TooLate('expected a trigger to be written in time, got it too late')
        status = self._checked(rapid2.TRIGGER, reply.answer, rapid2.STATUS_LENGTH).status
        self._refuse_what_is_wrong(status, armed=True)
        if not status & rapid2.READY:
            raise DeviceError(f'expected a ready device, got status {status:#04x}')
        onset_ns = reply.written_ns + nanoseconds(self.trigger_s)
        return Delivery(onset_ns, percent / _STEPS, _UNVERIFIED)

    def read_back(self) -> DeviceStatus:
        """Read the intensity back; one that is not what was set silences the device at once."""
        if self._is_silenced or self._parameters_length is None:
            return DeviceStatus()
        answer = self._checked_exchange(rapid2.PARAMETERS, self._parameters_length)
        found = _checked_number(rapid2.set_percent, answer.data)
        if found != self._set:
            self.silence()
        else:
            self._refuse_what_is_wrong(answer.status, self._armed)
        return self._status_of(answer.status)._replace(intensity=found / _STEPS)

    def keep_alive(self) -> DeviceStatus:
        """Ask for the status, and every 2 s for the temperature.

        After a silence this begins anew on the line, and makes sure that the device is disarmed.
        """
        before = self._silenced
        try:
            if self._is_silenced:
                self._begin()
            status = self._ask(rapid2.ENABLE)
            temperature = self._read_temperature() if self._temperature_is_due else None
        except DeviceError:
            # silenced meanwhile, by another thread: nothing is wrong with the device
            if self._silenced != before:
                return DeviceStatus()
            raise
        # a disarmed device may have its coil changed
        if self._armed:
            self._refuse_what_is_wrong(status, armed=True)
        return self._status_of(status, temperature)

    def beat(self) -> None:
        """Tell the guard that the driver is alive; raise if the guard is not, or has disarmed."""
        if not self._is_silenced:
            self._line.beat()

    def rest(self) -> None:
        """Set intensity zero."""
        if not self._is_silenced:
            self._set_percent(0)

    def silence(self) -> None:
        """Set intensity zero, then disarm; written at once, no answer is waited for."""
        self._silenced = next(self._silences)
        if not self._line.silence():
            raise DeviceError('expected a line that takes a silence, got one that does not')

    def close(self) -> None:
        """Disarm, give back remote control, release the port."""
        self._silenced = next(self._silences)
        self._armed, self._set = False, None
        self._line.close()

    # ---- the line

    @property
    def _is_silenced(self) -> bool:
        return self._silenced != self._answered_silences

    def _begin(self) -> None:
        """Start again on a quiet line: remote control, disarmed."""
        self._armed, self._set = False, None
        silenced = self._silenced
        self._line.listen()
        self._ask(rapid2.ENABLE)
        # the second answer has the status after the first command
        self._ask(rapid2.DISARM)
        status = self._ask(rapid2.DISARM)
        if status & (rapid2.ARMED | rapid2.READY):
            raise DeviceError(f'expected a device that disarms, got status {status:#04x}')
        # one that came meanwhile still counts
        self._answered_silences = silenced

    def _set_percent(self, percent: int) -> int:
        """Set an intensity; return the status."""
        self._set = None
        status = self._ask(rapid2.power(percent))
        self._set = percent
        return status

    def _fits(self, answer_length: int, end_ns: int) -> bool:
        """Whether an exchange is over before a moment [ns]."""
        needed_s = wire_s(_FRAME_LENGTH + answer_length) + _TURNAROUND_S
        return self._clock() + needed_s * _SECOND <= end_ns

    @property
    def _temperature_is_due(self) -> bool:
        last = self._temperature_ns
        return last is None or self._clock() - last >= _TEMPERATURE_INTERVAL_NS

    def _read_temperature(self) -> float:
        answer = self._checked_exchange(rapid2.TEMPERATURE, rapid2.TEMPERATURE_LENGTH)
        temperature = _checked_number(rapid2.celsius, answer.data)
        self._temperature_ns = self._clock()
        return temperature

    def _ask(self, command: bytes) -> int:
        """Send a command; return the status in its answer."""
        return self._checked_exchange(command, rapid2.STATUS_LENGTH).status

    def _checked_exchange(self, command: bytes, length: int) -> rapid2.Answer:
        reply = self._line.exchange(command, length)
        return self._checked(command, b'' if reply is None else reply.answer, length)

    def _checked(self, command: bytes, answer: bytes, length: int) -> rapid2.Answer:
        try:
            return rapid2.parsed(command, answer, length)
        except ValueError as error:
            raise DeviceError(str(error)) from error

    def _refuse_what_is_wrong(self, status: int, armed: bool) -> None:
        wrong = []
        if not status & rapid2.COIL_PRESENT:
            wrong.append('no coil')
        if status & rapid2.REPLACE_COIL:
            wrong.append('a coil to be replaced')
        if status & rapid2.ERROR:
            wrong.append('an error')
        if armed and not status & (rapid2.ARMED | rapid2.READY):
            wrong.append('a device that has disarmed by itself')
        if wrong:
            self.silence()
            raise DeviceError(
                f'expected a device in order with a coil, got {", ".join(wrong)}: '
                f'status {status:#04x}'
            )

    def _status_of(self, status: int, temperature: float | None = None) -> DeviceStatus:
        return DeviceStatus(
            armed=bool(status & (rapid2.ARMED | rapid2.READY)),
            ready=bool(status & rapid2.READY),
            coil_present=bool(status & rapid2.COIL_PRESENT),
            replace_coil=bool(status & rapid2.REPLACE_COIL),
            error=bool(status & rapid2.ERROR),
            temperature=temperature,
        )


def _length_of_parameters(answer: bytes) -> int | None:
    """Return how long the answer with the intensity is; None if the device has no version."""
    try:
        return rapid2.parameters_length(rapid2.version_of(answer))
    except ValueError as error:
        if b'?' in answer[:2] or b'S' in answer[:2]:
            return None
        raise DeviceError(str(error)) from error


def _checked_number(read: Callable[[bytes], float], data: bytes) -> float:
    try:
        return read(data)
    except ValueError as error:
        raise DeviceError(str(error)) from error


def build(options: DeviceOptions) -> SerialDevice:
    """Return the device that a driver's options describe."""
    return SerialDevice(options.port, options.maximum_intensity)
