# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The port of a serial device, its guard, and who keeps the line when one of them ends."""

import errno
import fcntl
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest
import serial

from rpms_ros.pulses import MAGNETIC_PULSE_WIDTH
from rpms_ros.stimulation.devices import DeviceError
from rpms_ros.stimulation.devices.serial_line import SerialDevice, open_port


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
