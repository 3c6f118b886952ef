# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a file of a laboratory holds: signals with names and units, and times of events."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray

_BRACKETS = re.compile(r'^.*[\[(]\s*([^\])]*?)\s*[\])]\s*$')
_ENDING = re.compile(
    r'^.*[_/ ]\s*(us|ms|s|mN|kN|N|mV|V|g|kg|gf|kgf|lbf|Nm|mNm|kNm|kgm|ft-lbs?|ft-lbf)$'
)

# The unit of a column of clock times, whose values are seconds whatever its title says.
TIME_OF_DAY = 'h:m:s'


@dataclass(frozen=True)
class Signal:
    """A sampled signal.

    Attributes
    ----------
    name : str
        As in the file.
    values : ndarray (samples,)
        In the unit of the file; not a number where a sample is missing.
    unit : str
        As the file states it; empty if it does not.
    time : ndarray (samples,) or None
        Times of the samples [s]; None in a table whose time is one of its columns.
    """

    name: str
    values: FloatArray
    unit: str = ''
    time: FloatArray | None = None


@dataclass(frozen=True)
class Events:
    """Times of events, such as triggers [s]."""

    name: str
    time: FloatArray


@dataclass(frozen=True)
class SignalFile:
    """Everything in a file that could be force, gate, trigger or time.

    Attributes
    ----------
    path : Path
        The file.
    kind : str
        What it is, for people.
    signals : tuple of Signal
        In the order of the file.
    events : tuple of Events
        Lists of times.
    sampling_rate_hz : float or None
        Rate that the file states for signals without times [Hz].
    facts : tuple of str
        How it was read: encoding, separators.
    """

    path: Path
    kind: str
    signals: tuple[Signal, ...]
    events: tuple[Events, ...] = ()
    sampling_rate_hz: float | None = None
    facts: tuple[str, ...] = field(default=())


def unit_of(name: str) -> str:
    """Return the unit that a name ends with, as in ``Force [N]`` or ``time_ms``; empty if none."""
    found = _BRACKETS.match(name) or _ENDING.match(name)
    return found[1] if found else ''


def unlike(names: list[str]) -> list[str]:
    """Return names of which no two are the same: later ones get a number."""
    seen: dict[str, int] = {}
    result = []
    for index, name in enumerate(names):
        plain = name.strip() or f'column {index + 1}'
        seen[plain] = seen.get(plain, 0) + 1
        result.append(plain if seen[plain] == 1 else f'{plain} ({seen[plain]})')
    return result


def as_samples(values: object) -> FloatArray | None:
    """Return a vector of numbers (samples,); None if it is none."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    array = np.squeeze(array)
    return np.ascontiguousarray(array) if array.ndim == 1 and len(array) > 1 else None


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


class Ambiguous(RecordingError):
    """More than one signal, or none, could be what is looked for.

    Attributes
    ----------
    option : str
        The option that decides.
    candidates : tuple of str
        Names to choose from.
    decided : tuple of (str, str)
        What was guessed before it came to this, and why.
    """

    def __init__(self, message: str, option: str, candidates: Sequence[str]) -> None:
        super().__init__(message)
        self.option = option
        self.candidates = tuple(candidates)
        self.decided: tuple[tuple[str, str], ...] = ()


def needed(load: Callable[[str], Any], package: str, what: str) -> Any:
    """Return a package that reading `what` needs.

    Raises
    ------
    RecordingError
        If it is not installed.
    """
    try:
        return load(package)
    except ModuleNotFoundError as error:
        raise RecordingError(
            f'expected {package} for {what}, got {error}: '
            "python3 -m pip install 'rpms_ros[formats]' installs it"
        ) from error
