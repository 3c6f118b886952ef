# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The serial device through its guard; the instrument's own list of triggers is the oracle."""

import errno
import fcntl
import os
import signal
import struct
import subprocess
import sys
import threading
import time

import pytest
import serial

from rpms_ros.guard import packets, rapid2_protocol as rapid2
from rpms_ros.guard.packets import Packet
from rpms_ros.pulses import MAGNETIC_PULSE_WIDTH
from rpms_ros.stimulation.devices.rapid2 import SerialDevice, open_port
from rpms_ros.stimulation.devices.registry import DeviceError, DeviceStatus, TooLate

# Linux; Python has no name for it
TIOCGEXCL = 0x80045440


def kept_from_others(port):
    """Whether nobody but root can open a port."""
    try:
        # not as the terminal of a session that has none: its end would end the session
        opened = os.open(port, os.O_RDONLY | os.O_NOCTTY)
    except OSError as error:
        return error.errno == errno.EBUSY
    try:
        return bool(struct.unpack('i', fcntl.ioctl(opened, TIOCGEXCL, bytes(4)))[0])
    finally:
        os.close(opened)


def armed(device, intensity=0.5):
    """Arm a device and prepare a pulse; return it."""
    device.arm()
    device.prepare(intensity)
    return device


def test_opening_takes_control_at_intensity_zero_disarmed(fake, device):
    assert device.real
    assert fake.frames == [b'Q@', b'EA', b'EA', b'ND', b'@000', b'\\@']
    assert (fake.remote, fake.armed, fake.percent) == (True, False, 0)
    with pytest.raises(DeviceError, match='expected an armed device with an intensity, got none'):
        device.fire(0.2, MAGNETIC_PULSE_WIDTH)
    assert b'EH' not in fake.frames
    # a child of the driver inherits nothing that keeps the instrument armed
    held = (device._line._line, device._line._socket)
    assert not any(os.get_inheritable(descriptor.number) for descriptor in held)


def test_pulse_has_the_intensity_that_was_asked_for_and_read_back(fake, device):
    status = device.arm()
    assert (status.armed, status.ready, status.coil_present) == (True, True, True)
    assert fake.percent == 0
    device.prepare(0.5)
    assert device.read_back().intensity == 0.5
    before = time.monotonic_ns()
    given = device.fire(0.5, MAGNETIC_PULSE_WIDTH)
    # three bytes of ten bits at 9600 baud from the writing of the trigger to the onset
    frame_ns = 3_125_000
    assert device.trigger_s == pytest.approx(frame_ns / 1e9)
    assert before + frame_ns <= given.time_ns <= time.monotonic_ns() + frame_ns
    assert given.intensity == 0.5
    # what was set is known, what was given with it only when it was read afterwards
    assert given.unverified == {'delivery', 'intensity'}
    assert device.read_back().intensity == 0.5
    assert fake.fired() == [50]
    device.rest()
    assert (fake.percent, fake.armed) == (0, True)


@pytest.mark.parametrize(('version', 'read_back'), [('5.0.0', 21), ('7.1', 22), ('11.0.0', 24)])
def test_intensity_is_read_back_from_every_published_version(
    fake, version, read_back, patient_device
):
    fake.version = version
    device = patient_device(fake.port)
    # a byte takes 1.04 ms, the command has three
    assert device.read_back_s == pytest.approx((3 + read_back) / 960 + 0.003)
    assert armed(device, 0.37).read_back().intensity == 0.37


def test_instrument_that_does_not_tell_its_version_leaves_the_intensity_unverified(
    fake, patient_device
):
    fake.refuse = {b'ND': b'S'}
    device = patient_device(fake.port)
    assert device.read_back_s == float('inf')
    assert armed(device, 0.4).read_back().intensity is None
    assert device.fire(0.4, MAGNETIC_PULSE_WIDTH).unverified == {'delivery', 'intensity'}
    assert b'\\@' not in fake.frames


def test_foreign_command_between_two_pulses_gives_no_pulse_of_its_intensity(
    fake, device, wait_for
):
    armed(device, 0.2).fire(0.2, MAGNETIC_PULSE_WIDTH)
    # not even an answer shows it
    fake.foreign(b'@100', answered=False)
    device.prepare(0.2)
    assert device.fire(0.2, MAGNETIC_PULSE_WIDTH).intensity == 0.2
    assert fake.fired() == [20, 20]
    # after the preparation its answer shows it
    device.prepare(0.2)
    fake.foreign(b'@100')
    wait_for(lambda: bool(fake.disarmed))
    with pytest.raises(DeviceError, match=r'expected a .*line, got'):
        device.fire(0.2, MAGNETIC_PULSE_WIDTH)
    assert fake.fired() == [20, 20]


def test_intensity_that_the_instrument_does_not_take(fake, device, wait_for):
    device.arm()
    fake.deaf = True
    device.prepare(0.2)
    assert device.read_back().intensity == 0.0
    # silenced at once
    assert device.fire(0.2, MAGNETIC_PULSE_WIDTH) is None
    wait_for(lambda: not fake.armed)
    assert fake.fired() == []


