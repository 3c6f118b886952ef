# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses of a file of a laboratory: of a sampled gate, or of a list beside a sampled force.

A gate is up, or down, at each pulse.  A list holds the times of pulses, or numbers of samples.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    IntArray,
    PulseTrain,
    stamps,
)
from rpms_ros.recording.importing.signals import (
    FALLING,
    LIST_UNITS,
    NO_TIME,
    RISING,
    SAMPLES,
    TIME_UNITS,
    Ambiguous,
    ImportOptions,
    Signal,
    unit_told,
)

# 5 % of the threshold's distance to the rest, either way: far above the noise of a converter.
_HYSTERESIS = 0.05
# Pulses last a few milliseconds: a gate that is high for longer than this share rests there.
_RESTS_HIGH = 0.9
# A gate that is high for longer marks trains, not pulses [s].
_LONGEST = 0.1
# Shares of the range on either side of its middle, and of the samples that may be on both.
_HALF_WAY = 0.1
_FEW = 0.025
# Stimulators give no pulses at 250 Hz; contacts bounce for a few milliseconds [s].
_BOUNCE = 4e-3
# Triggers are shorter where they mark pulses [s].
_USUAL = 20e-3
# Of the range of a gate: what rises less is no pulse, and what differs less is one height.
_LEAST_HEIGHT, _ALIKE = 0.02, 0.2
# So much of a pulse may have another intensity, as where a column is a sample late, and so many
# pulses more.
_OTHER, _FEW_CHANGE = 0.3, 0.05
# Share of the pulses.
_FEW_LOST = 0.05


def gate_pulses(stamp_ns: IntArray, gate: FloatArray, options: ImportOptions) -> PulseTrain:
    """Return the pulses of a sampled gate.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    gate : ndarray, shape (samples,)
        Level of the gate.
    options : ImportOptions
        Threshold, intensity and edge.

    Returns
    -------
    PulseTrain
        Numbered from 1 if the gate is up in the first sample: a pulse whose onset is not known.

    Raises
    ------
    RecordingError
        If the gate never rises through the threshold, or falls if it rests high; or it stays there
        for longer than any pulse, unless the edge is stated.
    """
    low, top = float(gate.min()), float(gate.max())
    threshold = _threshold(gate, options)
    band = _HYSTERESIS * 2.0 * max(min(threshold - low, top - threshold), 0.0)
    above, below = gate > threshold + band, gate < threshold - band
    falling = _edge_and_high(gate, options)[0] == FALLING
    rises, falls, begun = _edges(below, above) if falling else _edges(above, below)
    # the end of a pulse whose beginning is before the first sample
    begun_for = (stamp_ns[min(begun, len(gate) - 1)] - stamp_ns[0]) / NANOSECONDS_PER_SECOND
    if not len(rises):
        fault = f'expected a gate that {"falls" if falling else "rises"} through {threshold:g}'
        raise RecordingError(f'{fault}, got levels {low:g} to {top:g}')
    onset = stamp_ns[rises]
    # A gate that is still up at the end is as wide as it was seen.
    end = np.append(stamp_ns[falls], stamp_ns[-1])[: len(onset)]
    width = (end - onset) / NANOSECONDS_PER_SECOND
    period = float(np.median(np.diff(stamp_ns))) / NANOSECONDS_PER_SECOND
    longest = max(begun_for, float(width.max()))
    if options.edge is None and longest > max(_LONGEST, 1.5 * period):
        fault = f'expected a gate that marks each pulse, for at most {_LONGEST:g} s'
        how = '--pulse COL decides; --edge takes each edge for a pulse all the same'
        got = f'one of {longest:.3g} s: does it mark whole trains?'
        raise RecordingError(f'{fault}, got {got} {how}')
    first = int(begun > 0 and begun_for <= _LONGEST)
    return PulseTrain.numbered(onset, options.share, width, first)


def _edge_and_high(gate: FloatArray, options: ImportOptions) -> tuple[str, float]:
    """Return the edge with which pulses of a gate begin, and the share of time it is high."""
    high = float(np.mean(gate > _threshold(gate, options))) if len(gate) else 0.0
    return options.edge or (FALLING if high > _RESTS_HIGH else RISING), high


def _threshold(gate: FloatArray, options: ImportOptions) -> float:
    if options.threshold is not None:
        return options.threshold
    return (float(gate.min()) + float(gate.max())) / 2


def _edges(high: BoolArray, low: BoolArray) -> tuple[IntArray, IntArray, int]:
    """Return the samples at which the gate rises, and those at which it falls after a rise.

    A gate that is up from the beginning has no onset: third is the sample until which it is.
    """
    # the first sample counts in any case: a rest between both levels, as of a gate with two
    # phases, is low before the first pulse
    marks = np.union1d([0], np.flatnonzero(high | low))
    states = high[marks]
    changes = np.flatnonzero(states[1:] != states[:-1]) + 1
    rises = marks[changes[states[changes]]]
    falls = marks[changes[~states[changes]]]
    begun = 0
    if states[0]:
        begun = int(falls[0]) if len(falls) else len(high)
    return rises, falls[falls > rises[0]] if len(rises) else falls, begun


