# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a stimulator driver: one status with a level, and its figures."""

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus

from rpms_ros.nodes.diagnostics import Health
from rpms_ros.nodes.diagnostics import RecentChange
from rpms_ros.nodes.diagnostics import diagnostics_message
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.states import State

SIMULATED = 'simulated'


class DriverDiagnostics:
    """Makes the diagnostics of one driver.

    Parameters
    ----------
    controller : StimulationController
        What decides.
    name : str
        Name of the node with its namespace: two drivers of one graph differ in it.
    hardware : str
        Kind of device, and its port; a simulated one is known by its node.
    """

    def __init__(self, controller: StimulationController, name: str, hardware: str) -> None:
        self._controller = controller
        self._name = name
        self._hardware = f'{hardware} {name}' if hardware == SIMULATED else hardware
        self._dropped = RecentChange()

    def message(self, stamp: Any, note: str, now_ns: int | None = None) -> DiagnosticArray:
        """Return the diagnostics at `stamp`.

        Error in the fault state, a warning while a stop is latched or `note` says something, and
        for ten seconds after a pulse was dropped, ok otherwise.
        """
        state, latched, reason = self._controller.status()
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        recent = self._dropped.seen(self._controller.dropped, now_ns)
        level = DiagnosticStatus.WARN if latched or note or recent else DiagnosticStatus.OK
        if state is State.FAULT:
            level = DiagnosticStatus.ERROR
        said = f'{reason}; {note}' if note else reason
        health = Health(said, level, self._figures())
        return diagnostics_message(f'{self._name}: stimulator', self._hardware, stamp, health)

    def _figures(self) -> dict[str, object]:
        controller = self._controller
        state, latched, _ = controller.status()
        return {
            'state': 'STOPPED' if latched else state.name,
            'device specification': controller.specification.name,
            'pulses delivered': controller.delivered,
            'pulses dropped': controller.dropped,
            'lateness mean [s]': f'{controller.lateness.mean_s:.6f}',
            'lateness max [s]': f'{controller.lateness.max_s:.6f}',
            'energy [J]': f'{controller.limiter.session_energy_j:.1f}',
            'coil temperature [Celsius]': f'{controller.coil_temperature:.1f}',
            **{f'fault {fault}': count for fault, count in controller.fault_counts().items()},
        }
