# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of a driver that belong to neither a schedule nor a device."""

from dataclasses import dataclass

from rpms_ros.stimulation.fields import Bound
from rpms_ros.stimulation.fields import bounded
from rpms_ros.stimulation.fields import check_bounds

_SECONDS = Bound(0.0, 10.0, 's', above=True)


@dataclass(frozen=True)
class DriverSettings:
    """How a driver watches over itself.

    Attributes
    ----------
    lead_s : float
        From the acceptance of a schedule to its beginning [s].
    lateness_limit_s : float
        A pulse later than this is dropped, not sent [s].
    response_limit_s : float
        Longest time from a command to the pulse; more is a fault [s].  Without real-time priority
        the operating system alone may hold a thread up for tens of milliseconds.
    stuck_limit_s : float
        Longest time that a command may hang before the device is silenced [s].
    open_limit_s : float
        The same for opening and closing the device [s].
    intensity_tolerance : float
        Largest difference between commanded and delivered intensity (share); more is a fault.
    executor_timeout_s : float
        Longest silence of the executor that serves stops and cancels [s]; after 0.4 of it pulses
        are held back.
    supervisor_timeout_s : float
        Longest silence of the thread that watches over the others [s].
    force_limit_n : float
        Largest force, or torque [N, or `force_unit`]; 0 watches none.
    force_timeout_s : float
        Longest silence of the force sensor when a force limit is set [s].
    force_unit : str
        In which the sensor measures, for messages.
    keep_alive_s : float
        Time between two signs of life to an armed device [s].
    temperature_limit : float
        Coil temperature at which it is stopped [Celsius].
    prepare_s : float
        How long before its trigger the intensity of a pulse is set, at least; in a longer pause
        the intensity is zero [s].
    reserve_s : float
        How far ahead pulses are put into the dose ledger [s].
    """

    lead_s: float = bounded(_SECONDS, 0.05)
    lateness_limit_s: float = bounded(Bound(0.0, 0.1, 's', above=True), 10e-3)
    response_limit_s: float = bounded(_SECONDS, 0.1)
    stuck_limit_s: float = bounded(_SECONDS, 0.2)
    open_limit_s: float = bounded(_SECONDS, 5.0)
    # the device is told a number that it can be set to: what is left is rounding
    intensity_tolerance: float = bounded(Bound(0.0, 1.0), 0.005)
    executor_timeout_s: float = bounded(_SECONDS, 0.5)
    supervisor_timeout_s: float = bounded(_SECONDS, 0.5)
    force_limit_n: float = bounded(Bound(0.0, 1e5, 'N'), 0.0)
    force_timeout_s: float = bounded(_SECONDS, 0.2)
    force_unit: str = 'N'
    keep_alive_s: float = bounded(_SECONDS, 0.4)
    temperature_limit: float = bounded(Bound(-20.0, 100.0, 'Celsius'), 40.0)
    prepare_s: float = bounded(_SECONDS, 0.1)
    reserve_s: float = bounded(_SECONDS, 1.0)

    def __post_init__(self) -> None:
        check_bounds(self)