def has_two_levels(signal: Signal) -> bool:
    """Return whether nearly all values are at one of two levels, so that it looks like a gate."""
    values = signal.values[np.isfinite(signal.values)]
    if len(values) < 2 or np.ptp(values) == 0.0:
        return False
    share = (values - values.min()) / np.ptp(values)
    return bool(np.mean((share < 0.1) | (share > 0.9)) > 0.9)


def gate_told(path: Path, signal: Signal, options: ImportOptions) -> str:
    """Return how a gate is read, for people.

    Parameters
    ----------
    path : Path
        The file.
    signal : Signal
        The gate.
    options : ImportOptions
        What is stated of it.

    Raises
    ------
    Ambiguous
        If many values are half-way between the lowest and the highest, where the threshold is
        that is not stated: noise there, or a rest between pulses to both sides, is no gate.
    """
    edge, high = _edge_and_high(signal.values, options)
    if options.threshold is None and (lost := _lower_pulses(signal.values, edge)):
        raise Ambiguous(
            f'expected pulses of one height in {path}, got {lost} in {signal.name!r} that stay '
            'below half of the highest: --threshold LEVEL decides; --intensity COL takes heights'
        )
    if options.threshold is None and (half_way := _half_way(signal.values)):
        lowest, highest = float(signal.values.min()), float(signal.values.max())
        noise = f'{100 * half_way:.0f} % of it half-way between {lowest:.3g} and {highest:.3g}'
        fault = f'expected a gate with two levels in {path}, got {signal.name!r}, {noise}'
        raise Ambiguous(f'{fault}: --threshold LEVEL or --pulse COL decides')
    if options.edge is not None:
        return f'{signal.name!r}, {edge} edges (--edge)'
    if edge == FALLING:
        why = f'as it is high {100 * high:.0f} % of the time (--edge decides)'
        return f'{signal.name!r}, falling edges, {why}'
    return repr(signal.name)


def _lower_pulses(values: FloatArray, edge: str) -> int:
    """Return how many pulses are lost below half of the range; 0 if they are few.

    What leaves the band of nine tenths of the samples at rest by more than its width is a pulse.
    """
    values = -values if edge == FALLING else values
    if not 0.0 < np.ptp(values) < np.inf:
        return 0
    top, middle = float(values.max()), float(values.min() + values.max()) / 2
    low, high = np.percentile(values[values <= middle], [5.0, 95.0])
    level = high + (high - low) + _LEAST_HEIGHT * (top - low)
    out = np.diff(np.concatenate(([False], values > level, [False])).astype(int))
    begins, ends = np.flatnonzero(out > 0), np.flatnonzero(out < 0)
    peaks = [values[begin:end].max() for begin, end in zip(begins, ends, strict=True)]
    lost = int(np.count_nonzero(np.array(peaks) <= middle))
    return lost if lost > _FEW_LOST * len(peaks) else 0


def heights_told(signal: Signal, stamp_ns: IntArray, pulses: PulseTrain) -> str | None:
    """Return a warning if the pulses of a gate have different heights."""
    height = np.array([np.median(one) for one in _during(signal, stamp_ns, pulses)])
    span = float(np.ptp(signal.values))
    if not np.ptp(np.percentile(height, [5.0, 95.0])) > _ALIKE * span:
        return None
    return (
        f'pulses of {signal.name!r} have heights from {height.min():.3g} to {height.max():.3g}: '
        f"is that the intensity? --intensity '{signal.name}/{height.max():.3g}' decides"
    )


def held_values(signal: Signal, stamp_ns: IntArray, pulses: PulseTrain) -> FloatArray:
    """Return the median of a signal of intensities while each pulse lasts (pulses,).

    Raises
    ------
    RecordingError
        If it is another in a part of many pulses: it does not say the intensity then.
    """
    within, off = _during(signal, stamp_ns, pulses), _ALIKE * np.ptp(signal.values)
    median = np.array([np.median(one) for one in within])
    other = [np.mean(np.abs(one - at) > off) for one, at in zip(within, median, strict=True)]
    if np.mean(changing := np.array(other) > _OTHER) > _FEW_CHANGE:
        raise RecordingError(
            f'expected one intensity while a pulse lasts in {signal.name!r}, got several in '
            f'{changing.sum()} of {len(pulses)} pulses: --intensity FILE with one a pulse decides'
        )
    return median


def _during(signal: Signal, stamp_ns: IntArray, pulses: PulseTrain) -> list[FloatArray]:
    """Return the samples of a signal while each pulse lasts, at least one of each pulse."""
    end_ns = pulses.onset_ns + stamps(pulses.width)
    # events may come between samples
    begins = np.maximum(np.searchsorted(stamp_ns, pulses.onset_ns, side='right') - 1, 0)
    ends = np.maximum(np.searchsorted(stamp_ns, end_ns), begins + 1)
    return [signal.values[begin:end] for begin, end in zip(begins, ends, strict=True)]


