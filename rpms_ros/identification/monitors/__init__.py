# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Monitors of a stream: checks of the sensor, and those registered by other packages.

A package adds one by an entry point of the group ``rpms_ros.monitors``: its name is what
`StreamSettings.monitors` and the identifier's parameter call it, its object a class derived from
`Monitor` that is called without arguments.
"""

from collections.abc import Callable
from collections.abc import Sequence
from importlib.metadata import entry_points

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.monitors.alternation import Alternation
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import ProcessedSamples
from rpms_ros.identification.monitors.interface import Window
from rpms_ros.identification.monitors.outliers import Outliers
from rpms_ros.identification.monitors.residuals import Unexplained
from rpms_ros.identification.monitors.spikes import Spikes
from rpms_ros.identification.monitors.stuck import ClippedSensor
from rpms_ros.identification.monitors.stuck import ConstantForce
from rpms_ros.identification.monitors.stuck import FrozenSensor

__all__ = [
    'MONITORS',
    'Monitor',
    'ProcessedSamples',
    'Window',
    'monitors_by_name',
]

GROUP = 'rpms_ros.monitors'

MONITORS: dict[str, Callable[[], Monitor]] = {
    'spikes': Spikes,
    'outliers': Outliers,
    'alternation': Alternation,
    'frozen': FrozenSensor,
    'clipped': ClippedSensor,
    'constant': ConstantForce,
    'unexplained': Unexplained,
}
"""Functions that build a fresh monitor of this package, by name."""


def monitors_by_name(names: Sequence[str]) -> list[Monitor]:
    """Return fresh monitors, of this package or registered by others.

    Raises
    ------
    IdentificationError
        If there is none of that name, or it is not a `Monitor`.
    """
    registered = {point.name: point for point in entry_points(group=GROUP)}
    monitors = []
    for name in names:
        if name in MONITORS:
            monitors.append(MONITORS[name]())
        elif name in registered:
            monitors.append(_made(name, registered[name].load()))
        else:
            known = ', '.join(sorted({*MONITORS, *registered}))
            raise IdentificationError(f'expected monitors of {known}, got {name!r}')
    return monitors


def _made(name: str, build: Callable[[], object]) -> Monitor:
    monitor = build()
    if not isinstance(monitor, Monitor):
        raise IdentificationError(
            f'expected a Monitor behind the entry point {name}, got {type(monitor).__name__}'
        )
    return monitor
