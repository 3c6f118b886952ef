"""The serial device against a simulated instrument on a pseudo-terminal."""

import os
import select
import threading
import time
import tty

import pytest

from rpms_ros.stimulation import constant
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.device_specification import load_device_specification
from rpms_ros.stimulation.devices import DeviceError
from rpms_ros.stimulation.devices.serial_line import ARMED
from rpms_ros.stimulation.devices.serial_line import COIL_PRESENT
from rpms_ros.stimulation.devices.serial_line import ERROR
from rpms_ros.stimulation.devices.serial_line import READY
from rpms_ros.stimulation.devices.serial_line import REMOTE
from rpms_ros.stimulation.devices.serial_line import SerialDevice
from rpms_ros.stimulation.devices.serial_line import framed
from rpms_ros.stimulation.safety_monitor import EXECUTOR
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.threads import PulseThread
from rpms_ros.stimulation.threads import SupervisorThread

LENGTHS = {ord('Q'): 3, ord('R'): 3, ord('F'): 3, ord('E'): 3, ord('@'): 5}


class Instrument(threading.Thread):
    """Plays the stimulator at the other end of the line."""

    def __init__(self):
        super().__init__(daemon=True)
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.port = os.ttyname(self.slave)
        self.status = COIL_PRESENT
        self.percent = 0
        self.celsius = b'253'
        self.log, self.fired = [], []
        self.mute = self.garbled = False
        self._open = True

    def run(self):
        pending = b''
        while self._open:
            if select.select([self.master], [], [], 0.05)[0]:
                pending += os.read(self.master, 100)
            while pending and len(pending) >= LENGTHS[pending[0]]:
                frame, pending = pending[: LENGTHS[pending[0]]], pending[LENGTHS[pending[0]] :]
                self._obey(frame)

    def _obey(self, frame):
        assert framed(frame[:-1]) == frame
        body = frame[:-1]
        self.log.append(body)
        if body == b'Q@':
            self.status |= REMOTE
        elif body == b'R@':
            self.status &= ~REMOTE
        elif body == b'EB':
            self.status |= ARMED | READY
        elif body == b'EA':
            self.status &= ~(ARMED | READY)
        elif body == b'EH' and self.status & ARMED:
            self.fired.append(self.percent)
        elif body[:1] == b'@':
            self.percent = int(body[1:])
        data = self.celsius + b'000' if body == b'F@' else b''
        answer = framed(body[:1] + bytes([self.status]) + data)
        if self.garbled:
            answer = answer[:-1] + bytes([answer[-1] ^ 1])
        if not self.mute:
            os.write(self.master, answer)

    def close(self):
        self._open = False
        self.join()
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def instrument():
    playing = Instrument()
    playing.start()
    yield playing
    playing.close()


@pytest.fixture
def device(instrument):
    # a machine under load may hold the instrument up
    real = SerialDevice(instrument.port, timeout_s=5.0)
    real.open()
    yield real
    instrument.mute = False
    real.close()


def test_published_frames_have_their_published_check_bytes():
    assert framed(b'@050') == b'@050\x2a'
    assert framed(b'X@') == b'X@\x67'


def test_opening_takes_control_at_intensity_zero(instrument, device):
    assert device.real
    assert instrument.log == [b'Q@', b'EA', b'@000']
    assert instrument.status & REMOTE


def test_pulse_has_the_intensity_that_was_asked_for(instrument, device):
    device.arm()
    assert instrument.percent == 0
    device.prepare(0.5)
    given = device.fire(0.5, 100e-6)
    assert given.intensity == 0.5
    # 3 bytes of 10 bits at 9600 baud ahead of the trigger
    assert abs(given.time_ns - time.monotonic_ns()) < 1_000_000_000
    device.fire(0.5, 100e-6)
    device.prepare(0.254)
    device.fire(0.254, 100e-6)
    assert instrument.fired == [50, 50, 25]
    assert instrument.log.count(b'@050') == 1


def test_disarming_sets_zero_first_and_waits_for_nobody(instrument, device, wait_for):
    device.arm()
    device.prepare(0.5)
    device.fire(0.5, 100e-6)
    instrument.mute = True
    began = time.monotonic()
    device.silence()
    # less than the time-out of an exchange, 5 s
    assert time.monotonic() - began < 1.0
    wait_for(lambda: instrument.log[-2:] == [b'@000', b'EA'])
    assert not instrument.status & ARMED
    assert device.fire(0.5, 100e-6) is None
    assert instrument.fired == [50]
    # what was never answered is not waited for twice
    device._timeout_s = device._line.timeout = 0.01