def _half_way(values: FloatArray) -> float:
    """Return the share of noise that is half-way between its ends; 0 if a side of that is empty.

    Hum may come close to the middle from below, or from above, but not from both.
    """
    if not (span := np.ptp(values)) > 0.0:
        return 0.0
    place = (values - values.min()) / span - 0.5
    above = float(np.mean((place > 0.0) & (place < _HALF_WAY)))
    below = float(np.mean((place <= 0.0) & (place > -_HALF_WAY)))
    return above + below if min(above, below) > _FEW else 0.0


def odd_gate(pulses: PulseTrain, period: float) -> str | None:
    """Return a warning if pulses, sampled with a period [s], are closer or longer than usual."""
    if (longest := float(pulses.width.max())) > max(_USUAL, 1.5 * period):
        seen = f'the gate is up for {1e3 * longest:.3g} ms at a pulse'
        return f'{seen}: does it mark trains? Each edge was taken for one pulse'
    early = int(np.count_nonzero(np.diff(pulses.onset_ns) < 1e9 * _BOUNCE))
    if not early:
        return None
    late = f'less than {1e3 * _BOUNCE:g} ms after the one before'
    seen = f'{early} of {len(pulses)} pulses begin {late}'
    return f'{seen}: does the trigger bounce? Each was taken for a pulse of its own'


_NUMBERS = re.compile(r'idx|ind(?:ex|ices)|sample|frame', re.IGNORECASE)
_TIMES = re.compile(r'time|zeit|temps', re.IGNORECASE)
# Share of a list that is within the force.
_NEARLY_ALL = 0.9
# Numbers that were whole before they were multiplied, as seconds by 1000.
_WHOLE = 1e-6


def sampled_like(signals: Sequence[Signal], length: int) -> list[Signal]:
    """Return the signals that may be sampled with a force of a length; others are much shorter."""
    return [one for one in signals if one.time is not None or len(one.values) > 0.5 * length]


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
        If several units are possible, or none: too few pulses are within the force then.
    """
    if told := unit_told(signal.unit.lower(), pulse_unit, 'pulse-unit', TIME_UNITS):
        return told
    numbers = _are_numbers(signal.values, len(seconds))
    if numbers and _NUMBERS.search(signal.name):
        return SAMPLES, 'as the name says (--pulse-unit decides)'
    if time_unit is not None:
        return time_unit, 'as stated (--time-unit)'
    if signal.unit not in (*NO_TIME, SAMPLES):
        fault = f'expected times of pulses in {", ".join(LIST_UNITS)}'
        raise Ambiguous(f'{fault}, got {signal.name!r} in {signal.unit}: --pulse-unit decides')
    # stimulation may go on after the recording, but not where the values may be numbers
    least = 1.0 if numbers else _NEARLY_ALL
    within = {unit: _within(signal.values, unit, seconds) >= least for unit in ('s', 'ms', 'us')}
    possible = [one for one in ('s', 'ms', SAMPLES, 'us') if within.get(one, numbers)]
    begin, end = float(seconds[0]), float(seconds[-1])
    period = (end - begin) / max(len(seconds) - 1, 1)
    # With a sample each millisecond both are the same, up to the number of the first.
    alike = np.isclose(period, 1e-3) or _TIMES.search(signal.name)
    if possible and (alike or possible[:2] != ['ms', SAMPLES]):
        return possible[0], 'within the force then (--pulse-unit decides)'
    lowest, highest = float(signal.values[0]), float(signal.values[-1])
    units = ' or '.join(possible[:2]) or 'no unit'
    fault = f'expected times of pulses from {begin:g} to {end:g} s, as those of the force'
    got = f'{signal.name!r} from {lowest:g} to {highest:g}, in {units}'
    raise Ambiguous(f'{fault}, got {got}: --pulse-unit decides')


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
        fault = f"expected numbers of the force's {len(stamp_ns)} samples in {signal.name!r}"
        raise RecordingError(f'{fault}, got {signal.values[0]:g} to {signal.values[-1]:g}')
    return stamp_ns[np.rint(signal.values).astype(np.int64) - _first(signal.values)]


def _first(values: FloatArray) -> int:
    """Return the number of the first sample: 1 as in MATLAB, unless there is a 0."""
    return 0 if values[0] < 0.5 else 1


def _are_numbers(values: FloatArray, count: int) -> bool:
    """Return whether values are numbers of samples of a force of `count`."""
    whole = bool(np.all(np.abs(values - np.rint(values)) < _WHOLE))
    return whole and values[0] > -0.5 and values[-1] < count + _first(values) - 0.5


def _within(values: FloatArray, unit: str, seconds: FloatArray) -> float:
    """Return the share of times that are within the force; 0 if they are too close for pulses."""
    times = values * TIME_UNITS[unit]
    apart = float(np.median(np.diff(times))) >= _BOUNCE
    return apart * float(np.mean((seconds[0] <= times) & (times <= seconds[-1])))
