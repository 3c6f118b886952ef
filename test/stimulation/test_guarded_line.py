# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two processes that write to one port: the driver past its guard, and the guard."""

import os
import select
import socket
import threading
import time
from types import SimpleNamespace

import pytest

from rpms_ros.guard import packets, rapid2
from rpms_ros.guard.packets import Packet
from rpms_ros.guard.relay import (
    Guard,
    GuardLimits,
    Line,
    LineBusy,
    LineError,
    write,
    write_silence,
)
from rpms_ros.stimulation.devices.serial_line import Descriptor, GuardedLine

FILLER = b'\x55' * 20_000


class BusyPort:
    """A port on which somebody else writes more than it takes: the kernel holds others off."""

    def __init__(self, wait_for):
        self.master, slave = os.openpty()
        self.heard = bytearray()
        self.line = os.open(os.ttyname(slave), os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(slave, True)
        self._slave = slave
        self._writing = threading.Thread(target=self._write)
        self._writing.start()
        wait_for(self.is_busy)

    def _write(self):
        left = FILLER
        while left:
            left = left[os.write(self._slave, left) :]

    def is_busy(self):
        try:
            write(self.line, b'?')
        except LineBusy:
            return True
        return False

    def drain(self):
        """Read until the other has written everything, and a silence has come."""
        while self._writing.is_alive() or rapid2.SILENCE not in self.heard:
            self.heard += self._read()
        self._writing.join()

    def _read(self):
        # what the other wrote last may have been read already, while it is about to end
        ready = select.select([self.master], [], [], 0.05)[0]
        return os.read(self.master, 4096) if ready else b''

    def close(self):
        while self._writing.is_alive():
            self._read()
        for descriptor in (self.line, self._slave, self.master):
            os.close(descriptor)


@pytest.fixture
def port(wait_for):
    busy = BusyPort(wait_for)
    yield busy
    busy.close()


@pytest.fixture
def drained(port, monkeypatch):
    """Drain the port from the first pause of a write on; the pauses, however many it takes."""
    monkeypatch.setattr('rpms_ros.guard.relay._PATIENCE_S', 20.0)
    reading = threading.Thread(target=port.drain)
    pauses = []

    def pause(seconds):
        if not pauses:
            reading.start()
        pauses.append(seconds)
        time.sleep(seconds)

    clock = SimpleNamespace(monotonic=time.monotonic, sleep=pause)
    monkeypatch.setattr('rpms_ros.guard.relay.time', clock)
    yield pauses
    reading.join()
    assert pauses
    assert FILLER[-100:] + rapid2.SILENCE in port.heard


@pytest.mark.usefixtures('drained')
def test_a_silence_of_the_driver_waits_while_its_guard_writes(port):
    line = GuardedLine('unused', GuardLimits())
    line._line = Descriptor(os.dup(port.line))
    assert line.silence()


@pytest.mark.usefixtures('drained')
def test_a_guard_whose_driver_writes_relays_no_trigger_and_disarms(port):
    driver, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with driver, theirs:
        guard = Guard(port.line, theirs.fileno(), GuardLimits(), wakeup=-1)
        guard._live, guard._percent = True, 40
        payload = bytes([rapid2.STATUS_LENGTH]) + rapid2.framed(rapid2.TRIGGER)
        guard._take(Packet(packets.EXCHANGE, 5, packets.FOREVER_NS, payload))
        kinds = {packets.unpacked(driver.recv(1000), packets.FROM_GUARD).kind for _ in range(2)}
        assert kinds == {packets.REFUSED, packets.DISARMED}
        assert not guard.ended
        assert rapid2.framed(rapid2.TRIGGER) not in port.heard


def test_a_command_does_not_wait(port):
    line = Line(port.line)
    with pytest.raises(LineBusy, match='expected a line to write to, got'):
        line.ask(rapid2.TRIGGER, rapid2.STATUS_LENGTH)
    assert line.outstanding is None


def test_a_line_that_takes_nothing_is_given_up(port):
    began = time.monotonic()
    with pytest.raises(LineError, match='expected a line to write to, got'):
        write_silence(port.line, rapid2.SILENCE)
    # not before the patience is over
    assert time.monotonic() - began >= 0.05


def test_a_guard_whose_line_takes_nothing_disarms_when_it_does(port, wait_for):
    driver, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    reading, writing = os.pipe()
    with theirs:
        theirs.setblocking(False)
        guard = Guard(port.line, theirs.fileno(), GuardLimits(), reading)
        driver.close()
        reasons = []
        guarding = threading.Thread(target=lambda: reasons.append(guard.run()))
        guarding.start()
        # longer than all its attempts on a line that takes them
        end = time.monotonic() + 1.0
        wait_for(lambda: reasons or time.monotonic() > end)
        assert not reasons
        port.drain()
        guarding.join()
    assert reasons[0].startswith('the driver is gone')
    for descriptor in (reading, writing):
        os.close(descriptor)


def test_what_a_line_takes_in_part_is_tried_again(monkeypatch):
    parts = iter([3, 5, 8])
    monkeypatch.setattr('rpms_ros.guard.relay.os.write', lambda _, __: next(parts))
    write_silence(-1, rapid2.SILENCE)
    assert len(rapid2.SILENCE) == 8
    assert not list(parts)
