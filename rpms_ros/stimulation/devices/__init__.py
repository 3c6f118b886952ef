# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulators behind one small interface."""

from rpms_ros.stimulation.devices.interface import UNVERIFIED
from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.devices.interface import DeviceStatus
from rpms_ros.stimulation.devices.interface import TooLate
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.devices.simulated import SimulatedFaults
from rpms_ros.stimulation.devices.simulated import WireTimes

__all__ = [
    'UNVERIFIED',
    'Delivery',
    'Device',
    'DeviceError',
    'DeviceStatus',
    'SimulatedDevice',
    'SimulatedFaults',
    'TooLate',
    'WireTimes',
]
