# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The guard: relays commands while the driver lives, and disarms when it does not."""

import contextlib
import os
import select
import time
from collections import deque
from dataclasses import dataclass

from rpms_ros.guard import packets, rapid2_protocol as rapid2
from rpms_ros.guard.packets import Packet

# More in one turn would keep the guard from the line.
_AT_ONCE = 100
_SECOND = 1_000_000_000
# A driver asks one thing at a time; one more may wait while the guard asks something itself.
_WAITING = 2
# Every frame is a sign of life to an instrument that does not obey: after these its own watchdog
# has to have its turn, which it only has on a line that is quiet.
_DISARM_ATTEMPTS = 5
_DISARM_INTERVAL_NS = 100_000_000
_HELD = rapid2.REMOTE | rapid2.ARMED | rapid2.READY
# The end of noise on a line of 9600 baud: about 30 bytes without one.
_QUIET_NS = 30_000_000
_LONGEST_NOISE_NS = 500_000_000
# How long a turn waits for driver and line before it looks at the time.
_TURN_MS = 5


@dataclass(frozen=True)
class GuardLimits:
    """Limits that the guard enforces on the driver.

    Attributes
    ----------
    maximum_percent : int
        No trigger above this intensity [percent].
    beat_limit_s : float
        Longest silence of the driver [s].
    answer_limit_s : float
        Longest wait for an answer of the instrument [s].
    keep_alive_s : float
        The instrument hears something at least so often while the driver lives [s].
    """

    maximum_percent: int = 100
    beat_limit_s: float = 0.25
    answer_limit_s: float = 0.2
    keep_alive_s: float = 0.4

    def __post_init__(self) -> None:
        if not 0 <= self.maximum_percent <= 100:
            fault = f'expected a maximum intensity in 0..100 percent, got {self.maximum_percent}'
            raise ValueError(fault)
        for name in ('beat_limit_s', 'answer_limit_s', 'keep_alive_s'):
            if not 0.01 <= (value := getattr(self, name)) <= 60.0:
                raise ValueError(f'expected {name} in [0.01, 60] s, got {value}')


# The kernel lets one process at a time write to a port: the other is told to try again.
_PATIENCE_S = 0.05
_PAUSE_S = 0.0002


class LineError(Exception):
    """The line is gone."""


class LineBusy(LineError):
    """Another process writes to the line at this moment, or what was written before never left."""


def write_silence(descriptor: int, raw: bytes) -> None:
    """Write everything, and wait up to 50 ms while another process writes to the same port.

    A driver that silences the instrument past its guard and a guard that does the same may
    meet here.

    Raises
    ------
    LineError
        If the port does not take it.
    """
    end = time.monotonic() + _PATIENCE_S
    while True:
        try:
            write(descriptor, raw)
            return
        except LineBusy:
            if time.monotonic() > end:
                raise
            time.sleep(_PAUSE_S)


def write(descriptor: int, raw: bytes) -> None:
    """Write everything at once.

    Raises
    ------
    LineBusy
        If nothing, or only a part, can be written now.
    LineError
        If the port is gone.
    """
    try:
        taken = os.write(descriptor, raw)
    except BlockingIOError as error:
        raise LineBusy(f'expected a line to write to, got {error}') from error
    except OSError as error:
        raise LineError(f'expected a line to write to, got {error}') from error
    if taken != len(raw):
        raise LineBusy(f'expected a line that takes {len(raw)} bytes, got {taken}')


@dataclass
class Exchange:
    """A command that was written, and as much of its answer as came.

    Attributes
    ----------
    command : bytes
        Without its check byte.
    length : int
        Of the answer.
    sequence : int or None
        Of the driver's request; None for one of the guard itself.
    written_ns : int
        When the command was written [ns].
    answer : bytes
        What came so far.
    """

    command: bytes
    length: int
    sequence: int | None
    written_ns: int
    answer: bytes = b''


