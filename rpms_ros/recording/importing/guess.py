# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which signal is time, force and gate, and in which units: guessed, shown, decided by options."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.importing.gates import (
    described,
    gate_told,
    has_two_levels,
    list_unit,
    lists_beside,
    refuse_other_lengths,
    rises,
    sampled_like,
)
from rpms_ros.recording.importing.signals import (
    LIST_UNITS,
    NO_TIME,
    SENSOR_UNITS,
    TIME_OF_DAY,
    TIME_UNITS,
    TORQUE_UNITS,
    UNSTATED,
    Ambiguous,
    ImportOptions,
    Signal,
    SignalFile,
    unit_told,
    usual_unit,
)

_TIME = re.compile(r'\b(t|time|zeit|temps|tiempo|timestamps?|seconds|sec)\b|time', re.IGNORECASE)
_FORCE = re.compile(
    r'force|kraft|fuerza|load|^f[xyzgm\d]|\bf\b|\bfz\b|strain|torque|moment', re.IGNORECASE
)
_PULSE = re.compile(r'stim|gate|trig|pulse|puls|sync|ttl|marker|digital', re.IGNORECASE)
_MINUTES = re.compile(r'(?:^|[_/ ])min(?:utes)?$', re.IGNORECASE)
# Share by which the rate that a file states may differ from that of its times.
_OTHER_RATE = 1e-3
_COUNTER = re.compile(
    r'^\W*(?:(?:samples?|frames?|data|row)?[ _]*'
    r'(?:index|idx|number|num|nr|no|count(?:er)?|points?)|samples?|frames?|rows?|n|)\W*$',
    re.IGNORECASE,
)
# Sample periods of force in a recording, from 100 kHz to 100 Hz [s].
_SHORTEST, _LONGEST = 1e-5, 1.0000001e-2


