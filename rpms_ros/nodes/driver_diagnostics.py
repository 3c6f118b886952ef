"""Diagnostics of a stimulator driver: one status with a level, and the figures behind it."""

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue

from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.states import State

_REMEMBERED_NS = 10 * NANOSECONDS_PER_SECOND


class DriverDiagnostics:
    """Makes the diagnostics of one driver.

    Parameters
    ----------
    controller : StimulationController
        What decides.
    name : str
        Name of the node with its namespace: two drivers of one graph differ in it.
    hardware : str
        Kind of device, and its port.
    """

    def __init__(self, controller: StimulationController, name: str, hardware: str) -> None:
        self._controller = controller
        self._name = name
        self._hardware = hardware
        self._dropped = 0
        self._warned_ns: int | None = None

    def message(self, stamp: Any, note: str, now_ns: int | None = None) -> DiagnosticArray:
        """Return the diagnostics at `stamp`.

        Error in the fault state, a warning while a stop is latched or `note` says something, and
        for ten seconds after a pulse was dropped, ok otherwise.
        """
        controller = self._controller
        state, latched, reason = controller.status()
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        if controller.dropped != self._dropped:
            self._dropped, self._warned_ns = controller.dropped, now_ns
        recent = self._warned_ns is not None and now_ns - self._warned_ns < _REMEMBERED_NS
        level = DiagnosticStatus.WARN if latched or note or recent else DiagnosticStatus.OK
        if state is State.FAULT:
            level = DiagnosticStatus.ERROR
        status = DiagnosticStatus(
            level=level,
            name=f'{self._name}: stimulator',
            message=plain_text(f'{reason}; {note}' if note else reason),
            hardware_id=self._hardware,
            values=[
                KeyValue(key=key, value=plain_text(figure))
                for key, figure in self._figures().items()
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp
        return array

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
