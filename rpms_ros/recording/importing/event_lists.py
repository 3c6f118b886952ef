# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Vectors that are times of pulses, or numbers of samples, beside a sampled force."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray, IntArray
from rpms_ros.recording.importing.signals import TIME_UNITS, Ambiguous, Signal, usual_unit

SAMPLES = 'samples'
LIST_UNITS = (*TIME_UNITS, SAMPLES)
"""What a list may be in: times in a unit, or numbers of samples."""
_NUMBERS = re.compile(r'idx|ind(?:ex|ices)|sample|frame', re.IGNORECASE)
_TIMES = re.compile(r'time|zeit|temps', re.IGNORECASE)
_MUCH_SHORTER = 0.5
# Numbers that were whole before they were multiplied, as seconds by 1000.
_WHOLE = 1e-6


def sampled_like(signals: Sequence[Signal], length: int) -> list[Signal]:
    """Return the signals that may be sampled with a force of a length; others are much shorter."""
    return [
        one for one in signals if one.time is not None or len(one.values) > _MUCH_SHORTER * length
    ]


def lists_beside(signals: Sequence[Signal], length: int) -> list[Signal]:
    """Return the signals that are lists of times: strictly rising, much shorter than the force."""
    sampled = {one.name for one in sampled_like(signals, length)}
    return [one for one in signals if one.name not in sampled and rises(one.values)]


def rises(values: FloatArray) -> bool:
    """Return whether each of the values is above the one before."""
    return bool(len(values) > 1 and np.all(np.diff(values) > 0.0))


def refuse_other_lengths(path: Path, signals: Sequence[Signal]) -> None:
    """Refuse signals of one sampling of which one has more values than another.

    Raises
    ------
    RecordingError
        If there are such: without their own times they do not belong together.
    """
    told = [(one.name, len(one.values)) for one in signals if one.time is None]
    if len({length for _, length in told}) > 1:
        found = ', '.join(f'{name!r} with {length} values' for name, length in told)
        raise RecordingError(
            f'expected signals of one length in {path}, or a list of rising times of pulses much '
            f'shorter than the force, got {found}'
        )


def list_unit(
    signal: Signal, seconds: FloatArray, pulse_unit: str | None, time_unit: str | None
) -> tuple[str, str]:
    """Return the unit of a list, and why it is taken for that.

    Parameters
    ----------
    signal : Signal
        The list.
    seconds : ndarray (samples,)
        Times of the force [s].
    pulse_unit, time_unit : str or None
        What is stated for the list, and for all times of the file.

    Raises
    ------
    Ambiguous
        If several units are possible, or none: not all pulses are within the force then.
    """
    if pulse_unit is not None:
        return pulse_unit, 'as stated (--pulse-unit)'
    if (stated := usual_unit(signal.unit)) in TIME_UNITS:
        return stated, 'as the file says'
    numbers = _are_numbers(signal.values, len(seconds))
    if numbers and _NUMBERS.search(signal.name):
        return SAMPLES, 'as the name says (--pulse-unit decides)'
    if time_unit is not None:
        return time_unit, 'as stated (--time-unit)'
    possible = [
        unit
        for unit in ('s', 'ms', SAMPLES, 'us')
        if (numbers if unit == SAMPLES else _within(signal.values, unit, seconds))
    ]
    begin, end = float(seconds[0]), float(seconds[-1])
    period = (end - begin) / max(len(seconds) - 1, 1)
    # With a sample each millisecond both are the same, up to the number of the first.
    alike = np.isclose(period, 1e-3) or _TIMES.search(signal.name)
    if possible and (alike or possible[:2] != ['ms', SAMPLES]):
        return possible[0], 'all within the force then (--pulse-unit decides)'
    lowest, highest = float(signal.values[0]), float(signal.values[-1])
    units = ' or '.join(possible[:2]) or 'no unit'
    raise Ambiguous(
        f'expected times of pulses from {begin:g} to {end:g} s, as those of the force, got '
        f'{signal.name!r} from {lowest:g} to {highest:g}, in {units}: '
        '--pulse-unit decides',
        '--pulse-unit',
        LIST_UNITS,
    )


def described(signal: Signal, unit: str, why: str) -> str:
    """Return what a list is taken for, for people."""
    what = f'times in {unit}'
    if unit == SAMPLES:
        what = f'numbers of samples, counted from {_first(signal.values)}'
    return f'{signal.name!r}, {len(signal.values)} {what}, {why}'


def stamps_of_numbers(signal: Signal, stamp_ns: IntArray) -> IntArray:
    """Return the stamps [ns] of a list of numbers of samples.

    Raises
    ------
    RecordingError
        If a number is not whole, or there is no such sample.
    """
    if not _are_numbers(signal.values, len(stamp_ns)):
        raise RecordingError(
            f"expected numbers of the force's {len(stamp_ns)} samples in {signal.name!r}, got "
            f'{signal.values[0]:g} to {signal.values[-1]:g}'
        )
    return stamp_ns[np.rint(signal.values).astype(np.int64) - _first(signal.values)]


def _first(values: FloatArray) -> int:
    """Return the number of the first sample: 1 as in MATLAB, unless there is a 0."""
    return 0 if values[0] < 0.5 else 1


def _are_numbers(values: FloatArray, count: int) -> bool:
    """Return whether values are numbers of samples of a force of `count`."""
    whole = bool(np.all(np.abs(values - np.rint(values)) < _WHOLE))
    return whole and values[0] > -0.5 and values[-1] < count + _first(values) - 0.5


def _within(values: FloatArray, unit: str, seconds: FloatArray) -> bool:
    first, last = values[0] * TIME_UNITS[unit], values[-1] * TIME_UNITS[unit]
    return bool(seconds[0] <= first and last <= seconds[-1])
