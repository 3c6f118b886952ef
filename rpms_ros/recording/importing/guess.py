# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which signal is time, force and gate, and in which units: guessed, shown, decided by options."""

import re
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.axis import FORCE
from rpms_ros.axis import TORQUE
from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile

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
_TIME = re.compile(r'\b(t|time|zeit|temps|tiempo|timestamps?|seconds|sec)\b|time', re.IGNORECASE)
_FORCE = re.compile(
    r'force|kraft|fuerza|load|^f[xyzgm]|\bf\b|\bfz\b|strain|torque|moment', re.IGNORECASE
)
_PULSE = re.compile(r'stim|gate|trig|pulse|puls|sync|ttl|marker|digital', re.IGNORECASE)
# Sample periods of force in a recording, from 100 kHz to 100 Hz [s].
_SHORTEST, _LONGEST = 1e-5, 1.0000001e-2
_TWO_LEVELS = 0.9


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


@dataclass(frozen=True)
class Guess:
    """What is taken for what.

    Attributes
    ----------
    time : str or None
        Column of the time; None if signals have their own times or a rate is stated.
    time_unit : str
        One of `TIME_UNITS`.
    force, pulse : str
        Signals or, for the pulses, events.
    force_unit : str
        One of `FORCE_UNITS`, or of `TORQUE_UNITS` where a torque was measured.
    reasons : tuple of (str, str)
        What was guessed, and why.
    """

    time: str | None
    time_unit: str
    force: str
    force_unit: str
    pulse: str
    reasons: tuple[tuple[str, str], ...]

    @property
    def quantity(self) -> str:
        """What the sensor measured: ``force`` or ``torque``."""
        return TORQUE if self.force_unit in TORQUE_UNITS else FORCE


def guessed(
    file: SignalFile,
    time: str | None = None,
    force: str | None = None,
    pulse: str | None = None,
    time_unit: str | None = None,
    force_unit: str | None = None,
    sampling_rate_hz: float | None = None,
    force_scale: float | None = None,
) -> Guess:
    """Return what is taken for what; what is given is not guessed.

    Parameters
    ----------
    file : SignalFile
        What was read.
    time, force, pulse : str, optional
        Names of signals.
    time_unit, force_unit : str, optional
        Units.
    sampling_rate_hz : float, optional
        Rate of the samples of a table without times [Hz].
    force_scale : float, optional
        Newtons of one unit of the force signal; newton metres if `force_unit` is one of a torque.

    Raises
    ------
    Ambiguous
        If something cannot be guessed: the message names the option that decides.
    RecordingError
        If a name or unit that is given does not exist.
    """
    reasons: list[tuple[str, str]] = []
    try:
        return _guessed(
            file,
            reasons,
            (time, force, pulse),
            (time_unit, force_unit),
            sampling_rate_hz,
            force_scale,
        )
    except Ambiguous as error:
        error.decided = tuple(reasons)
        raise


def _guessed(
    file: SignalFile,
    reasons: list[tuple[str, str]],
    names: tuple[str | None, str | None, str | None],
    units: tuple[str | None, str | None],
    sampling_rate_hz: float | None,
    force_scale: float | None,
) -> Guess:
    """Return the guess, with reasons as they are found; names of time, force and pulses."""
    time, force, pulse = names
    signals = {signal.name: signal for signal in file.signals}
    _check_given(file, time, force, pulse)
    _check_unit(units[0], 'time', TIME_UNITS)
    _check_unit(units[1], 'force', SENSOR_UNITS)
    own_times = all(signal.time is not None for signal in file.signals)
    if time is None and not own_times and not (sampling_rate_hz or file.sampling_rate_hz):
        time = _time(file)
    rest = [signal for signal in file.signals if signal.name != time]
    unit = 's'
    if time is not None:
        unit, why = _time_unit(signals[time], units[0])
        reasons.append(('time', f'{time!r} in {unit}, {why}'))
    elif own_times:
        reasons.append(('time', 'of the file'))
    else:
        rate = sampling_rate_hz or file.sampling_rate_hz
        reasons.append(('time', f'{rate:g} samples a second'))
    if pulse is None:
        pulse = _pulse(file, [signal for signal in rest if signal.name != force])
    reasons.append(('pulses', repr(pulse)))
    if force is None:
        force = _force(file, [signal for signal in rest if signal.name != pulse])
    newton, why = _force_unit(signals[force], units[1], force_scale)
    reasons.insert(1, ('force', f'{force!r} in {newton}, {why}'))
    return Guess(time, unit, force, newton, pulse, tuple(reasons))


def _check_given(file: SignalFile, *names: str | None) -> None:
    known = [signal.name for signal in file.signals] + [one.name for one in file.events]
    for name in names:
        if name is not None and name not in known:
            columns = ', '.join(map(repr, known)) or 'no columns'
            raise RecordingError(f'expected column {name!r} in {file.path}, got {columns}')


