# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulators behind one small interface."""

from rpms_ros.stimulation.devices.registry import (
    UNVERIFIED,
    Delivery,
    Device,
    DeviceError,
    DeviceStatus,
    TooLate,
)
from rpms_ros.stimulation.devices.simulated import SimulatedDevice

__all__ = [
    'UNVERIFIED',
    'Delivery',
    'Device',
    'DeviceError',
    'DeviceStatus',
    'SimulatedDevice',
    'TooLate',
]
