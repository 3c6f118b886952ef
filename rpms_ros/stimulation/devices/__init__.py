"""Stimulators behind one small interface."""

from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.devices.simulated import SimulatedFaults

__all__ = ['Delivery', 'Device', 'DeviceError', 'SimulatedDevice', 'SimulatedFaults']
