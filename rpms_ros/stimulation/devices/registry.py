# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Devices by name: those of this package and those that other distributions bring.

A device is a callable that takes `DeviceOptions`, named by an entry point of the group
``rpms_ros.devices``.  Those of this package are registered in the same way.

What a driver asks of a stimulator.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import FloatArray

Shares = TypeVar('Shares', float, FloatArray)
"""One intensity or an array of them (share)."""


class DeviceError(StimulationError):
    """A device did not answer, refused, or gave an answer that does not fit."""


class TooLate(DeviceError):
    """A trigger came after its latest time and was certainly not given to the device."""


class DeviceStatus(NamedTuple):
    """What a device says about itself; None where it cannot tell.

    Attributes
    ----------
    armed : bool or None
        Whether a trigger would give a pulse.
    ready : bool or None
        Whether it is charged.
    coil_present : bool or None
        Whether a coil is connected.
    replace_coil : bool or None
        Whether the coil has to be replaced.
    error : bool or None
        Whether it reports an error.
    intensity : float or None
        The intensity that is set in it, read back (share).
    temperature : float or None
        Of the coil [Celsius], measured by the call that returns it; None from every other call.
        One that was measured earlier must not come again: the driver goes on from it with its
        model of the coil, and would forget what the pulses since have warmed.
    """

    armed: bool | None = None
    ready: bool | None = None
    coil_present: bool | None = None
    replace_coil: bool | None = None
    error: bool | None = None
    intensity: float | None = None
    temperature: float | None = None


UNVERIFIED = ('delivery', 'intensity', 'coil', 'ready', 'error')
"""What a device may be unable to confirm for a pulse."""


class Delivery(NamedTuple):
    """What a device says it did.

    Attributes
    ----------
    time_ns : int
        Onset of the pulse on the driver's monotonic clock [ns].
    intensity : float
        Read back if the device can tell, else what was set (share).
    unverified : frozenset of str
        What of `UNVERIFIED` the device could not confirm for this pulse.
    """

    time_ns: int
    intensity: float
    unverified: frozenset[str] = frozenset()


class Device(Protocol):
    """A stimulator.  Every method but `silence` and `quantized` is called by its owner's thread.

    Whatever a method raises, of any type, is taken as a fault of the device, `TooLate` excepted.
    """

    @property
    def real(self) -> bool:
        """Whether it can hurt somebody."""

    @property
    def sets_width(self) -> bool:
        """Whether `fire` gives a pulse of the width that it is told.

        One that does not has a single width, and needs a device specification with that width as
        both ``minimum_width_s`` and ``maximum_width_s``.
        """

    @property
    def arm_s(self) -> float:
        """Longest time that `arm` may take, charging included [s]."""

    @property
    def prepare_s(self) -> float:
        """Longest time from the call of `prepare` to a device that is ready to fire [s]."""

    @property
    def trigger_s(self) -> float:
        """Time from the call of `fire` to the onset that the device takes for itself [s]."""

    @property
    def read_back_s(self) -> float:
        """Time that `read_back` takes [s]; ``inf`` for a device that it tells nothing new."""

    def quantized(self, intensity: Shares) -> Shares:
        """Return the largest intensities it can be set to that are not above ``intensity``."""

    def open(self) -> None:
        """Connect; intensity zero, disarmed."""

    def arm(self) -> DeviceStatus:
        """Make pulses possible, at intensity zero."""

    def prepare(self, intensity: float, spare_s: float = math.inf) -> DeviceStatus | None:
        """Set the intensity of the next pulse.

        Parameters
        ----------
        intensity : float
            Share of the maximum, as `quantized` returns it.
        spare_s : float
            Time left until the trigger [s]: what does not fit in is left out.
        """

    def fire(self, intensity: float, width_s: float, latest_ns: int | None) -> Delivery | None:
        """Trigger a pulse of the intensity that was prepared; return None if it did not come.

        Raises on any doubt: no coil or one to be replaced, an error, not ready, not armed, as far
        as the answer to the trigger tells.  Raises `TooLate` if the trigger could not be written
        before ``latest_ns``, monotonic clock [ns].
        """

    def read_back(self) -> DeviceStatus:
        """Return a status with the intensity that is set in the device, read from it now.

        Called right before a trigger, and after it if `fire` has left the intensity unverified.
        """

    def keep_alive(self) -> DeviceStatus:
        """Tell the device that its driver is there; an armed one disarms by itself without.

        A device that measures its coil does so here, at the latest when the last temperature is
        4 s old: the driver then calls this in a train too, and gives up a pulse if there is no
        room for it.
        """

    def beat(self) -> None:
        """Say that the owner is alive: at least every 50 ms, without waiting for anything."""

    def rest(self) -> None:
        """Set intensity zero, armed or not as it is."""

    def silence(self) -> None:
        """Set intensity zero, then disarm: by any thread, without waiting for an answer.

        Also while another call hangs, also twice.
        """

    def close(self) -> None:
        """Silence and close it."""


def quantized_down(intensity: Shares, steps: int) -> Shares:
    """Return the largest multiples of ``1 / steps`` that are not above ``intensity`` (share).

    A share that is written as a multiple, such as 0.29 of a hundred, stays what it is, although
    its product with the number of steps is rounded.
    """
    step = np.floor(np.multiply(intensity, steps))
    step = np.where((step + 1) / steps <= intensity, step + 1, step)
    found = np.where(step / steps > intensity, step - 1, step) / steps
    return found if isinstance(intensity, np.ndarray) else float(found)


GROUP = 'rpms_ros.devices'


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


def require_device(name: str) -> None:
    """Raise StimulationError unless a device of this name is installed, by one distribution."""
    registered = entry_points(group=GROUP)
    if name not in registered.names:
        names = ', '.join(sorted(registered.names))
        raise StimulationError(f'device: expected one of {names}, got {name!r}')
    targets = sorted({point.value for point in registered.select(name=name)})
    if len(targets) > 1:
        fault = f'device: expected one of the name {name!r}, got {" and ".join(targets)}'
        raise StimulationError(fault)


def build_device(name: str, options: DeviceOptions) -> Device:
    """Return the device of this name, not open yet.

    Raises
    ------
    StimulationError
        If there is no such device, more than one, or it cannot be loaded or is none.
    """
    require_device(name)
    (point, *_) = entry_points(group=GROUP, name=name)
    try:
        builder: Callable[[DeviceOptions], Device] = point.load()
        device = builder(options)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        fault = f'expected the device {name!r} at {point.value}'
        raise StimulationError(f'{fault}, got {type(error).__name__}: {error}') from error
    parts = sorted(part for part in vars(Device) if not part.startswith('_'))
    if lacking := [part for part in parts if getattr(device, part, None) is None]:
        raise StimulationError(
            f'expected a device at {point.value}, got {type(device).__name__} without '
            f'{", ".join(lacking)}'
        )
    return device