class Guess(NamedTuple):
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
    pulse_unit : str or None
        One of `LIST_UNITS` if the pulses are a list beside sampled signals; None for a gate, and
        for events, which have their times in s.
    """

    time: str | None
    time_unit: str
    force: str
    force_unit: str
    pulse: str
    reasons: tuple[tuple[str, str], ...]
    pulse_unit: str | None = None


def guess_by(file: SignalFile, options: ImportOptions) -> Guess:
    """Assign the signals of a file to time, force and pulses; options override.

    Raises
    ------
    Ambiguous
        If something cannot be guessed: the message names the option that decides.
    RecordingError
        If a name or unit that is given does not exist.
    """
    time, force, pulse = options.time, options.force, options.pulse
    _check_given(file, options)
    length = _length_of_force(file, force)
    sampled = sampled_like(file.signals, length)
    rate = options.sampling_rate or file.sampling_rate_hz
    guessed = time is None and any(one.time is None for one in file.signals)
    if guessed and not rate:
        time = _time(file, sampled)
    elif guessed and not options.sampling_rate:
        alike = [one for one in sampled if len(one.values) == length]
        time = _time_beside(file, alike, options.time_unit)
    rest = [signal for signal in sampled if signal.name != time]
    lists = [one.name for one in lists_beside(file.signals, length) if one.name != time]
    column = file.signal(time)
    unit, time_told = _time_told(column, options.time_unit, rate)
    if pulse is None:
        pulse = _pulse(file, [signal for signal in rest if signal.name != force], lists)
    if force is None:
        force = _force(file, [signal for signal in rest if signal.name != pulse])
    sensor, gate = file.signal(force), file.signal(pulse)
    assert sensor is not None
    is_list = pulse in lists or options.pulse_unit is not None
    given = options.sampling_rate or (not is_list and options.time_unit)
    if sensor.time is not None and column is None and given:
        fault = f'expected no --sampling-rate and no --time-unit for {force!r}'
        raise RecordingError(f'{fault}, which has times of its own in s, got {given}')
    newton, why = _force_unit(sensor, options.force_unit, options.force_scale)
    used = [column, None if is_list else gate, sensor]
    refuse_other_lengths(file.path, [one for one in used if one is not None])
    list_in, pulses_told = None, repr(pulse)
    if is_list:
        if gate is None or gate.time is not None:
            fault = f'expected a list of pulses in no stated unit with --pulse-unit, got {pulse!r}'
            raise RecordingError(fault)
        seconds = _seconds(sensor, column, TIME_UNITS[unit], rate)
        list_in, reason = list_unit(gate, seconds, options.pulse_unit, options.time_unit)
        pulses_told = described(gate, list_in, reason)
    elif gate is not None:
        pulses_told = gate_told(file.path, gate, options)
    force_told = f'{force!r} in {newton}, {why}'
    reasons = (('time', time_told), ('force', force_told), ('pulses', pulses_told))
    return Guess(time, unit, force, newton, pulse, reasons, list_in)


def _seconds(force: Signal, time: Signal | None, unit: float, rate: float | None) -> FloatArray:
    """Return the times of the force [s]: its own, those of a column, or by the rate."""
    if force.time is not None:
        return force.time
    if time is not None:
        return time.values * unit
    assert rate is not None
    return np.arange(len(force.values)) / rate


def _length_of_force(file: SignalFile, force: str | None) -> int:
    """Return the samples of the force, or of the longest signal that may be it."""
    likely = [one for one in file.signals if _has_force_unit(one) or _FORCE.search(one.name)]
    if force:
        likely = [one for one in file.signals if one.name == force]
    return max((len(one.values) for one in likely or file.signals), default=0)


def _has_force_unit(signal: Signal) -> bool:
    return usual_unit(signal.unit) in SENSOR_UNITS


def _check_given(file: SignalFile, options: ImportOptions) -> None:
    """Refuse units that are not known and names that are none of the file.

    Events can be pulses alone.
    """
    if options.time and options.sampling_rate:
        raise RecordingError('expected --time or --sampling-rate, got both')
    known_units = {'time': TIME_UNITS, 'force': SENSOR_UNITS, 'pulse': LIST_UNITS}
    for what, units in known_units.items():
        unit = getattr(options, f'{what}_unit')
        if unit is not None and unit not in units:
            of = 'pulses' if what == 'pulse' else what
            raise RecordingError(f'expected a unit of {of} of {", ".join(units)}, got {unit!r}')
    signals = [signal.name for signal in file.signals]
    for what in known_units:
        name = getattr(options, what)
        known = signals + [one.name for one in file.events if what == 'pulse']
        if name is not None and name not in known:
            columns = ', '.join(map(repr, known)) or 'no columns'
            raise RecordingError(f'expected column {name!r} in {file.path}, got {columns}')


def _time(file: SignalFile, sampled: Sequence[Signal]) -> str:
    rising = [one for one in sampled if rises(one.values)]
    named = [one for one in rising if _TIME.search(one.name)]
    chosen = named or rising
    if counters := [one.name for one in rising if _counts(one) and not named]:
        raise _no_times(counters[0])
    if len(chosen) != 1:
        found = ', '.join(repr(one.name) for one in chosen) or _why_none(file)
        fault = f'expected one column of rising times in {file.path}'
        raise Ambiguous(f'{fault}, got {found}: --time COL or --sampling-rate HZ decides')
    return chosen[0].name


def _time_beside(file: SignalFile, signals: Sequence[Signal], given: str | None) -> str | None:
    """Return the column of times that says more than the rate that a file states.

    That is where it begins, or where there is a gap; None if there is none, or none that fits.
    """
    rate = file.sampling_rate_hz or 0.0
    named = [one for one in signals if _TIME.search(one.name) and rises(one.values)]
    if len(named) != 1 or usual_unit(named[0].unit) not in (*TIME_UNITS, *NO_TIME, TIME_OF_DAY):
        return None
    unit, _ = _time_unit(named[0], given)
    samples = named[0].values * TIME_UNITS[unit] * rate
    if np.abs(samples - np.arange(len(samples))).max() < 0.5:
        return None
    # rounding changes the one, a gap the other
    steps = np.array([np.median(np.diff(samples)), np.ptp(samples) / (len(samples) - 1)])
    if np.isclose(steps, 1.0, rtol=0.0, atol=_OTHER_RATE).any():
        return named[0].name
    if not 0.5 < steps[0] < 2.0:
        return None
    fault = f'expected times of {rate:g} samples a second in {file.path}, as it states'
    got = f'{named[0].name!r} with {rate / steps[0]:g}: --time COL or --sampling-rate HZ decides'
    raise Ambiguous(f'{fault}, got {got}')


def _counts(signal: Signal) -> bool:
    """Return whether a signal without a unit numbers the samples: by its name, or without one."""
    if signal.unit:
        return False
    if signal.name.startswith('column '):
        return bool(np.all(np.diff(signal.values) == 1.0))
    return _COUNTER.match(signal.name) is not None


def _no_times(name: str) -> RecordingError:
    fault = f'expected times or the rate of the samples, got {name!r}, which counts them'
    return RecordingError(f'{fault}: --sampling-rate HZ decides, or --time COL with --time-unit')


def _why_none(file: SignalFile) -> str:
    """Return where the first column that has the name of a time does not rise."""
    for one in file.signals:
        late = np.flatnonzero(~(np.diff(one.values) > 0.0))
        if _TIME.search(one.name) and late.size:
            place = int(late[0])
            before, after = one.values[place : place + 2]
            return f'{one.name!r} with {before:.9g} and then {after:.9g} in row {place + 2}'
    return 'none'


def _time_told(column: Signal | None, given: str | None, rate: float | None) -> tuple[str, str]:
    """Return the unit of the time, and what is taken for the time."""
    if column is not None:
        unit, why = _time_unit(column, given)
        return unit, f'{column.name!r} in {unit}, {why}'
    return 's', 'of the file' if rate is None else f'{rate:g} samples a second'


def _time_unit(signal: Signal, given: str | None) -> tuple[str, str]:
    if signal.unit == TIME_OF_DAY:
        if given not in (None, 's'):
            fault = f'expected no --time-unit, or s, for the times of day of {signal.name!r}'
            raise RecordingError(f'{fault}, got {given}')
        return 's', 'from times of day'
    stated = signal.unit or ('min' if _MINUTES.search(signal.name) else '')
    if told := unit_told(stated.lower(), given, 'time-unit', TIME_UNITS):
        return told
    if signal.unit not in NO_TIME:
        fault = f'expected a time in {", ".join(TIME_UNITS)}'
        raise Ambiguous(f'{fault}, got {signal.name!r} in {signal.unit}: --time-unit decides')
    if _counts(signal):
        raise _no_times(signal.name)
    period = float(np.median(np.diff(signal.values))) if len(signal.values) > 1 else 0.0
    for unit in ('s', 'ms', 'us'):
        if _SHORTEST <= period * TIME_UNITS[unit] <= _LONGEST:
            rate = 1.0 / (period * TIME_UNITS[unit])
            return unit, f'for {rate:.4g} samples a second then (--time-unit decides)'
    return 's', 'not stated (--time-unit decides)'


def _force(file: SignalFile, signals: Sequence[Signal]) -> str:
    in_newtons = [one for one in signals if _has_force_unit(one)]
    named = [one for one in signals if _FORCE.search(one.name)]
    both = [one for one in in_newtons if one in named]
    # an acceleration in g has a unit of a force
    chosen = both or [*in_newtons, *named] or signals
    if len(chosen) == 1:
        return chosen[0].name
    found = ', '.join(repr(one.name) for one in chosen) or 'none'
    fault = f'expected one signal that is the force in {file.path}, got {found}'
    raise Ambiguous(f'{fault}: --force COL decides')


def _force_unit(signal: Signal, given: str | None, scale: float | None) -> tuple[str, str]:
    if scale is not None:
        if given not in (None, 'N', 'Nm'):
            raise RecordingError(f'expected --force-scale in N or Nm a unit, got it in {given}')
        whole = 'Nm' if given in TORQUE_UNITS else 'N'
        return whole, f'{scale:g} {whole} a unit (--force-scale)'
    if told := unit_told(signal.unit, given, 'force-unit', SENSOR_UNITS):
        return told
    stated = usual_unit(signal.unit)
    if stated in UNSTATED:
        return 'N', 'not stated (--force-unit decides)'
    fault = f'expected a force in {", ".join(SENSOR_UNITS)}, got {signal.name!r} in {stated}'
    raise Ambiguous(f'{fault}: --force-scale N-PER-UNIT or --force-unit decides')


def _pulse(file: SignalFile, sampled: Sequence[Signal], lists: Sequence[str]) -> str:
    """Return the pulses: a gate among the sampled signals, a list beside them, or events."""
    events = [one.name for one in file.events]
    short = [one.name for one in file.signals if one.name in lists]
    names = [*(one.name for one in sampled), *short, *events]
    named = [name for name in names if _PULSE.search(name)]
    gates = [one.name for one in sampled if has_two_levels(one)]
    forces = {one.name for one in sampled if _has_force_unit(one)}
    others = [name for name in gates if name not in forces and not _FORCE.search(name)] + short
    chosen = named or events or others
    for likely in (chosen, gates, short):
        both = [name for name in chosen if name in likely]
        if len(both) == 1:
            return both[0]
    found = ', '.join(map(repr, chosen)) or 'none'
    fault = f'expected one gate, trigger or list of pulses in {file.path}'
    raise Ambiguous(f'{fault}, got {found}: --pulse COL decides')
