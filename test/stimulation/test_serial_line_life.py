# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The port of a serial device, its guard, and who keeps the line when one of them ends."""

import errno
import fcntl
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import serial

from rpms_ros.guard.port import open_port
from rpms_ros.guard.process import main
from rpms_ros.pulses import MAGNETIC_PULSE_WIDTH
from rpms_ros.stimulation.devices import DeviceError
from rpms_ros.stimulation.devices.serial_line import SerialDevice


def test_cable_that_is_pulled(fake, device, armed):
    armed(device)
    fake.vanish()
    with pytest.raises(DeviceError, match='expected'):
        device.prepare(0.5)
    with pytest.raises(DeviceError, match='expected a line that takes a silence'):
        device.silence()


def test_failed_opening_lets_go_of_the_port(fake, patient_device):
    fake.refuse = {b'Q@': b'S'}
    device = patient_device(fake.port)
    for _ in range(2):
        with pytest.raises(DeviceError, match='expected the instrument to obey Q@, got S'):
            device.open()
        assert device.guard_pid is None
    fake.refuse = {}
    device.open()
    assert fake.remote
    device.close()
    assert not fake.remote
    # and once more
    device.open()
    device.close()


def test_port_is_held_by_one_driver(fake, device, patient_device):
    second = patient_device(fake.port)
    with pytest.raises(DeviceError, match=r'expected a serial port, got .*lock'):
        second.open()
    with pytest.raises(DeviceError, match=r'expected .* to be closed, got an open one'):
        device.open()
    assert device.keep_alive().coil_present


# Linux; Python has no name for it
TIOCGEXCL = 0x80045440


def kept_from_others(port):
    """Whether nobody but root can open a port."""
    try:
        with Path(port).open('rb', buffering=0) as opened:
            return bool(struct.unpack('i', fcntl.ioctl(opened, TIOCGEXCL, bytes(4)))[0])
    except OSError as error:
        return error.errno == errno.EBUSY


def test_port_is_free_again_after_its_driver(fake, device):
    assert kept_from_others(fake.port)
    device.close()
    assert not kept_from_others(fake.port)


def test_port_that_is_not_there(tmp_path):
    absent = SerialDevice(str(tmp_path / 'ttyUSB9'))
    with pytest.raises(DeviceError, match=r'expected a serial port, got .*ttyUSB9'):
        absent.open()
    with pytest.raises(DeviceError, match='expected an open serial line, got a closed one'):
        absent.keep_alive()
    absent.beat()
    absent.silence()
    absent.close()
    (tmp_path / 'file').write_text('no port')
    with pytest.raises(DeviceError, match='expected a serial port, got'):
        SerialDevice(str(tmp_path / 'file')).open()


def test_line_that_is_a_trigger_on_some_cables_is_off(fake, monkeypatch):
    asked = []
    # a pseudo-terminal has neither line
    monkeypatch.setattr(serial.Serial, '_update_dtr_state', lambda _: None)
    monkeypatch.setattr(serial.Serial, '_update_rts_state', lambda port: asked.append(port.rts))
    os.close(open_port(fake.port))
    assert asked == [False]


def test_triggers_above_the_bound_do_not_pass_the_guard(fake, wait_for, armed, patient_device):
    device = patient_device(fake.port, maximum_intensity=0.405)
    device.open()
    armed(device, 0.4).fire(0.4, MAGNETIC_PULSE_WIDTH)
    with pytest.raises(DeviceError, match='expected at most 40 percent, got 41'):
        device.prepare(0.41)
    wait_for(lambda: not fake.armed)
    device.close()
    assert b'@041' not in fake.frames


def test_a_child_of_the_driver_inherits_nothing_that_keeps_it_alive(device):
    held = (device._line._line, device._line._socket)
    assert not any(os.get_inheritable(descriptor.number) for descriptor in held)


def test_after_the_guard_is_gone_the_device_is_closed_and_opened_anew(
    fake, device, wait_for, armed
):
    armed(device)
    first = device.guard_pid
    os.kill(first, signal.SIGKILL)

    def beaten():
        try:
            device.beat()
        except DeviceError as error:
            return 'guard' in str(error)
        return False

    wait_for(beaten)
    wait_for(lambda: not fake.armed)
    with pytest.raises(DeviceError, match='expected a guard'):
        device.arm()
    device.close()
    device.open()
    assert device.guard_pid != first
    assert armed(device).fire(0.5, MAGNETIC_PULSE_WIDTH) is not None


def test_a_guard_that_is_stopped_does_not_keep_the_port(fake, device, wait_for, armed):
    armed(device)
    stopped = device.guard_pid
    os.kill(stopped, signal.SIGSTOP)
    device.close()
    wait_for(lambda: not fake.armed)
    with pytest.raises(ProcessLookupError, match='No such process'):
        os.kill(stopped, 0)
    device.open()
    assert device.keep_alive().coil_present


