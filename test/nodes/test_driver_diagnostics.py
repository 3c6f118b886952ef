# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a driver: its level goes up and comes down again."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.nodes.driver.reports import driver_health
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.states import DriverSettings
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger


@pytest.fixture
def controller():
    return StimulationController(
        SimulatedDevice(),
        load_device_specification('simulated'),
        DriverSettings(),
        ledger=MemoryLedger(),
    )


def test_a_warning_clears(controller):
    def level(lately=False, note=''):
        return driver_health(controller, lately, note).level

    assert level() == DiagnosticStatus.OK
    assert level(lately=True) == DiagnosticStatus.WARN
    assert level(note='refused') == DiagnosticStatus.WARN
    controller.interlocks.latch('stop', 'a stop')
    assert level() == DiagnosticStatus.WARN
    assert driver_health(controller, False, 'refused: x').message.endswith('; refused: x')
