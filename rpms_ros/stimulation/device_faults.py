# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults that a device reports."""

from rpms_ros.stimulation.devices.interface import DeviceStatus


def intensity_fault(given: float | None, expected: float | None, tolerance: float) -> str | None:
    """Return what is wrong with an intensity that was read back, None if no fault is known.

    Parameters
    ----------
    given : float or None
        What the device says (share).
    expected : float or None
        What it was set to (share).
    tolerance : float
        Largest difference that is rounding (share).
    """
    # written so that NaN is wrong
    if given is None or expected is None or abs(given - expected) <= tolerance:
        return None
    return f'expected intensity {expected:.3g} from the device, got {given:.3g}'


def fault_of(
    status: DeviceStatus, expected: float | None, tolerance: float
) -> tuple[str, str] | None:
    """Return name and reason of why an armed device must not fire, None if nothing is wrong.

    Whether it is charged is asked right before a pulse: after the one before it takes its time.
    """
    wrong = intensity_fault(status.intensity, expected, tolerance)
    if status.coil_present is False:
        return 'coil', 'expected a coil, got none'
    if status.replace_coil:
        return 'coil', 'expected a usable coil, got one to be replaced'
    if status.error:
        return 'error', 'expected a device without an error, got one'
    if status.armed is False:
        return 'armed', 'expected an armed device, got a disarmed one'
    return None if wrong is None else ('intensity', wrong)
