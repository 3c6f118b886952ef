# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Devices by name, one of them from outside, and frames of the Rapid2 class."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.guard import rapid2_protocol as rapid2
from rpms_ros.guard.rapid2_protocol import framed
from rpms_ros.stimulation.devices import registry
from rpms_ros.stimulation.devices.rapid2 import SerialDevice
from rpms_ros.stimulation.devices.registry import DeviceOptions, TooLate, quantized_down
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.limits.device_specification import load_device_specification

MODULE = """
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.devices.registry import quantized_down

class AcmeDevice(SimulatedDevice):
    def __init__(self, options):
        super().__init__()
        self.options = options
    def quantized(self, intensity):
        return quantized_down(intensity, 200)

class Half:
    real = True
    def open(self): ...

def half(options):
    return Half()

not_callable = 7
"""
WIDTH = 100e-6
HELD = rapid2.REMOTE | rapid2.COIL_PRESENT


@pytest.fixture
def distribution(tmp_path, monkeypatch):
    """Put a distribution with these entry points on the path."""

    def install(entry_points, name='acme_stimulator'):
        folder = tmp_path / name
        metadata = folder / f'{name}-1.0.dist-info'
        metadata.mkdir(parents=True)
        (folder / f'{name}.py').write_text(MODULE)
        (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
        (metadata / 'entry_points.txt').write_text(f'[rpms_ros.devices]\n{entry_points}\n')
        monkeypatch.syspath_prepend(folder)

    return install


def test_devices_of_the_package_are_registered_like_any_other():
    registry.require_device('serial')
    assert type(registry.build_device('simulated', DeviceOptions())) is SimulatedDevice
    device = registry.build_device('serial', DeviceOptions('/dev/ttyUSB7', 0.455))
    assert type(device) is SerialDevice
    assert device._line.port == '/dev/ttyUSB7'
    assert device._line.limits.maximum_percent == 45


def test_device_from_outside_of_the_package(distribution):
    from rpms_ros.errors import NodeError
    from rpms_ros.nodes.driver.parameters import DriverParameters, build_device

    with pytest.raises(StimulationError, match=r'device: expected one of serial, simulated'):
        registry.require_device('acme')
    distribution('acme = acme_stimulator:AcmeDevice')
    registry.require_device('acme')
    options = DeviceOptions('usb:3', 0.5)
    device = registry.build_device('acme', options)
    assert type(device).__name__ == 'AcmeDevice'
    assert device.options == options
    device.open()
    assert device.arm().armed
    assert device.quantized(0.4567) == 0.455
    # whatever is not `simulated` is held to what a real device needs
    with pytest.raises(NodeError, match='with a real device, got'):
        DriverParameters(device='acme', autostart=True)
    settings = DriverParameters()
    object.__setattr__(settings, 'device', 'acme')
    specification = load_device_specification('simulated')
    assert type(build_device(settings, specification)).__name__ == 'AcmeDevice'


@pytest.mark.parametrize(
    ('name', 'target', 'match'),
    [
        ('acme', 'stimulator:Nothing', "expected the device 'acme' at .*, got AttributeError"),
        ('acme', 'nowhere:Acme', "expected the device 'acme' at .*, got ModuleNotFoundError"),
        ('acme', 'stimulator:not_callable', "expected the device 'acme' at .*, got TypeError"),
        ('acme', 'stimulator:half', 'expected a device at .*, got Half without arm, .* trigger_s'),
        ('simulated', 'stimulator:AcmeDevice', "one of the name 'simulated', got acme.* and rpms"),
    ],
)
def test_device_that_cannot_be_had(distribution, name, target, match):
    distribution(f'{name} = acme_{target}')
    with pytest.raises(StimulationError, match=match):
        registry.build_device(name, DeviceOptions())


@given(st.floats(0.0, 1.0), st.sampled_from([1, 3, 7, 100, 255]))
def test_a_quantized_intensity_is_the_largest_step_not_above(intensity, steps):
    found = quantized_down(intensity, steps)
    assert found in [step / steps for step in range(steps + 1)]
    assert found <= intensity
    assert quantized_down(np.array([intensity]), steps).tolist() == [found]
    assert found == 1.0 or round(found * steps + 1) / steps > intensity


def test_every_percent_stays_what_it_is():
    percents = [percent / 100 for percent in range(101)]
    assert [quantized_down(percent, 100) for percent in percents] == percents
    assert [quantized_down(percent + 0.005, 100) for percent in percents[:-1]] == percents[:-1]


def test_trigger_after_its_latest_time_is_not_given():
    device = SimulatedDevice(clock=lambda: 0)
    device.open()
    device.arm()
    device.prepare(0.5)
    assert device.fire(0.5, WIDTH, 0) is not None
    with pytest.raises(TooLate, match='expected a trigger until -1 ns, got one at 0'):
        device.fire(0.5, WIDTH, -1)


def test_published_frames_have_their_check_bytes_and_answers_status_and_data():
    assert framed(b'@050') == b'@050\x2a'
    assert framed(b'X@') == b'X@\x67'
    assert framed(b'Q@') == b'Q@n'
    answer = rapid2.parsed(b'EH', framed(b'E' + bytes([HELD | rapid2.READY])), 3)
    assert answer == (HELD | rapid2.READY, b'')
    assert rapid2.parsed(b'F@', framed(b'F' + bytes([HELD]) + b'253251'), 9).data == b'253251'


@pytest.mark.parametrize('command', [b'EH', b'@020', b'F@', b'\\@', b'Q@'])
@pytest.mark.parametrize(('letter', 'why'), [(b'S', 'does not suit'), (b'?', 'does not accept')])
def test_a_refusal_is_never_a_status(command, letter, why):
    # both letters have the bit of an armed device
    assert letter[0] & rapid2.ARMED
    refusal = framed(command[:1] + letter)
    for length in (3, 9, 22, rapid2.UNTIL_ZERO):
        assert rapid2.complete(refusal, length)
    with pytest.raises(ValueError, match=f'expected the instrument to obey .*{why}'):
        rapid2.parsed(command, refusal, 3)
    # not even where its check byte is wrong, or it is cut
    for broken in (refusal[:2] + b'\0', refusal[:2]):
        with pytest.raises(ValueError, match='expected'):
            rapid2.parsed(command, broken, 3)


def test_status_without_remote_control_or_against_itself():
    with pytest.raises(ValueError, match='expected remote control, got status 0x08 to EH'):
        rapid2.parsed(b'EH', framed(b'E' + bytes([rapid2.COIL_PRESENT])), 3)
    both = HELD | rapid2.STANDBY | rapid2.READY
    with pytest.raises(ValueError, match='expected standby or armed, got both'):
        rapid2.parsed(b'EH', framed(b'E' + bytes([both])), 3)


@given(st.binary(max_size=12))
def test_any_bytes_are_an_answer_or_an_error(raw):
    # as many bytes as there are, so that the length alone does not refuse them
    sound = len(raw) >= 3 and raw[:1] == b'E' and framed(raw[:-1]) == raw
    held = sound and raw[1] & rapid2.REMOTE
    if held and not (raw[1] & rapid2.STANDBY and raw[1] & (rapid2.ARMED | rapid2.READY)):
        assert rapid2.parsed(b'EH', raw, len(raw)) == (raw[1], raw[2:-1])
    else:
        with pytest.raises(ValueError, match='expected'):
            rapid2.parsed(b'EH', raw, len(raw))


def test_every_percent_is_a_command_and_nothing_else_is():
    for percent in range(101):
        assert rapid2.percent_of(rapid2.power(percent)) == percent
        assert rapid2.command_of(framed(rapid2.power(percent))) == rapid2.power(percent)
    for none in (b'@101', b'@1 0', b'@+10', b'@-01', b'A050', '@٠٥٠'.encode()):
        assert rapid2.percent_of(none) is None
    with pytest.raises(ValueError, match=r'expected an intensity in 0\.\.100 percent, got 101'):
        rapid2.power(101)


def test_numbers_in_the_data():
    assert rapid2.set_percent(b'\x38040001000100100001') == 40
    assert rapid2.celsius(b'253401') == 40.1
    for answer in (b'', b'N', framed(b'Nabc\0'), framed(b'N\0'), b'N7.1\0\0'):
        with pytest.raises(ValueError, match='expected a version'):
            rapid2.version_of(answer)
    with pytest.raises(ValueError, match='expected an intensity in percent, got'):
        rapid2.set_percent(b'\x38 40')
    with pytest.raises(ValueError, match='expected two temperatures in tenths of a degree, got'):
        rapid2.celsius(b'25325x')
