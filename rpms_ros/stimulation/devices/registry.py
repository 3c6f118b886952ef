# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Devices by name: those of this package and those that other distributions bring.

A device is a callable that takes `DeviceOptions`, named by an entry point of the group
``rpms_ros.devices``.  Those of this package are registered in the same way.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from importlib.metadata import entry_points

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.devices.interface import Device

GROUP = 'rpms_ros.devices'
_METHODS = (
    'arm', 'beat', 'close', 'fire', 'keep_alive', 'open', 'prepare', 'quantized', 'rest',
    'silence',
)  # fmt: skip
_FIGURES = ('arm_s', 'prepare_s', 'real', 'sets_width', 'trigger_s')


@dataclass(frozen=True)
class DeviceOptions:
    """What a driver tells the device that it builds; a device uses what it needs.

    Attributes
    ----------
    port : str
        Where it is connected, e.g. a serial port.
    maximum_intensity : float
        Hard bound on the intensity (share), the tightest of device specification, patient and
        parameter, for a device that can hold it by itself.
    """

    port: str = ''
    maximum_intensity: float = 1.0


DeviceBuilder = Callable[[DeviceOptions], Device]


def require_device(name: str) -> None:
    """Raise StimulationError unless a device of this name is installed, by one distribution."""
    registered = _registered()
    if name not in registered:
        names = ', '.join(sorted(registered))
        raise StimulationError(f'device: expected one of {names}, got {name!r}')
    targets = sorted({point.value for point in registered[name]})
    if len(targets) > 1:
        raise StimulationError(
            f'device: expected one of the name {name!r}, got {" and ".join(targets)}'
        )


def build_device(name: str, options: DeviceOptions) -> Device:
    """Return the device of this name, not open yet.

    Raises
    ------
    StimulationError
        If there is no such device, more than one, or it cannot be loaded or is none.
    """
    require_device(name)
    point = _registered()[name][0]
    try:
        builder: DeviceBuilder = point.load()
        device = builder(options)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise StimulationError(
            f'expected the device {name!r} at {point.value}, got {type(error).__name__}: {error}'
        ) from error
    lacking = [part for part in _METHODS if not callable(getattr(device, part, None))]
    lacking += [part for part in _FIGURES if not hasattr(device, part)]
    if lacking:
        raise StimulationError(
            f'expected a device at {point.value}, got {type(device).__name__} without '
            f'{", ".join(lacking)}'
        )
    return device


def _registered() -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=GROUP):
        found.setdefault(point.name, []).append(point)
    return found
