# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver's end of a serial line that a guard holds.

A descriptor that several threads hold and none of them closes while another uses it.
"""

import contextlib
import fcntl
import os
import select
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, NoReturn

import serial

import rpms_ros.guard
from rpms_ros.guard import packets, rapid2
from rpms_ros.guard.packets import Packet
from rpms_ros.guard.relay import GuardLimits, LineError, write_silence
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.registry import DeviceError


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


_SECOND = 1_000_000_000
# A process has to start, on a machine that may be busy.
_START_S = 10.0
# The guard waits for the end of noise, at most 0.5 s, and disarms, at most 0.5 s.
_LISTEN_S = 2.0
_LEAVE_S = 2.0
# Beats that are this close together say nothing more.
_BEAT_INTERVAL_NS = 20_000_000


class Reply(NamedTuple):
    """An answer of the instrument.

    Attributes
    ----------
    answer : bytes
        As it came, checked for nothing but its length.
    written_ns : int
        When the guard wrote the command [ns].
    """

    answer: bytes
    written_ns: int


class GuardedLine:
    """Exchanges through a guard, and the driver's own way to silence the instrument.

    Every method but `silence` belongs to one thread.

    Parameters
    ----------
    port : str
        A serial port; a guard is started for it.
    limits : GuardLimits
        What the guard that is started holds this driver to.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self,
        port: str,
        limits: GuardLimits,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.port = port
        self.limits = limits
        self.guard_pid: int | None = None
        self._clock = clock
        self._guard: subprocess.Popen[bytes] | None = None
        self._line: Descriptor | None = None
        self._socket: Descriptor | None = None
        self._sequence = 0
        self._beat_ns = 0
        # the oldest beat that was not answered
        self._unheard_ns: int | None = None

    @property
    def is_open(self) -> bool:
        """Whether there is a line."""
        return self._line is not None

    def open(self) -> None:
        """Take the port, start its guard; nothing is held if it fails.

        Raises
        ------
        DeviceError
            If the port is not there or is held by somebody, or no guard comes up.
        """
        if self.is_open:
            raise DeviceError(f'expected {self.port} to be closed, got an open one')
        try:
            self._start_guard()
        except (OSError, ValueError) as error:
            self.close()
            raise DeviceError(f'expected a serial port, got {self.port}: {error}') from error
        except DeviceError:
            self.close()
            raise
        self._beat_ns, self._unheard_ns = 0, None

    def exchange(self, command: bytes, length: int, latest_ns: int | None = None) -> Reply | None:
        """Send a command; return its answer, None if it could not be written in time.

        Raises
        ------
        DeviceError
            If the guard refuses it, or the instrument or the guard does not answer.
        """
        sequence = self._send(
            packets.EXCHANGE,
            bytes([length]) + rapid2.framed(command),
            packets.FOREVER_NS if latest_ns is None else latest_ns,
        )
        name = command.decode('latin-1')
        packet = self._answer_to(sequence, self.limits.answer_limit_s, f'an answer to {name}')
        return None if packet.kind == packets.LATE else Reply(packet.payload, packet.time_ns)

    def listen(self) -> None:
        """Begin anew after a silence: what was still on the line is forgotten.

        Raises
        ------
        DeviceError
            If the line does not become quiet.
        """
        sequence = self._send(packets.LISTEN)
        self._answer_to(sequence, _LISTEN_S, 'a quiet line')

    def beat(self) -> None:
        """Tell the guard that this driver is alive, and look whether the guard is.

        Raises
        ------
        DeviceError
            If it is not, or has disarmed by itself.
        """
        if self._socket is None:
            return
        now = self._clock()
        if now - self._beat_ns < _BEAT_INTERVAL_NS:
            return
        self._beat_ns = now
        self._send(packets.BEAT)
        if self._unheard_ns is None:
            self._unheard_ns = now
        while (packet := self._received(0.0)) is not None:
            self._note(packet)
        limit_s = self.limits.beat_limit_s
        if self._unheard_ns is not None and self._clock() - self._unheard_ns > limit_s * _SECOND:
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
        left = True
        if guard is not None:
            with contextlib.suppress(OSError):
                os.write(guard.number, packets.packed(Packet(packets.LEAVE)))
            left = self._has_left(guard)
        self._line = self._socket = self._guard = self.guard_pid = None
        if line is not None:
            # others may open the port again; the lock ends with its last descriptor
            with contextlib.suppress(OSError):
                fcntl.ioctl(line.number, termios.TIOCNXCL)
        if process is not None:
            if not left:
                # stopped, or it would have gone: what it had to do was done past it
                process.kill()
            try:
                process.wait(_LEAVE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    # ---- the guard

    def _start_guard(self) -> None:
        self._line = Descriptor(open_port(self.port))
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self._socket = Descriptor(ours.detach())
        limits = self.limits
        with theirs:
            # Isolated and without site: nothing of an environment runs in it.  In a session of
            # its own: a signal to the driver's group does not reach it.
            self._guard = subprocess.Popen(
                [
                    sys.executable,
                    '-I',
                    '-S',
                    str(Path(rpms_ros.guard.__file__).parent),
                    f'--line-descriptor={self._line.number}',
                    f'--driver-descriptor={theirs.fileno()}',
                    f'--maximum-percent={limits.maximum_percent}',
                    f'--beat-limit={limits.beat_limit_s}',
                    f'--answer-limit={limits.answer_limit_s}',
                    f'--keep-alive={limits.keep_alive_s}',
                ],
                pass_fds=(self._line.number, theirs.fileno()),
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        self.guard_pid = self._guard.pid
        hello = self._received(_START_S)
        if hello is None or hello.kind != packets.HELLO:
            raise DeviceError(f'expected a guard within {_START_S:g} s, got {hello}')

    # ---- packets

    def _send(self, kind: bytes, payload: bytes = b'', time_ns: int = 0) -> int:
        guard = self._socket
        if guard is None:
            raise DeviceError('expected an open serial line, got a closed one')
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        try:
            os.write(guard.number, packets.packed(Packet(kind, self._sequence, time_ns, payload)))
        except OSError as error:
            self._fail(f'expected a guard to send to, got {error}')
        return self._sequence

    def _answer_to(self, sequence: int, limit_s: float, what: str) -> Packet:
        end = self._clock() + nanoseconds(limit_s)
        while True:
            left_s = (end - self._clock()) / _SECOND
            packet = self._received(max(0.0, left_s))
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
        guard = self._socket
        if guard is None:
            raise DeviceError('expected an open serial line, got a closed one')
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

    def _has_left(self, guard: Descriptor) -> bool:
        """Wait until the guard has closed its end, which it does last; return whether it did."""
        poll = select.poll()
        poll.register(guard.number, select.POLLIN)
        end = time.monotonic() + _LEAVE_S
        while (left_s := end - time.monotonic()) > 0:
            if not poll.poll(left_s * 1000):
                return False
            try:
                if not os.read(guard.number, packets.MAXIMUM_PACKET):
                    return True
            except BlockingIOError:
                continue
            except OSError:
                return True
        return False