def _check_unit(given: str | None, what: str, known: Mapping[str, float]) -> None:
    if given is not None and given not in known:
        raise RecordingError(f'expected a unit of {what} of {", ".join(known)}, got {given!r}')


def _time(file: SignalFile) -> str:
    rising = [one for one in file.signals if len(one.values) > 1 and _rises(one)]
    named = [one for one in rising if _TIME.search(one.name)]
    chosen = named or rising
    if len(chosen) != 1:
        found = ', '.join(repr(one.name) for one in chosen) or _why_none(file)
        raise Ambiguous(
            f'expected one column of rising times in {file.path}, got {found}: '
            '--time COL or --sampling-rate HZ decides',
            '--time',
            [one.name for one in chosen or file.signals],
        )
    return chosen[0].name


def _why_none(file: SignalFile) -> str:
    """Return where the first column that has the name of a time does not rise."""
    for one in file.signals:
        late = np.flatnonzero(~(np.diff(one.values) > 0.0))
        if _TIME.search(one.name) and late.size:
            place = int(late[0])
            return (
                f'{one.name!r} with {one.values[place]:.9g} and then '
                f'{one.values[place + 1]:.9g} in row {place + 2}'
            )
    return 'none'


def _rises(signal: Signal) -> bool:
    return bool(np.all(np.diff(signal.values) > 0.0))


def _time_unit(signal: Signal, given: str | None) -> tuple[str, str]:
    if given is not None:
        return given, 'as stated (--time-unit)'
    stated = _SYNONYMS.get(signal.unit, signal.unit)
    if stated in TIME_UNITS:
        return stated, 'as the file says'
    period = float(np.median(np.diff(signal.values))) if len(signal.values) > 1 else 0.0
    for unit in ('s', 'ms', 'us'):
        if _SHORTEST <= period * TIME_UNITS[unit] <= _LONGEST:
            rate = 1.0 / (period * TIME_UNITS[unit])
            return unit, f'for {rate:.4g} samples a second then (--time-unit decides)'
    return 's', 'not stated (--time-unit decides)'


def _force(file: SignalFile, signals: Sequence[Signal]) -> str:
    in_newtons = [one for one in signals if _SYNONYMS.get(one.unit, one.unit) in SENSOR_UNITS]
    named = [one for one in signals if _FORCE.search(one.name)]
    both = [one for one in in_newtons if one in named]
    for chosen in (both, in_newtons, named, signals):
        if len(chosen) == 1:
            return chosen[0].name
        if chosen:
            break
    found = ', '.join(repr(one.name) for one in chosen) or 'none'
    raise Ambiguous(
        f'expected one signal that is the force in {file.path}, got {found}: --force COL decides',
        '--force',
        [one.name for one in chosen],
    )


def _force_unit(signal: Signal, given: str | None, scale: float | None) -> tuple[str, str]:
    if scale is not None:
        whole = 'Nm' if given in TORQUE_UNITS else 'N'
        return whole, f'{scale:g} {whole} a unit (--force-scale)'
    if given is not None:
        return given, 'as stated (--force-unit)'
    stated = _SYNONYMS.get(signal.unit, signal.unit)
    if stated in SENSOR_UNITS:
        return stated, 'as the file says'
    if stated in ('', '-', 'a.u.', 'au'):
        return 'N', 'not stated (--force-unit decides)'
    raise Ambiguous(
        f'expected a force in {", ".join(SENSOR_UNITS)}, got {signal.name!r} in {stated}: '
        '--force-scale N-PER-UNIT or --force-unit decides',
        '--force-unit',
        list(SENSOR_UNITS),
    )


def _pulse(file: SignalFile, signals: Sequence[Signal]) -> str:
    names = [one.name for one in signals] + [one.name for one in file.events]
    named = [name for name in names if _PULSE.search(name)]
    two_levels = [one.name for one in signals if _has_two_levels(one)]
    for chosen in (named, [one.name for one in file.events], two_levels):
        if len(chosen) == 1:
            return chosen[0]
        both = [name for name in chosen if name in two_levels]
        if len(both) == 1:
            return both[0]
        if chosen:
            break
    found = ', '.join(map(repr, chosen)) or 'none'
    raise Ambiguous(
        f'expected one gate, trigger or list of pulses in {file.path}, got {found}: '
        '--pulse COL decides',
        '--pulse',
        chosen or names,
    )


def _has_two_levels(signal: Signal) -> bool:
    values = signal.values[np.isfinite(signal.values)]
    if len(values) < 2 or np.ptp(values) == 0.0:
        return False
    share = (values - values.min()) / np.ptp(values)
    return bool(np.mean((share < 0.1) | (share > 0.9)) > _TWO_LEVELS)
