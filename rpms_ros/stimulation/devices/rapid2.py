# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stimulator of the Rapid2 class on a serial line, behind a guard.

The protocol stands in `rpms_ros.guard.rapid2_protocol`, with its sources.  Every answer is
checked: a refusal, a status that contradicts itself, no coil, a coil to be replaced or an error
raise, in the answer in which they show.

This has been tested against a simulated instrument on a pseudo-terminal only.  It has not met
hardware: hold it against the manual of your device before a coil is connected.
"""

import contextlib
import fcntl
import itertools
import math
import os
import select
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import NoReturn, TypeVar

import serial

import rpms_ros.guard
from rpms_ros.guard import packets, rapid2_protocol as rapid2
from rpms_ros.guard.packets import Packet
from rpms_ros.guard.rapid2_protocol import wire_s
from rpms_ros.guard.relay import GuardLimits, LineError, write_silence
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

Read = TypeVar('Read')

_SECOND = 1_000_000_000
_STEPS = 100
# Published: about 1 s to charge.
_CHARGE_S = 3.0
# The time that instrument and processes take over an exchange besides the line's.
_TURNAROUND_S = 0.003
_TEMPERATURE_INTERVAL_NS = 2 * _SECOND
_FRAME_LENGTH = 3
# A trigger would give a pulse.
_ABLE = rapid2.ARMED | rapid2.READY
# The protocol has no word on whether a trigger gave a pulse; the intensity is read back later.
_UNVERIFIED = frozenset({'delivery', 'intensity'})


def open_port(name: str) -> int:
    """Return the descriptor of a serial port, opened exclusively with the instrument's settings.

    Raises
    ------
    OSError
        If there is no such port, or somebody holds it.
    """
    port = serial.Serial(baudrate=rapid2.BAUD, timeout=0, write_timeout=0, exclusive=True)
    port.port = name
    # on some cables this line is a trigger
    port.rts = False
    try:
        port.open()
        # a lock is asked for by who knows of it; this keeps the others out, but for root
        with contextlib.suppress(OSError):
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
        port.reset_input_buffer()
        # a copy: it shares the lock, and stays when the object goes
        descriptor = os.dup(port.fileno())
    except (ValueError, termios.error) as error:
        raise OSError(str(error)) from error
    finally:
        port.close()
    os.set_blocking(descriptor, False)
    return descriptor


class Descriptor:
    """A descriptor that is closed when no thread holds it any more.

    `silence` uses one while another thread closes the line: without a lock, which it would have
    to wait for, it must not write to a number that meanwhile stands for something else.
    """

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self.number)


# A process has to start, on a machine that may be busy.
_START_S = 10.0
# The guard waits for the end of noise, at most 0.5 s, and disarms, at most 0.5 s.
_LISTEN_S = 2.0
_LEAVE_S = 2.0


class GuardedLine:
    """Exchanges through a guard, and the driver's own way to silence the instrument.

    Every method but `silence` belongs to one thread.

    Parameters
    ----------
    port : str
        A serial port; a guard is started for it.
    limits : GuardLimits
        What the guard that is started holds this driver to.
    """

    def __init__(self, port: str, limits: GuardLimits) -> None:
        self.port, self.limits = port, limits
        self._guard: subprocess.Popen[bytes] | None = None
        self._line: Descriptor | None = None
        self._socket: Descriptor | None = None
        self._sequence = 0
        # the oldest beat that was not answered
        self._unheard_ns: int | None = None

    def open(self) -> None:
        """Take the port, start its guard; nothing is held if it fails.

        Raises
        ------
        DeviceError
            If the port is not there or is held by somebody, or no guard comes up.
        """
        if self._line is not None:
            raise DeviceError(f'expected {self.port} to be closed, got an open one')
        try:
            self._start_guard()
        except (OSError, ValueError) as error:
            self.close()
            raise DeviceError(f'expected a serial port, got {self.port}: {error}') from error
        except DeviceError:
            self.close()
            raise
        self._unheard_ns = None

    def exchange(
        self, command: bytes, length: int, latest_ns: int = packets.FOREVER_NS
    ) -> Packet | None:
        """Send a command; return its answer, None if it could not be written in time.

        The answer, checked for nothing but its length, is the payload; ``time_ns`` is when the
        guard wrote the command.

        Raises
        ------
        DeviceError
            If the guard refuses it, or the instrument or the guard does not answer.
        """
        payload = bytes([length]) + rapid2.framed(command)
        sequence = self._send(packets.EXCHANGE, payload, latest_ns)
        name = command.decode('latin-1')
        packet = self._answer_to(sequence, self.limits.answer_limit_s, f'an answer to {name}')
        return None if packet.kind == packets.LATE else packet

    def listen(self) -> None:
        """Begin anew after a silence: what was still on the line is forgotten.

        Raises
        ------
        DeviceError
            If the line does not become quiet.
        """
        self._answer_to(self._send(packets.LISTEN), _LISTEN_S, 'a quiet line')

    def beat(self) -> None:
        """Tell the guard that this driver is alive, and look whether the guard is.

        Raises
        ------
        DeviceError
            If it is not, or has disarmed by itself.
        """
        if self._socket is None:
            return
        self._send(packets.BEAT)
        if self._unheard_ns is None:
            self._unheard_ns = time.monotonic_ns()
        while (packet := self._received(0.0)) is not None:
            self._note(packet)
        limit_s = self.limits.beat_limit_s
        unheard_ns = self._unheard_ns
        if unheard_ns is not None and time.monotonic_ns() - unheard_ns > limit_s * _SECOND:
            self._fail(f'expected a sign of life of the guard within {limit_s:g} s, got none')

    def silence(self) -> bool:
        """Write intensity zero and disarm, by any thread; whether it was taken.

        Twice: through the guard, which refuses everything from then on, and past it, since it may
        be stopped or dead.  No answer is waited for; while the guard writes to the port, the
        kernel refuses the second one, which is tried for up to 50 ms then.
        """
        line, guard = self._line, self._socket
        if guard is not None:
            with contextlib.suppress(OSError):
                os.write(guard.number, packets.packed(Packet(packets.SILENCE)))
        if line is not None:
            try:
                write_silence(line.number, rapid2.SILENCE)
            except LineError:
                return False
        return True

    def close(self) -> None:
        """Let the guard disarm, give back remote control and release the port."""
        line, guard, process = self._line, self._socket, self._guard
        if line is not None:
            self.silence()
        if guard is not None:
            with contextlib.suppress(OSError):
                os.write(guard.number, packets.packed(Packet(packets.LEAVE)))
        if process is not None:
            try:
                process.wait(_LEAVE_S)
            except subprocess.TimeoutExpired:
                # stopped, or it would have gone: what it had to do was done past it
                process.kill()
                process.wait()
        self._line = self._socket = self._guard = None
        if line is not None:
            # others may open the port again; the lock ends with its last descriptor
            with contextlib.suppress(OSError):
                fcntl.ioctl(line.number, termios.TIOCNXCL)

    # ---- the guard

    def _start_guard(self) -> None:
        self._line = Descriptor(open_port(self.port))
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self._socket = Descriptor(ours.detach())
        descriptors = self._line.number, theirs.fileno()
        with theirs:
            # Isolated and without site: nothing of an environment runs in it.  In a session of
            # its own: a signal to the driver's group does not reach it.
            self._guard = subprocess.Popen(
                [
                    *(sys.executable, '-I', '-S', str(Path(rpms_ros.guard.__file__).parent)),
                    *map(str, (*descriptors, *astuple(self.limits))),
                ],
                pass_fds=descriptors,
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        hello = self._received(_START_S)
        if hello is None or hello.kind != packets.HELLO:
            raise DeviceError(f'expected a guard within {_START_S:g} s, got {hello}')

    # ---- packets

    def _opened(self) -> Descriptor:
        if self._socket is None:
            raise DeviceError('expected an open serial line, got a closed one')
        return self._socket

    def _send(self, kind: bytes, payload: bytes = b'', time_ns: int = 0) -> int:
        guard = self._opened()
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        try:
            os.write(guard.number, packets.packed(Packet(kind, self._sequence, time_ns, payload)))
        except OSError as error:
            self._fail(f'expected a guard to send to, got {error}')
        return self._sequence

    def _answer_to(self, sequence: int, limit_s: float, what: str) -> Packet:
        end = time.monotonic() + limit_s
        while True:
            packet = self._received(max(0.0, end - time.monotonic()))
            if packet is None:
                self._fail(f'expected {what} within {limit_s:g} s, got none')
            # whatever comes from it is a sign of life
            self._unheard_ns = None
            if packet.sequence == sequence:
                if packet.kind == packets.REFUSED:
                    raise DeviceError(packet.payload.decode('utf-8', 'replace'))
                return packet
            self._note(packet)

    def _note(self, packet: Packet) -> None:
        """Take a packet that no call waits for."""
        self._unheard_ns = None
        if packet.kind == packets.DISARMED:
            self.silence()
            raise DeviceError(packet.payload.decode('utf-8', 'replace'))

    def _received(self, limit_s: float) -> Packet | None:
        guard = self._opened()
        poll = select.poll()
        poll.register(guard.number, select.POLLIN)
        if not poll.poll(limit_s * 1000):
            return None
        try:
            raw = os.read(guard.number, packets.MAXIMUM_PACKET)
            if not raw:
                self._fail('expected a guard that lives, got its end')
            return packets.unpacked(raw, packets.FROM_GUARD)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            self._fail(f'expected a packet of the guard, got {error}')

    def _fail(self, reason: str) -> NoReturn:
        """Silence the instrument past the guard."""
        self.silence()
        raise DeviceError(reason)


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
    # from zero to the largest intensity; published: 10 ms for every percent upwards
    prepare_s = 1.0
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
        self._line = GuardedLine(port, GuardLimits(bound, beat_limit_s, timeout_s))
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
        return math.inf if length is None else _exchange_s(length)

    def quantized(self, intensity: Shares) -> Shares:
        """Return the largest whole percents that are not above ``intensity`` (share)."""
        return quantized_down(intensity, _STEPS)

    def open(self) -> None:
        """Start a guard, take remote control, intensity zero, disarmed; or hold nothing."""
        self._line.open()
        try:
            self._begin()
            version = self._line.exchange(rapid2.VERSION, rapid2.UNTIL_ZERO)
            self._parameters_length = _length_of_parameters(version.payload if version else b'')
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
                fault = f'expected a device that is ready within {_CHARGE_S:g} s'
                raise DeviceError(f'{fault}, got status {status:#04x}')

    def prepare(self, intensity: float, spare_s: float = math.inf) -> DeviceStatus | None:
        """Set the intensity of the next pulse, again also if it is the same.

        At 9600 baud that takes 8 ms; the temperature, which is due every 2 s, 16 ms more, and is
        left out where it does not fit into ``spare_s``.
        """
        if self._is_silenced:
            return None
        end_ns = self._clock() + spare_s * _SECOND
        status = self._set_percent(round(_STEPS * self.quantized(intensity)))
        temperature = self._temperature(end_ns)
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
        latest_ns = packets.FOREVER_NS if latest_ns is None else latest_ns
        reply = self._line.exchange(rapid2.TRIGGER, rapid2.STATUS_LENGTH, latest_ns)
        if reply is None:
            raise TooLate('expected a trigger to be written in time, got it too late')
        answer = rapid2.TRIGGER, reply.payload, rapid2.STATUS_LENGTH
        status = _checked(rapid2.parsed, *answer).status
        self._refuse_what_is_wrong(status, armed=True)
        if not status & rapid2.READY:
            raise DeviceError(f'expected a ready device, got status {status:#04x}')
        return Delivery(reply.time_ns + nanoseconds(self.trigger_s), percent / _STEPS, _UNVERIFIED)

    def read_back(self) -> DeviceStatus:
        """Read the intensity back; one that is not what was set silences the device at once."""
        if self._is_silenced or self._parameters_length is None:
            return DeviceStatus()
        answer = self._exchange(rapid2.PARAMETERS, self._parameters_length)
        found = _checked(rapid2.set_percent, answer.data)
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
            temperature = self._temperature()
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
        # of what began between the two nothing is known either
        self._silenced = next(self._silences)

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
        if status & _ABLE:
            raise DeviceError(f'expected a device that disarms, got status {status:#04x}')
        # one that came meanwhile still counts
        self._answered_silences = silenced

    def _set_percent(self, percent: int) -> int:
        """Set an intensity; return the status."""
        self._set = None
        status = self._ask(rapid2.power(percent))
        self._set = percent
        return status

    def _temperature(self, end_ns: float = math.inf) -> float | None:
        """Read the temperature if that is due and takes no longer than until ``end_ns`` [ns]."""
        now, last = self._clock(), self._temperature_ns
        due = last is None or now - last >= _TEMPERATURE_INTERVAL_NS
        if not due or now + _exchange_s(rapid2.TEMPERATURE_LENGTH) * _SECOND > end_ns:
            return None
        answer = self._exchange(rapid2.TEMPERATURE, rapid2.TEMPERATURE_LENGTH)
        temperature = _checked(rapid2.celsius, answer.data)
        self._temperature_ns = self._clock()
        return temperature

    def _ask(self, command: bytes) -> int:
        """Send a command; return the status in its answer."""
        return self._exchange(command, rapid2.STATUS_LENGTH).status

    def _exchange(self, command: bytes, length: int) -> rapid2.Answer:
        reply = self._line.exchange(command, length)
        return _checked(rapid2.parsed, command, reply.payload if reply else b'', length)

    def _refuse_what_is_wrong(self, status: int, armed: bool) -> None:
        said = {
            'no coil': not status & rapid2.COIL_PRESENT,
            'a coil to be replaced': status & rapid2.REPLACE_COIL,
            'an error': status & rapid2.ERROR,
            'a device that has disarmed by itself': armed and not status & _ABLE,
        }
        if wrong := ', '.join(name for name, is_wrong in said.items() if is_wrong):
            self.silence()
            fault = f'expected a device in order with a coil, got {wrong}: status {status:#04x}'
            raise DeviceError(fault)

    def _status_of(self, status: int, temperature: float | None = None) -> DeviceStatus:
        bits = _ABLE, rapid2.READY, rapid2.COIL_PRESENT, rapid2.REPLACE_COIL, rapid2.ERROR
        said = DeviceStatus(*(bool(status & bit) for bit in bits))
        return said._replace(temperature=temperature)


def _exchange_s(answer_length: int) -> float:
    """Return how long it takes to get an answer of so many bytes [s]."""
    return wire_s(_FRAME_LENGTH + answer_length) + _TURNAROUND_S


def _length_of_parameters(answer: bytes) -> int | None:
    """Return how long the answer with the intensity is; None if the device has no version."""
    try:
        return rapid2.parameters_length(rapid2.version_of(answer))
    except ValueError as error:
        if b'?' in answer[:2] or b'S' in answer[:2]:
            return None
        raise DeviceError(str(error)) from error


def _checked(read: Callable[..., Read], *given: object) -> Read:
    """Read an answer; what is wrong with it is a fault of the device."""
    try:
        return read(*given)
    except ValueError as error:
        raise DeviceError(str(error)) from error


def build(options: DeviceOptions) -> SerialDevice:
    """Return the device that a driver's options describe."""
    return SerialDevice(options.port, options.maximum_intensity)