class Line:
    """One exchange at a time over an open serial port that does not block.

    Parameters
    ----------
    descriptor : int
        Of the port.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.outstanding: Exchange | None = None
        self.written_ns = time.monotonic_ns()

    def ask(self, command: bytes, length: int, sequence: int | None = None) -> None:
        """Write a command; `heard` collects its answer.

        Raises
        ------
        LineBusy
            If it cannot be written now: who else writes to the port is the driver, which
            silences the instrument past this guard.  No command follows that.
        LineError
            If the port does not take it.
        """
        write(self.descriptor, rapid2.framed(command))
        self.written_ns = time.monotonic_ns()
        self.outstanding = Exchange(command, length, sequence, self.written_ns)

    def silence(self, raw: bytes) -> None:
        """Write what sets the instrument to zero and disarms it, or gives it back.

        Raises
        ------
        LineError
            If the port does not take it: it is gone, or what was written before never left.
        """
        write_silence(self.descriptor, raw)
        self.written_ns = time.monotonic_ns()

    def read(self) -> bytes:
        """Return what has come.

        Raises
        ------
        LineError
            If the port is gone.
        """
        try:
            raw = os.read(self.descriptor, 4096)
        except BlockingIOError:
            return b''
        except OSError as error:
            raise LineError(f'expected a line to read from, got {error}') from error
        if not raw:
            raise LineError('expected a line to read from, got its end')
        return raw

    def heard(self) -> tuple[Exchange | None, bytes]:
        """Return the exchange that is complete now, if one is, and what nobody has asked for."""
        raw, asked = self.read(), self.outstanding
        if asked is None:
            return None, raw
        for position in range(len(raw)):
            asked.answer += raw[position : position + 1]
            if rapid2.complete(asked.answer, asked.length):
                self.outstanding = None
                return asked, raw[position + 1 :]
        return None, b''


class Guard:
    """Serves one driver over one line until the driver leaves or something is wrong.

    Parameters
    ----------
    line : int
        Descriptor of the serial port, not blocking.
    driver : int
        Descriptor of the driver's socket, not blocking, that keeps the boundaries of packets.
    limits : GuardLimits
        What the driver is held to.
    wakeup : int
        Descriptor that becomes readable when this process is asked to end.
    """

    def __init__(self, line: int, driver: int, limits: GuardLimits, wakeup: int) -> None:
        self.line, self.limits, self.ended = Line(line), limits, ''
        self._driver, self._wakeup = driver, wakeup
        # nothing is relayed before the driver says that it listens
        self._live = False
        self._beat_ns = time.monotonic_ns()
        self._percent: int | None = None
        self._listening: Packet | None = None
        self._noise_ns = self._quiet_ns = 0
        self._waiting: deque[Packet] = deque()
        # numbers of what the driver has asked for and has no answer to
        self._unanswered: list[int] = []
        self._attempts = self._attempt_ns = 0
        self._heard = b''

    def run(self) -> str:
        """Serve until the end; return why it ended, with the instrument disarmed."""
        poll = select.poll()
        for descriptor in (self.line.descriptor, self._driver, self._wakeup):
            poll.register(descriptor, select.POLLIN)
        try:
            while not self.ended or self._attempts:
                ready = {descriptor for descriptor, _ in poll.poll(_TURN_MS)}
                self._step(ready)
                if self.ended and self._driver in ready:
                    poll.unregister(self._driver)
                if self._wakeup in ready:
                    poll.unregister(self._wakeup)
            self.line.silence(rapid2.framed(rapid2.RELEASE))
        except LineError as error:
            self._tell(packets.DISARMED, str(error).encode())
            return str(error)
        except BaseException:
            # a mistake in here must not leave it armed
            self.line.silence(rapid2.SILENCE)
            raise
        return self.ended

    def silence(self, reason: str, told: bool = True) -> None:
        """Set intensity zero and disarm, refuse everything until the driver listens anew."""
        was_live, self._live, self._percent = self._live, False, None
        self.line.outstanding = self._listening = None
        self._waiting.clear()
        self._heard = b''
        self._attempts = _DISARM_ATTEMPTS
        self._disarm()
        if told and was_live:
            self._tell(packets.DISARMED, reason.encode())
        for sequence in [*self._unanswered]:
            self._tell(packets.REFUSED, reason.encode(), sequence)

    def _step(self, ready: set[int]) -> None:
        if self._wakeup in ready:
            self._end('the guard was told to end')
        # everything that the driver has sent: a silence counts before what was sent earlier
        if self._driver in ready and not self.ended:
            try:
                received = self._received()
            except (OSError, ValueError) as error:
                self._end(f'the driver is gone: {error}')
            else:
                self._obey(received)
        if self.line.descriptor in ready:
            self._listen()
        self._look_at_the_time()

    def _end(self, reason: str) -> None:
        if not self.ended:
            self.ended = reason
            self.silence(reason)

    # ---- the driver

    def _received(self) -> list[Packet]:
        """Return what the driver has sent, oldest first.

        Raises
        ------
        OSError, ValueError
            If its end is closed, which reads as no bytes, or if one of them is no packet.
        """
        received: list[Packet] = []
        with contextlib.suppress(BlockingIOError):
            while len(received) < _AT_ONCE:
                raw = os.read(self._driver, packets.MAXIMUM_PACKET + 1)
                received.append(packets.unpacked(raw, packets.FROM_DRIVER))
        return received

    def _tell(self, kind: bytes, data: bytes = b'', sequence: int = 0, time_ns: int = 0) -> None:
        """Send a packet; one that cannot be sent is dropped."""
        if sequence in self._unanswered:
            self._unanswered.remove(sequence)
        with contextlib.suppress(OSError):
            os.write(self._driver, packets.packed(Packet(kind, sequence, time_ns, data)))

    def _obey(self, received: list[Packet]) -> None:
        if received:
            self._beat_ns = time.monotonic_ns()
        kinds = [packet.kind for packet in received]
        if packets.LEAVE in kinds:
            self._end('the driver has left')
            return
        if packets.SILENCE in kinds:
            last = len(kinds) - kinds[::-1].index(packets.SILENCE)
            asking = packets.EXCHANGE, packets.LISTEN
            self._unanswered += [one.sequence for one in received[:last] if one.kind in asking]
            self.silence('the driver has silenced the device', told=False)
            received = received[last:]
        for packet in received:
            if self.ended:
                return
            if packet.kind == packets.BEAT:
                self._tell(packets.PONG, b'', packet.sequence)
            elif packet.kind == packets.LISTEN:
                self._begin_to_listen(packet)
            else:
                self._take(packet)

    def _take(self, packet: Packet) -> None:
        """Relay an exchange at once, or when the line is free."""
        self._unanswered.append(packet.sequence)
        if not self._live:
            reason = b'expected a driver that listens to an armed line, got a silenced one'
            self._tell(packets.REFUSED, reason, packet.sequence)
        elif self.line.outstanding is None:
            self._relay(packet)
        elif len(self._waiting) < _WAITING:
            self._waiting.append(packet)
        else:
            self._end('expected one exchange at a time, got more')

    def _relay(self, packet: Packet) -> None:
        command = rapid2.command_of(packet.payload[1:])
        length = packet.payload[0] if packet.payload else 0
        if command is None or length > rapid2.LONGEST_ANSWER:
            self._end(f'expected a known command, got {packet.payload!r}')
            return
        percent = rapid2.percent_of(command)
        if percent is not None:
            # known again when the instrument has answered
            self._percent = None
        bound = self.limits.maximum_percent
        if percent is not None and percent > bound:
            self.silence(f'expected at most {bound} percent, got {percent}')
            return
        if command == rapid2.TRIGGER and self._percent is None:
            self.silence('expected an intensity before a trigger, got none')
            return
        # the last moment before it is written
        if time.monotonic_ns() > packet.time_ns:
            self._tell(packets.LATE, b'', packet.sequence)
            return
        self._ask(command, length, packet.sequence)

    # ---- the line

    def _ask(self, command: bytes, length: int, sequence: int | None = None) -> None:
        try:
            self.line.ask(command, length, sequence)
        except LineBusy as error:
            self.silence(str(error))

    def _begin_to_listen(self, packet: Packet) -> None:
        self._listening, self._unanswered = packet, [packet.sequence]
        self._attempts = 0
        self._live = False
        self.line.outstanding = None
        self._waiting.clear()
        self._noise_ns = self._quiet_ns = time.monotonic_ns()

    def _listen(self) -> None:
        """Take what the instrument says."""
        if self._live:
            answered, rest = self.line.heard()
            if answered is not None:
                self._answered(answered)
            if rest and self._live:
                self.silence(f'expected a quiet line, got {rest!r} that nobody has asked for')
            if self._live and self.line.outstanding is None and self._waiting:
                self._relay(self._waiting.popleft())
            return
        self._heard = (self._heard + self.line.read())[-64:]
        self._quiet_ns = time.monotonic_ns()
        if self._attempts and self._disarmed():
            self._attempts = 0

    def _answered(self, exchange: Exchange) -> None:
        asked_here, percent = exchange.sequence is None, rapid2.percent_of(exchange.command)
        try:
            status = rapid2.parsed(exchange.command, exchange.answer, exchange.length).status
            if asked_here and status & rapid2.ERROR:
                raise ValueError(f'expected an instrument without error, got {status:#04x}')
            if percent is not None:
                self._percent = percent
        except ValueError as error:
            # what is wrong with the driver's own exchanges is told by their answer
            if asked_here:
                self.silence(str(error))
        if exchange.sequence is not None:
            self._tell(packets.ANSWER, exchange.answer, exchange.sequence, exchange.written_ns)

    def _disarm(self) -> None:
        # the second disarming is answered with the status after the first one
        with contextlib.suppress(LineBusy):
            self.line.silence(rapid2.SILENCE + rapid2.framed(rapid2.DISARM))
            # one that the line did not take is no attempt: the instrument has not heard it
            self._attempts -= 1
        self._attempt_ns = time.monotonic_ns()

    def _disarmed(self) -> bool:
        """Whether the instrument has said that it is disarmed."""
        for at in range(len(self._heard) - rapid2.STATUS_LENGTH + 1):
            answer = self._heard[at : at + rapid2.STATUS_LENGTH]
            whole = answer[:1] == b'E' and rapid2.framed(answer[:-1]) == answer
            if whole and answer[1] & _HELD == rapid2.REMOTE:
                return True
        return False

    # ---- the time

    def _look_at_the_time(self) -> None:
        now = time.monotonic_ns()
        if self._attempts and now - self._attempt_ns > _DISARM_INTERVAL_NS:
            self._disarm()
        self._look_at_noise(now)
        if not self._live:
            return
        asked = self.line.outstanding
        if now - self._beat_ns > self.limits.beat_limit_s * _SECOND:
            limit = self.limits.beat_limit_s
            self.silence(f'expected a sign of life of the driver within {limit:g} s, got none')
        elif asked is not None:
            if now - asked.written_ns > self.limits.answer_limit_s * _SECOND:
                limit = self.limits.answer_limit_s
                self.silence(f'expected an answer of the instrument within {limit:g} s, got none')
        elif now - self.line.written_ns > self.limits.keep_alive_s * _SECOND:
            self._ask(rapid2.ENABLE, rapid2.STATUS_LENGTH)

    def _look_at_noise(self, now: int) -> None:
        packet = self._listening
        if packet is None:
            return
        if now - self._quiet_ns >= _QUIET_NS:
            self._listening, self._live = None, True
            self._tell(packets.LISTEN, b'', packet.sequence)
        elif now - self._noise_ns > _LONGEST_NOISE_NS:
            self.silence(f'expected a quiet line, got {self._heard!r} all the time')