def test_rearming_after_disarming_starts_from_zero(instrument, device):
    device.arm()
    device.prepare(0.9)
    device.fire(0.9, 100e-6)
    device.silence()
    device.arm()
    assert instrument.percent == 0
    device.prepare(0.1)
    assert device.fire(0.1, 100e-6).intensity == 0.1


def test_temperature(instrument, device):
    assert device.keep_alive().temperature == 25.3
    instrument.celsius = b'xyz'
    with pytest.raises(DeviceError, match='expected a temperature, got'):
        device.keep_alive()


def test_coil_that_is_missing_and_errors_are_refused(instrument, device):
    instrument.status &= ~COIL_PRESENT
    with pytest.raises(DeviceError, match='expected an armed device with a coil, got status'):
        device.arm()
    instrument.status |= COIL_PRESENT | ERROR
    with pytest.raises(DeviceError, match='expected an armed device with a coil, got status'):
        device.arm()
    assert device.keep_alive().error


def test_silence_and_noise_on_the_line(instrument, device):
    device.arm()
    device.prepare(0.5)
    instrument.garbled = True
    with pytest.raises(DeviceError, match='a check byte that fits'):
        device.fire(0.5, 100e-6)
    instrument.garbled, instrument.mute = False, True
    device._line.timeout = 0.1
    with pytest.raises(DeviceError, match=r"expected 3 bytes that begin with b'Q' .* got b''"):
        device.keep_alive()


def test_device_that_disarmed_by_itself_gives_no_pulse(instrument, device):
    device.arm()
    instrument.status &= ~ARMED
    device.prepare(0.5)
    assert device.fire(0.5, 100e-6) is None


def test_port_that_is_not_there(tmp_path):
    absent = SerialDevice(str(tmp_path / 'ttyUSB9'))
    with pytest.raises(DeviceError, match=r'expected a serial port, got .*ttyUSB9'):
        absent.open()
    with pytest.raises(DeviceError, match='expected an open serial line, got a closed one'):
        absent.keep_alive()
    absent.silence()
    absent.close()


def test_device_that_gives_no_remote_control(instrument):
    instrument.status = COIL_PRESENT
    instrument._obey = lambda frame: os.write(
        instrument.master, framed(frame[:1] + bytes([COIL_PRESENT]))
    )
    stubborn = SerialDevice(instrument.port, timeout_s=5.0)
    with pytest.raises(DeviceError, match='expected remote control, got status 0x08'):
        stubborn.open()
    stubborn.close()


def test_whole_driver_on_the_line(instrument, wait_for):
    controller = StimulationController(
        SerialDevice(instrument.port, timeout_s=5.0),
        load_device_specification('rapid2-240v'),
        # a machine under load may hold up a thread or two
        DriverSettings(heartbeat_timeout_s=0.0, lateness_limit_s=0.1, response_limit_s=1.0),
    )
    fired = []
    threads = [PulseThread(controller, fired.append), SupervisorThread(controller)]
    controller.configure()
    controller.supervise()
    for thread in threads:
        thread.start()

    def alive():
        controller.seen(EXECUTOR)
        return True

    alive()
    controller.arm()
    run = controller.start(constant(0.4, 0.5, 20.0))
    wait_for(lambda: alive() and bool(run.ended))
    assert run.ended == 'completed'
    assert instrument.fired == [40] * 10
    assert {pulse.delivery.intensity for pulse in fired} == {0.4}
    controller.start(constant(0.4, 5.0, 20.0))
    wait_for(lambda: alive() and len(instrument.fired) > 12)
    controller.stop('test', 'a test')
    wait_for(lambda: instrument.log[-2:] == [b'@000', b'EA'] or instrument.log[-1] == b'F@')
    assert not instrument.status & ARMED
    stopped = len(instrument.fired)
    for thread in threads:
        thread.close()
    controller.cleanup()
    wait_for(lambda: instrument.log[-1] == b'R@')
    assert len(instrument.fired) == stopped
    assert controller.state is State.UNCONFIGURED