@pytest.mark.parametrize(
    ('flag', 'value', 'said'),
    [
        ('coil', False, 'no coil'),
        ('replace', True, 'a coil to be replaced'),
        ('error', True, 'an error'),
    ],
)
def test_what_the_instrument_says_is_looked_at_in_every_answer(
    fake, device, wait_for, flag, value, said
):
    armed(device)
    setattr(fake, flag, value)
    with pytest.raises(DeviceError, match=f'expected a device in order with a coil, got {said}'):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)
    wait_for(lambda: not fake.armed)
    # one trigger was on the line before the instrument could say so; none follows
    assert fake.fired() == [50]
    assert device.fire(0.5, MAGNETIC_PULSE_WIDTH) is None
    with pytest.raises(DeviceError, match=f'expected a device in order with a coil, got {said}'):
        device.arm()
    assert fake.fired() == [50]
    assert not fake.armed


def test_coil_of_a_disarmed_device_may_be_changed(fake, device):
    fake.coil, fake.replace = False, True
    status = device.keep_alive()
    assert (status.armed, status.coil_present, status.replace_coil) == (False, False, True)
    fake.coil, fake.replace = True, False
    assert armed(device).fire(0.5, MAGNETIC_PULSE_WIDTH) is not None
    fake.coil = False
    with pytest.raises(DeviceError, match='got no coil: status'):
        device.keep_alive()


def test_a_trigger_that_found_the_device_charging_is_no_delivery(device, monkeypatch):
    armed(device)
    status = rapid2.ARMED | rapid2.COIL_PRESENT | rapid2.REMOTE
    frame = rapid2.framed(b'E' + bytes([status]))
    answer = Packet(packets.ANSWER, 1, time.monotonic_ns(), frame)
    monkeypatch.setattr(device._line, 'exchange', lambda *_: answer)
    with pytest.raises(DeviceError, match='expected a ready device, got status 0x8a'):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)


@pytest.mark.parametrize('letter', [b'S', b'?'])
@pytest.mark.parametrize('command', [b'EH', b'@', b'EB', b'Q@', b'\\@'])
def test_refusal_is_never_a_delivery_nor_a_status(fake, device, command, letter):
    fake.refuse = {command: letter}

    def pulse():
        armed(device).read_back()
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)

    with pytest.raises(DeviceError, match='expected the instrument to obey'):
        pulse()
    assert fake.fired() == []


def test_pulse_that_was_acknowledged_and_not_given_is_not_said_to_be_sure(fake, device):
    armed(device)
    fake.acknowledge_only = True
    assert 'delivery' in device.fire(0.5, MAGNETIC_PULSE_WIDTH).unverified
    assert fake.fired() == []


def test_instrument_that_disarmed_by_itself(fake, device):
    armed(device)
    fake.self_disarm()
    with pytest.raises(DeviceError, match='expected the instrument to obey EH, got S'):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)
    armed(device)
    fake.self_disarm()
    with pytest.raises(DeviceError, match='got a device that has disarmed by itself'):
        device.keep_alive()
    assert fake.fired() == []


def test_trigger_that_comes_too_late_is_not_written(fake, device):
    armed(device)
    now = time.monotonic_ns()
    with pytest.raises(TooLate, match='expected a trigger to be written in time'):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH, latest_ns=now - 1)
    assert b'EH' not in fake.frames
    assert device.fire(0.5, MAGNETIC_PULSE_WIDTH, latest_ns=now + 10**11) is not None


def test_device_that_does_not_charge(instrument, monkeypatch, patient_device):
    fake = instrument(charge_s=60.0, watchdog_s=20.0)
    monkeypatch.setattr('rpms_ros.stimulation.devices.rapid2._CHARGE_S', 0.05)
    device = patient_device(fake.port)
    with pytest.raises(DeviceError, match=r'expected a device that is ready within 0\.05 s'):
        device.arm()
    device.close()
    assert not fake.armed


def test_silence_sets_zero_first_and_waits_for_nobody(fake, device, wait_for):
    armed(device)
    fake.hang = True
    returned = []
    hanging = threading.Thread(target=lambda: returned.append(device.keep_alive()))
    hanging.start()
    wait_for(lambda: bool(fake._pending))
    began = time.monotonic()
    device.silence()
    device.silence()
    # less than the time-out of an exchange, 5 s
    assert time.monotonic() - began < 4.0
    # the guard ends the exchange that hangs: nothing is known, and nothing is wrong
    hanging.join(60.0)
    assert returned == [DeviceStatus()]
    fake.hang = False
    wait_for(lambda: not fake.armed)
    assert fake.percent == 0
    rest = fake.frames[fake.frames.index(b'@050') :]
    assert rest.index(b'@000') < rest.index(b'EA')
    assert device.fire(0.5, MAGNETIC_PULSE_WIDTH) is None
    assert device.prepare(0.5) is None
    assert fake.fired() == []


