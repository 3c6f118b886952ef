# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Devices by name, one of them from a distribution outside of the package."""

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.devices import SimulatedDevice, registry
from rpms_ros.stimulation.devices.registry import DeviceOptions
from rpms_ros.stimulation.devices.serial_line import SerialDevice

MODULE = """
from rpms_ros.stimulation.devices import SimulatedDevice

class AcmeDevice(SimulatedDevice):
    def __init__(self, options):
        super().__init__(steps=200)
        self.options = options

class Half:
    real = True
    def open(self): ...

def half(options):
    return Half()

not_callable = 7
"""


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


def test_driver_takes_a_device_from_outside_by_its_name(distribution):
    from rpms_ros.errors import NodeError
    from rpms_ros.nodes.driver.parameters import DriverParameters, build_device
    from rpms_ros.stimulation.limits.device_specification import load_device_specification

    distribution('acme = acme_stimulator:AcmeDevice')
    # whatever is not `simulated` is held to what a real device needs
    with pytest.raises(NodeError, match='with a real device, got'):
        DriverParameters(device='acme', autostart=True)
    settings = DriverParameters()
    object.__setattr__(settings, 'device', 'acme')
    specification = load_device_specification('simulated')
    assert type(build_device(settings, specification)).__name__ == 'AcmeDevice'


def test_unknown_name():
    with pytest.raises(
        StimulationError, match=r"device: expected one of .*serial.*simulated.*, got 'acme'"
    ):
        registry.build_device('acme', DeviceOptions())


def test_name_that_two_distributions_claim(distribution):
    distribution('simulated = acme_stimulator:AcmeDevice')
    with pytest.raises(
        StimulationError,
        match=r"device: expected one of the name 'simulated', got acme.* and rpms",
    ):
        registry.build_device('simulated', DeviceOptions())


@pytest.mark.parametrize(
    ('target', 'match'),
    [
        ('acme_stimulator:Nothing', r"expected the device 'acme' at .*, got AttributeError"),
        ('acme_nowhere:AcmeDevice', r"expected the device 'acme' at .*, got ModuleNotFoundError"),
        ('acme_stimulator:not_callable', r"expected the device 'acme' at .*, got TypeError"),
        (
            'acme_stimulator:half',
            r'expected a device at .*, got Half without arm, arm_s, beat, .*, trigger_s',
        ),
    ],
)
def test_device_that_cannot_be_had(distribution, target, match):
    distribution(f'acme = {target}')
    with pytest.raises(StimulationError, match=match):
        registry.build_device('acme', DeviceOptions())
