"""Diagnostics of a stimulator driver: one status with a level, and the figures behind it."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue

from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.states import State


def diagnostics_message(
    controller: StimulationController, name: str, hardware: str, stamp: Any, note: str
) -> DiagnosticArray:
    """Return the diagnostics of `controller` at `stamp`.

    Error in the fault state, a warning while a stop is latched or once a pulse was dropped or
    something refused, ok otherwise.
    """
    state, latched, reason = controller.status()
    level = DiagnosticStatus.OK
    if latched or note or controller.dropped:
        level = DiagnosticStatus.WARN
    if state is State.FAULT:
        level = DiagnosticStatus.ERROR
    figures: dict[str, object] = {
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
    status = DiagnosticStatus(
        level=level,
        name=f'{name}: stimulator',
        message=f'{reason}; {note}' if note else reason,
        hardware_id=hardware,
        values=[KeyValue(key=key, value=str(value)) for key, value in figures.items()],
    )
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array