def test_a_fork_that_outlives_the_driver_does_not_keep_it_armed(fake, wait_for):
    # the fork holds the driver's socket open: its end is never seen, its silence is
    text = (
        'import os, sys, time\n'
        'from rpms_ros.stimulation.devices.serial_line import SerialDevice\n'
        'device = SerialDevice(sys.argv[1], timeout_s=5.0, beat_limit_s=3.0)\n'
        'device.open()\n'
        'device.arm()\n'
        'child = os.fork()\n'
        'if not child:\n'
        '    time.sleep(60)\n'
        '    os._exit(0)\n'
        'print(child, flush=True)\n'
        'while True:\n'
        '    device.beat()\n'
        '    time.sleep(0.01)\n'
    )
    command = [sys.executable, '-c', text, fake.port]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as driver:
        child = int(driver.stdout.readline())
        try:
            assert fake.armed
            driver.kill()
            wait_for(lambda: not fake.armed)
            assert fake.disarmed[-1][1] == 'was told to'
        finally:
            driver.kill()
            os.kill(child, signal.SIGKILL)


@pytest.fixture
def by_hand(fake, tmp_path, wait_for):
    """A guard on a socket of its own: the process, and the path."""
    path = tmp_path / 'guard'
    command = [sys.executable, '-m', 'rpms_ros.guard', '--port', fake.port, '--socket', str(path)]
    limits = ['--answer-limit=5', '--beat-limit=20', '--maximum-percent=30']
    with subprocess.Popen([*command, *limits], stderr=subprocess.PIPE) as guard:
        wait_for(path.is_socket)
        yield guard, path
        guard.kill()


def open_in_turn(device, wait_for):
    """Open a device at a guard that may not have done with the driver before it."""

    def opened():
        try:
            device.open()
        except DeviceError:
            return False
        return True

    wait_for(opened)


def test_guard_that_was_started_by_hand(fake, by_hand, wait_for, armed, patient_device):
    guard, path = by_hand
    assert path.stat().st_mode & 0o077 == 0
    for second in (path, path.with_name('second')):
        assert main(['--port', fake.port, '--socket', str(second)]) == 2
    for _ in range(2):
        device = patient_device(str(path))
        open_in_turn(device, wait_for)
        assert device.guard_pid == guard.pid
        assert armed(device, 0.3).fire(0.3, MAGNETIC_PULSE_WIDTH) is not None
        device.close()
        wait_for(lambda: not fake.armed)
        # a driver that leaves does not give away what its guard goes on to hold
        assert kept_from_others(fake.port)
    # the bound is the guard's, whatever the driver was given
    open_in_turn(device, wait_for)
    device.arm()
    with pytest.raises(DeviceError, match=r'expected at most 30 percent, got 31'):
        device.prepare(0.31)
    device.close()
    guard.terminate()
    assert guard.wait(60) == 0
    assert b'drivers find it at' in guard.stderr.read()
    assert not path.exists()
    assert fake.fired() == [30, 30]


def test_guard_by_hand_outlives_a_driver_that_gave_up_waiting(by_hand, patient_device, wait_for):
    guard, path = by_hand
    first, last = patient_device(str(path)), patient_device(str(path))
    first.open()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as waiting:
        # it waits for the guard that the first one has, and goes
        waiting.connect(str(path))
    first.close()
    open_in_turn(last, wait_for)
    assert last.guard_pid == guard.pid
    last.close()
    guard.terminate()
    assert guard.wait(60) == 0
    assert b'a driver has left before it was served' in guard.stderr.read()


def test_socket_that_is_no_guard(tmp_path):
    path = tmp_path / 'other'
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as other:
        other.bind(str(path))
        other.listen()

        def answer():
            with other.accept()[0] as driver:
                driver.send(b'hello')

        answering = threading.Thread(target=answer)
        answering.start()
        with pytest.raises(DeviceError, match='expected a packet of 13 to 213 bytes, got 5'):
            SerialDevice(str(path)).open()
        answering.join()
    with pytest.raises(DeviceError, match=r'expected a serial port, got .*refused'):
        SerialDevice(str(path)).open()


@pytest.mark.parametrize(
    ('arguments', 'match'),
    [
        ([], 'expected --port and --socket'),
        (['--maximum-percent=101'], r'expected a maximum intensity in 0\.\.100 percent, got 101'),
        (['--beat-limit=0'], r'expected beat_limit_s in \[0\.01, 60\] s, got 0'),
        (['--beat-limit=nan'], r'expected beat_limit_s in \[0\.01, 60\] s, got nan'),
        (['--port=/dev/null', '--socket=/dev/null'], 'stimulator_guard: '),
    ],
)
def test_guard_says_what_it_was_given_wrong(arguments, match, capsys):
    assert main(arguments) == 2
    assert re.search(match, capsys.readouterr().err)
