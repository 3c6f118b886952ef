# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a driver: its level goes up and comes down again, its name is its own."""

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.nodes.driver.reports import DriverDiagnostics
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.states import DriverSettings
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger

SECOND = 1_000_000_000


@pytest.fixture
def controller():
    return StimulationController(
        SimulatedDevice(),
        load_device_specification('simulated'),
        DriverSettings(),
        ledger=MemoryLedger(),
    )


def level(diagnostics, note='', now_ns=0):
    return diagnostics.message(Time(), note, now_ns).status[0].level


def test_a_warning_clears(controller):
    diagnostics = DriverDiagnostics(controller, '/ward/driver', 'simulated')
    assert level(diagnostics) == DiagnosticStatus.OK
    controller.dropped = 1
    assert level(diagnostics, now_ns=SECOND) == DiagnosticStatus.WARN
    assert level(diagnostics, now_ns=10 * SECOND) == DiagnosticStatus.WARN
    assert level(diagnostics, now_ns=11 * SECOND) == DiagnosticStatus.OK
    assert level(diagnostics, note='refused', now_ns=11 * SECOND) == DiagnosticStatus.WARN
    controller.interlocks.latch('stop', 'a stop')
    assert level(diagnostics, now_ns=11 * SECOND) == DiagnosticStatus.WARN


def test_the_name_is_that_of_the_node_and_text_can_be_sent(controller):
    status = DriverDiagnostics(controller, '/ward/driver', 'simulated').message(
        Time(), 'refused: \ud800\n', 0
    )
    (only,) = status.status
    assert only.name == '/ward/driver: stimulator'
    assert only.message.endswith('; refused: ? ')
