"""Diagnostics of an identifier: one status with a level, and the figures behind it."""

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue

from rpms_ros.identification import Estimate


def diagnostics_message(
    name: str, stamp: Any, estimate: Estimate | None, faults: Mapping[str, int], silent: bool
) -> DiagnosticArray:
    """Return the diagnostics of the identifier `name` at `stamp`.

    Stale while no force comes, a warning while the newest estimate is in doubt, ok otherwise.
    """
    level, text = DiagnosticStatus.OK, 'identifying'
    if estimate is None:
        text = 'no estimate yet'
    elif estimate.doubts:
        level, text = DiagnosticStatus.WARN, f'in doubt: {", ".join(estimate.doubts)}'
    if silent:
        level, text = DiagnosticStatus.STALE, 'no force'
    figures: dict[str, object] = {}
    if estimate is not None:
        figures = {
            'estimator': estimate.estimator,
            'samples': estimate.samples,
            'pulses': estimate.pulses,
            'output error': f'{estimate.output_error:.4g}',
            'curve known': estimate.curve_known,
        }
    figures |= {f'fault {fault}': count for fault, count in faults.items()}
    status = DiagnosticStatus(
        level=level,
        name=f'{name}: identification',
        message=text,
        values=[KeyValue(key=key, value=str(value)) for key, value in figures.items()],
    )
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array
