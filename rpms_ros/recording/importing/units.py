# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Units of times, forces and torques in files of laboratories."""

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'min': 60.0}
FORCE_UNITS = {
    'N': 1.0,
    'mN': 1e-3,
    'kN': 1e3,
    'g': 9.80665e-3,
    'kg': 9.80665,
    'lbf': 4.4482216152605,
}
"""Newtons of each unit; grams are the weight of so much mass."""
TORQUE_UNITS = {'Nm': 1.0, 'mNm': 1e-3, 'kNm': 1e3, 'kgm': 9.80665, 'ft-lbf': 1.3558179483314004}
"""Newton metres of each unit of a dynamometer's torque."""
SENSOR_UNITS = FORCE_UNITS | TORQUE_UNITS
_SYNONYMS = {
    'sec': 's', 'seconds': 's', 'second': 's', 'µs': 'us', 'μs': 'us', 'gf': 'g', 'kgf': 'kg',
    'N m': 'Nm', 'N·m': 'Nm', 'N*m': 'Nm', 'N.m': 'Nm', 'N-m': 'Nm', 'mN m': 'mNm', 'kg m': 'kgm',
    'ft lbf': 'ft-lbf', 'ft-lb': 'ft-lbf', 'ft-lbs': 'ft-lbf', 'ft lb': 'ft-lbf',
    'lbf-ft': 'ft-lbf',
}  # fmt: skip


def usual_unit(unit: str) -> str:
    """Return the name that a unit has here: ``s`` for ``sec``; an unknown one as it is."""
    return _SYNONYMS.get(unit, unit)