def test_after_a_silence_the_status_is_asked_for_and_the_disarming_made_sure(fake, device):
    armed(device)
    device.silence()
    assert device.keep_alive()[:2] == (False, False)
    fake.obey_disarm = False
    fake.armed = True
    device.silence()
    with pytest.raises(DeviceError, match='expected a device that disarms, got status'):
        device.keep_alive()


def test_temperature_is_asked_for_every_two_seconds(fake, patient_device):
    now = [10**9]
    device = patient_device(fake.port, clock=lambda: now[0])
    assert device.keep_alive().temperature == 25.3
    # what was measured earlier does not come again: it is not known to be so now
    assert device.keep_alive().temperature is None
    assert device.arm().temperature is None
    assert device.prepare(0.5).temperature is None
    assert fake.frames.count(b'F@') == 1
    now[0] += 2_000_000_000
    # one that does not fit before the pulse is left out; the clock stands still: only the time
    # that the line needs counts
    assert device.prepare(0.5, spare_s=0.01).temperature is None
    assert fake.frames[-1] == b'@050'
    fake.temperatures = '311', '320'
    assert device.prepare(0.5, spare_s=0.025).temperature == 32.0
    assert fake.frames[-2:] == [b'@050', b'F@']
    now[0] += 2_000_000_000
    fake.temperatures = 'xyz', '251'
    with pytest.raises(DeviceError, match='expected two temperatures in tenths of a degree, got'):
        device.keep_alive()


@pytest.mark.parametrize(
    ('wrong', 'value', 'match'),
    [
        ('flip', True, 'a check byte that fits'),
        ('cut', 2, 'expected an answer .* within .* got none'),
        ('silent', True, 'expected an answer .* within .* got none'),
        ('hang', True, 'expected an answer .* within .* got none'),
    ],
)
def test_noise_silence_and_half_answers(fake, wrong, value, match, wait_for):
    device = SerialDevice(fake.port, timeout_s=1.0, beat_limit_s=20.0)
    device.open()
    armed(device)
    right = getattr(fake, wrong)
    setattr(fake, wrong, value)
    with pytest.raises(DeviceError, match=match):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)
    setattr(fake, wrong, right)
    device.close()
    wait_for(lambda: not fake.armed)


def test_noise_on_a_line_on_which_nobody_has_asked(fake, device, wait_for):
    armed(device)
    fake.noise(b'\xff\x00\x7f')
    wait_for(lambda: not fake.armed)
    with pytest.raises(DeviceError, match=r'that nobody has asked for|silenced'):
        device.fire(0.5, MAGNETIC_PULSE_WIDTH)
    assert armed(device).fire(0.5, MAGNETIC_PULSE_WIDTH) is not None


def test_cable_that_is_pulled(fake, device):
    armed(device)
    fake.vanish()
    with pytest.raises(DeviceError, match='expected'):
        device.prepare(0.5)
    with pytest.raises(DeviceError, match='expected a line that takes a silence'):
        device.silence()


def test_failed_opening_lets_go_of_the_port(fake, patient_device, wait_for):
    fake.refuse = {b'Q@': b'S'}
    device = patient_device(fake.port, opened=False)
    for _ in range(2):
        with pytest.raises(DeviceError, match='expected the instrument to obey Q@, got S'):
            device.open()
        assert device._line._guard is None
    fake.refuse = {}
    device.open()
    assert fake.remote
    device.close()
    wait_for(lambda: not fake.remote)
    # and once more
    device.open()


def test_port_is_held_by_one_driver(fake, device, patient_device):
    assert kept_from_others(fake.port)
    second = patient_device(fake.port, opened=False)
    with pytest.raises(DeviceError, match=r'expected a serial port, got .*lock'):
        second.open()
    with pytest.raises(DeviceError, match=r'expected .* to be closed, got an open one'):
        device.open()
    assert device.keep_alive().coil_present
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


def test_after_the_guard_is_gone_the_device_is_closed_and_opened_anew(fake, device, wait_for):
    armed(device)
    first = device._line._guard.pid
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
    assert device._line._guard.pid != first
    assert armed(device).fire(0.5, MAGNETIC_PULSE_WIDTH) is not None


def test_the_guard_has_the_priority_of_the_driver(fake, patient_device):
    device = patient_device(fake.port, opened=False)
    # a policy that needs no right
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    try:
        device.open()
        assert os.sched_getscheduler(device._line._guard.pid) == os.SCHED_BATCH
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def test_a_guard_that_is_stopped_does_not_keep_the_port(fake, device, wait_for):
    armed(device)
    stopped = device._line._guard.pid
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
        'from rpms_ros.stimulation.devices.rapid2 import SerialDevice\n'
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


def test_a_silence_that_comes_late_on_the_line_is_begun_after_and_no_error(device):
    device.arm()
    silence = device._line.silence

    def late():
        device._line.silence = silence
        # another thread, between the number of the silence and its bytes
        device.keep_alive()
        return silence()

    device._line.silence = late
    device.silence()
    assert device.keep_alive().armed is False
