# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a file of a laboratory holds: signals with names and units, and times of events."""

import re
from collections import Counter
from collections.abc import Container
from dataclasses import dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError, check_number
from rpms_ros.pulses import FloatArray

_BRACKETS = re.compile(r'[\[(]\s*([^\])]*?)\s*[\])]')
_ENDING = re.compile(
    r'^(?:.*[_/ ])?\s*(us|ms|s|mN|kN|N|mV|V|g|kg|gf|kgf|lbf|Nm|mNm|kNm|kgm|ft-lbs?|ft-lbf)$'
)

RISING, FALLING = 'rising', 'falling'
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
    facts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Give columns without a name one, and later ones of a name a number."""
        seen: Counter[str] = Counter()

        def unlike(one: Any, index: int) -> Any:
            plain = one.name.strip() or f'column {index + 1}'
            seen[plain] += 1
            return replace(one, name=plain if seen[plain] == 1 else f'{plain} ({seen[plain]})')

        for field in ('signals', 'events'):
            named = tuple(unlike(one, index) for index, one in enumerate(getattr(self, field)))
            object.__setattr__(self, field, named)

    def signal(self, name: str | None) -> Signal | None:
        """Return the signal of a name, None if there is none."""
        return next((one for one in self.signals if one.name == name), None)


def unit_of(name: str) -> str:
    """Return the unit in a name, as in ``Force [N]``, ``(kg) left`` or ``time_ms``; else empty.

    What is in brackets at the end counts also if it is no unit that is known.
    """
    told = _BRACKETS.findall(name)
    if known := {usual_unit(one) for one in told} & {*TIME_UNITS, *SENSOR_UNITS, 'V', 'mV', '%'}:
        return ' or '.join(sorted(known))
    if told and ('[' in name or name.rstrip().endswith(')')):
        return str(told[-1])
    found = _ENDING.match(name)
    return found[1] if found else ''


TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'min': 60.0}
_POUND = 4.4482216152605
FORCE_UNITS = {'N': 1.0, 'mN': 1e-3, 'kN': 1e3, 'g': 9.80665e-3, 'kg': 9.80665, 'lbf': _POUND}
"""Newtons of each unit; grams are the weight of so much mass."""
TORQUE_UNITS = {'Nm': 1.0, 'mNm': 1e-3, 'kNm': 1e3, 'kgm': 9.80665, 'ft-lbf': 1.3558179483314004}
"""Newton metres of each unit of a dynamometer's torque."""
SAMPLES = 'samples'
LIST_UNITS = (*TIME_UNITS, SAMPLES)
"""What a list of pulses may be in: times in a unit, or numbers of samples."""
SENSOR_UNITS = FORCE_UNITS | TORQUE_UNITS
UNSTATED = ('', '-', 'a.u.', 'au')
"""What stands for a unit where there is none."""
NO_TIME = (*UNSTATED, 'V')
"""The same for a time: a file may state volts for all that is in it."""
_SYNONYMS = {
    'sec': 's', 'seconds': 's', 'second': 's', 'msec': 'ms', 'milliseconds': 'ms', 'µs': 'us',
    'μs': 'us', 'usec': 'us', 'microseconds': 'us', 'minutes': 'min', 'gf': 'g', 'kgf': 'kg',
    'N m': 'Nm', 'N·m': 'Nm', 'N*m': 'Nm', 'N.m': 'Nm', 'N-m': 'Nm', 'mN m': 'mNm', 'kg m': 'kgm',
    'ft lbf': 'ft-lbf', 'ft-lb': 'ft-lbf', 'ft-lbs': 'ft-lbf', 'ft lb': 'ft-lbf',
    'lbf-ft': 'ft-lbf', 'Newton': 'N', 'newton': 'N', 'kilogram': 'kg',
}  # fmt: skip


def usual_unit(unit: str) -> str:
    """Return the name that a unit has here: ``s`` for ``sec``; an unknown one as it is."""
    return _SYNONYMS.get(unit, unit)


def unit_told(
    unit: str, given: str | None, option: str, units: Container[str]
) -> tuple[str, str] | None:
    """Return the unit that is given or stated by the file, and which; None if there is neither."""
    if given is not None:
        return given, f'as stated (--{option})'
    unit = usual_unit(unit)
    return (unit, 'as the file says') if unit in units else None


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """What is what in a file; what is None is guessed, or taken from the file.

    Attributes
    ----------
    time, force, pulse : str or None
        Names of the columns or signals; of the pulses also a list of trigger times.
    time_unit, force_unit : str or None
        Units.
    pulse_unit : str or None
        Unit of a list of trigger times; ``samples`` for numbers of samples.
    force_scale : float or None
        Newtons of one unit of the force signal; newton metres with a unit of a torque.
    sampling_rate : float or None
        Rate of a table without times [Hz].
    threshold : float or None
        Level of a gate between rest and pulse.
    edge : str or None
        Edge of a gate with which a pulse begins, ``rising`` or ``falling``; None for falling if
        the gate is high more than 90 % of the time, else rising.
    intensity : float or str
        Share of the stimulator's maximum of every pulse, 0 to 1; or a column with it,
        or a file with one a pulse, ``NAME/FULL`` if it is FULL at the maximum.
    block : int or None
        Block of a LabChart file, from 1.
    sheet : str or None
        Sheet of a workbook.
    """

    time: str | None = None
    force: str | None = None
    pulse: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pulse_unit: str | None = None
    force_scale: float | None = None
    sampling_rate: float | None = None
    threshold: float | None = None
    edge: str | None = None
    intensity: float | str = 1.0
    block: int | None = None
    sheet: str | None = None

    def __post_init__(self) -> None:
        """Refuse values that cannot be."""
        scale, rate = self.force_scale, self.sampling_rate
        if scale is not None and not (np.isfinite(scale) and scale != 0.0):
            raise RecordingError(f'expected a finite force_scale that is not 0, got {scale}')
        if rate is not None:
            check_number(RecordingError, 'sampling rate', rate, 0, above=True, unit='Hz')
        check_number(RecordingError, 'intensity', self.share, 0, 1)
        check_number(RecordingError, 'threshold', self.threshold or 0.0)
        if self.edge not in (None, RISING, FALLING):
            raise RecordingError(f'expected an edge rising or falling, got {self.edge!r}')

    @property
    def share(self) -> float:
        """Intensity of every pulse, 1 where a column or file has it."""
        return 1.0 if isinstance(self.intensity, str) else float(self.intensity)

    def given(self) -> list[str]:
        """Return the names of the options that are not left at their defaults."""
        return [one.name for one in fields(self) if getattr(self, one.name) != one.default]


class Ambiguous(RecordingError):
    """More than one signal, or none, could be what is looked for; the message names the option."""


def needed(package: str, what: str) -> Any:
    """Return a package that reading `what` needs.

    Raises
    ------
    RecordingError
        If it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        remedy = "python3 -m pip install 'rpms_ros[formats]' installs it"
        raise RecordingError(f'expected {package} for {what}, got {error}: {remedy}') from error
