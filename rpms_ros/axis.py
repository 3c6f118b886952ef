# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Axes of a sensor as people write them: one parser for nodes, recordings and commands.

A sensor measures a force, or a torque as an isometric dynamometer does; `UNITS` names both.
"""

import math
from collections.abc import Sequence
from typing import Any

from rpms_ros.errors import AxisError

Axis = tuple[float, float, float]

FORCE = 'force'
TORQUE = 'torque'
UNITS: dict[str, str] = {FORCE: 'N', TORQUE: 'N m'}
"""Unit of what is measured, by its name; both are fields of a wrench."""
QUANTITIES: dict[str, str] = {unit: name for name, unit in UNITS.items()}
"""What is measured, by its unit."""

AXES: dict[str, Axis] = {'x': (1.0, 0.0, 0.0), 'y': (0.0, 1.0, 0.0), 'z': (0.0, 0.0, 1.0)}
AXES |= {f'-{name}': (-x, -y, -z) for name, (x, y, z) in list(AXES.items())}


def unit_vector(axis: str | Sequence[float]) -> Axis:
    """Return the unit vector of ``x``, ``-z``, ``0.6,0,0.8`` or three numbers.

    Raises
    ------
    AxisError
        If it is no direction.
    """
    if isinstance(axis, str) and axis in AXES:
        return AXES[axis]
    parts = axis.split(',') if isinstance(axis, str) else axis
    try:
        vector = tuple(float(part) for part in parts)
    except (TypeError, ValueError):
        vector = ()
    length = math.hypot(*vector) if len(vector) == 3 else 0.0
    if not (math.isfinite(length) and length > 0.0):
        raise AxisError(f'expected axis x, y, z, -x or three numbers as 0.6,0,0.8, got {axis!r}')
    x, y, z = (value / length for value in vector)
    return (x, y, z)


def along(axis: Axis, components: Sequence[Any]) -> Any:
    """Return what three components are along an axis; each of them a number or an array.

    Those across it do not count, not even where they are not finite.
    """
    first, *others = (share * one for share, one in zip(axis, components, strict=True) if share)
    return sum(others, first)
