# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One file of a laboratory as pulses and force: read, guessed, converted."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rpms_ros.axis import FORCE, TORQUE
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
    stamps,
)
from rpms_ros.recording.importing.binary_formats import read_excel, read_matlab, read_xdf
from rpms_ros.recording.importing.gates import (
    gate_pulses,
    heights_told,
    held_values,
    odd_gate,
    stamps_of_numbers,
)
from rpms_ros.recording.importing.guess import Guess, guess_by
from rpms_ros.recording.importing.signals import (
    SAMPLES,
    SENSOR_UNITS,
    TIME_UNITS,
    TORQUE_UNITS,
    ImportOptions,
    Signal,
    SignalFile,
)
from rpms_ros.recording.importing.text import read_text
from rpms_ros.recording.rosbag.scan import READERS

# No muscle shows a pulse for longer.
_ACTS_NS = 3 * NANOSECONDS_PER_SECOND // 2
# A stamp of ROS has 32 bits for its seconds.
_STAMPS_NS = 2**31 * NANOSECONDS_PER_SECOND


class Imported(NamedTuple):
    """Pulses and force of a file.

    Attributes
    ----------
    pulses, forces : PulseTrain, ForceTrace
        What it holds.
    facts : tuple of (str, str)
        How it was read and what was guessed, for people.
    guessed : bool
        Whether anything was.
    quantity : str
        What was measured: ``force`` [N] or ``torque`` [N m].
    """

    pulses: PulseTrain
    forces: ForceTrace
    facts: tuple[tuple[str, str], ...]
    guessed: bool
    quantity: str = FORCE


def is_foreign(path: Path) -> bool:
    """Return whether there is a file of a laboratory, and no recording."""
    if path.name.removesuffix('.zstd').endswith(tuple(READERS)):
        return False
    return path.is_file() or (path.suffix != '' and not path.exists())


@np.errstate(over='ignore', invalid='ignore')
def import_file(path: Path, options: ImportOptions) -> Imported:
    """Return pulses and force of a file.

    Parameters
    ----------
    path : Path
        Any file that `read_signals` reads.
    options : ImportOptions
        What is what.

    Raises
    ------
    Ambiguous
        If something cannot be guessed.
    RecordingError
        If the file cannot be read, or an option does not fit it.
    """
    file = read_signals(path, options.block, options.sheet)
    guess = guess_by(file, options)
    pulses, forces = _converted(file, guess, options)
    remarks = []
    if missing := int(np.count_nonzero(~np.isfinite(forces.force))):
        remarks.append(('missing', f'{missing} samples of the force are no finite number'))
    period = float(np.median(np.diff(forces.stamp_ns))) / 1e9 if len(forces) > 1 else 0.0
    if warning := odd_gate(pulses, period):
        remarks.append(('warning', warning))
    if pulses.sequence[0]:
        remarks.append(('warning', _BEGUN))
    elif begins_amid(pulses, forces):
        # sequence numbers that say that there were pulses before them
        pulses = replace(pulses, sequence=pulses.sequence + 1)
        remarks.append(('warning', _AMID))
    used = {guess.time, guess.force, guess.pulse}
    gate = file.signal(guess.pulse)
    if isinstance(options.intensity, str):
        name, shares = _intensities(file, guess, options, pulses, options.intensity)
        pulses = replace(pulses, intensity=shares)
        used.add(name)
    elif gate is not None and guess.pulse_unit is None:
        stamp_ns = _stamps(file, gate, guess, options)
        if warning := heights_told(gate, stamp_ns, pulses):
            remarks.append(('warning', warning))
    pulses, forces, moved = _moved(pulses, forces)
    remarks += [('times', moved)] if moved else []
    names = [one.name for one in file.signals] + [one.name for one in file.events]
    if left := [name for name in names if name not in used]:
        remarks.append(('not used', ', '.join(map(repr, left))))
    if options.intensity == 1.0:
        text = 'each pulse has the intensity 1; --intensity {!r} decides otherwise'
        named = (name for name in left if 'intens' in name.lower())
        remarks += [('warning', text.format(name)) for name in named]
    read = (('file', ', '.join((file.kind, *file.facts))), *guess.reasons, *remarks)
    quantity = TORQUE if guess.force_unit in TORQUE_UNITS else FORCE
    all_given = None not in (options.time, options.force, options.pulse)
    told = remarks or any(text.endswith('decides)') for _, text in guess.reasons)
    return Imported(pulses, forces, read, bool(told or not all_given), quantity)


def _moved(pulses: PulseTrain, forces: ForceTrace) -> tuple[PulseTrain, ForceTrace, str]:
    """Return pulses and force at times that stamps of ROS can hold, and a remark if they moved."""
    first_ns = int(min(forces.stamp_ns[0], pulses.onset_ns[0]))
    if first_ns >= 0 and forces.stamp_ns[-1] < _STAMPS_NS:
        return pulses, forces, ''
    later_s = -(first_ns // NANOSECONDS_PER_SECOND)
    later_ns = later_s * NANOSECONDS_PER_SECOND
    pulses = replace(pulses, onset_ns=pulses.onset_ns + later_ns)
    forces = replace(forces, stamp_ns=forces.stamp_ns + later_ns)
    said = f'{later_s} s are added to each, as stamps are from 0 to {2**31} s'
    return pulses, forces, said


def _intensities(
    file: SignalFile, guess: Guess, options: ImportOptions, pulses: PulseTrain, text: str
) -> tuple[str, FloatArray]:
    """Return the column or file that `text` names, and the shares in it (pulses,)."""
    name, slash, full = text.rpartition('/')
    whole = file.signal(text) or Path(text).is_file()
    if whole or not (slash and (file.signal(name) or Path(name).is_file())):
        name, slash, full = text, '', '1'
    try:
        scale = 1.0 / float(full)
    except (ValueError, ZeroDivisionError) as error:
        raise RecordingError(f'expected --intensity NAME/FULL, got {text!r}') from error
    if found := file.signal(name):
        shares = found.values
        if len(shares) != len(pulses):
            shares = held_values(found, _stamps(file, found, guess, options), pulses)
    else:
        if not Path(name).is_file():
            columns = ', '.join(repr(one.name) for one in file.signals)
            fault = f'expected a share, a column or a file with --intensity, got {text!r}'
            raise RecordingError(f'{fault}; the columns of {file.path} are {columns}')
        table = read_signals(Path(name)).signals
        named = [one for one in table if 'intens' in one.name.lower()]
        if len(table) > 1 and not named:
            fault = f'expected one column of intensities in {name}, or a title that says which'
            raise RecordingError(f'{fault}, got {len(table)} columns')
        found = (named or table)[0]
        shares = found.values
        if len(shares) != len(pulses):
            fault = f'expected the intensity of each of {len(pulses)} pulses in {name}'
            raise RecordingError(f'{fault}, got {len(shares)}')
    shares = _of_per_cent(name, shares) if found.unit == '%' and not slash else shares * scale
    if (wrong := np.flatnonzero(~((shares >= 0.0) & (shares <= 1.0)))).size:
        raise RecordingError(
            f'expected intensities from 0 to 1 in {name!r}, or in a column with the unit %, got '
            f'{shares[wrong[0]]:.4g} of pulse {wrong[0] + 1}: --intensity {name}/FULL divides by '
            'the value of the maximum'
        )
    return name, shares


def _of_per_cent(name: str, values: FloatArray) -> FloatArray:
    """Return shares of intensities in per cent; a workbook has 0.8 where it shows 80 %."""
    if (most := values.max(initial=0.0)) <= 1.0:
        fault = f'expected intensities in % in {name!r}, got {most:.4g} at most'
        raise RecordingError(f'{fault}: --intensity {name}/FULL divides by the maximum')
    return values / 100.0


def _converted(
    file: SignalFile, guess: Guess, options: ImportOptions
) -> tuple[PulseTrain, ForceTrace]:
    """Return pulses and force.

    Raises
    ------
    RecordingError
        If times do not rise, a gate is not finite or never rises, or there is no pulse.
    """
    force, gate = file.signal(guess.force), file.signal(guess.pulse)
    assert force is not None
    newton = options.force_scale or SENSOR_UNITS[guess.force_unit]
    stamp_ns = _stamps(file, force, guess, options)
    if not np.isfinite(force.values).any():
        fault = f'expected numbers in column {guess.force!r} of {file.path}'
        raise RecordingError(f'{fault}, got none that is finite')
    trace = ForceTrace(stamp_ns, newton * force.values)
    if gate is None:
        (times,) = (one.time for one in file.events if one.name == guess.pulse)
        return _of_events(stamps(np.sort(times)), options, file), trace
    if guess.pulse_unit == SAMPLES:
        return _of_events(stamps_of_numbers(gate, stamp_ns), options, file), trace
    if guess.pulse_unit is not None:
        onset = _rising(file, gate.name, gate.values, TIME_UNITS[guess.pulse_unit])
        return _of_events(onset, options, file), trace
    _finite(file, gate)
    pulses = gate_pulses(_stamps(file, gate, guess, options), gate.values, options)
    if pulses.sequence[0]:
        # what the pulse of unknown onset acts on, as far as no other one does
        kept = stamp_ns >= min(int(pulses.onset_ns[0]), int(stamp_ns[0]) + _ACTS_NS)
        trace = ForceTrace(trace.stamp_ns[kept], trace.force[kept])
    return pulses, trace


def _stamps(file: SignalFile, signal: Signal, guess: Guess, options: ImportOptions) -> IntArray:
    """Return the stamps of a signal [ns]."""
    if column := file.signal(guess.time):
        _finite(file, column)
        return _rising(file, column.name, column.values, TIME_UNITS[guess.time_unit])
    if signal.time is not None:
        return _rising(file, f'time of {signal.name}', signal.time, 1.0)
    rate = options.sampling_rate or file.sampling_rate_hz
    assert rate is not None
    return stamps(np.arange(len(signal.values)) / rate)


def _finite(file: SignalFile, signal: Signal) -> None:
    for row in np.flatnonzero(~np.isfinite(signal.values))[:1].tolist():
        fault = f'expected finite numbers in column {signal.name!r} of {file.path}'
        raise RecordingError(f'{fault}, got {signal.values[row]} in row {row + 1}')


def _rising(file: SignalFile, name: str, values: FloatArray, unit: float) -> IntArray:
    if (missing := np.flatnonzero(np.isnan(values))).size:
        fault = f'expected a time in each row of column {name!r} of {file.path}'
        raise RecordingError(f'{fault}, got none in row {missing[0] + 1}')
    if (late := np.flatnonzero(np.diff(values) <= 0)).size:
        fault = f'expected rising times in column {name!r} of {file.path}'
        raise RecordingError(f'{fault}, got {values[late[0]]} and then {values[late[0] + 1]}')
    seconds = values * unit
    # Beyond that nanoseconds do not fit into 64 bits.
    if len(seconds) and not np.abs(seconds).max() < 9e9:
        fault = f'expected times below 9e9 s in {file.path}'
        raise RecordingError(f'{fault}, got {np.abs(seconds).max():g} s: --time-unit decides')
    return stamps(seconds)


def _of_events(onset: IntArray, options: ImportOptions, file: SignalFile) -> PulseTrain:
    if not len(onset):
        raise RecordingError(f'expected pulses in {file.path}, got an empty list of events')
    return PulseTrain.numbered(onset, options.share)


_AMID = (
    'pulses come from the beginning, and the force is not at rest there: those before it are not '
    'in the file, and nothing is learnt while they may act; better begin at rest'
)
_BEGUN = (
    'the gate is up in the first row: when that pulse began is not in the file, and nothing is '
    'learnt while it may act; better begin at rest'
)
# The first pulse comes within so many intervals of the pulses after it.
_INTERVALS = 1.5
_FEWEST_PULSES = 5
# Share of the range of the force by which rest is left, at either end: a pull may be negative.
_SHARE = 0.15
# The same in standard deviations of the noise.
_NOISE = 6.0


def begins_amid(pulses: PulseTrain, forces: ForceTrace) -> bool:
    """Return whether stimulation was going on before the first sample, as far as a file shows.

    Parameters
    ----------
    pulses : PulseTrain
        Ascending.
    forces : ForceTrace
        Ascending.
    """
    known = np.isfinite(forces.force)
    force = forces.force[known]
    if len(pulses) < _FEWEST_PULSES or len(force) < 3:
        return False
    first_ns = int(forces.stamp_ns[0])
    interval = float(np.median(np.diff(pulses.onset_ns[: 10 * _FEWEST_PULSES])))
    if not 0.0 <= pulses.onset_ns[0] - first_ns < _INTERVALS * interval:
        return False
    # no pulse of the file acts on these
    before = force[forces.stamp_ns[known] <= pulses.onset_ns[0]]
    if not len(before):
        return False
    low, high = np.percentile(force, [1.0, 99.0])
    noise = float(np.median(np.abs(np.diff(force, 2)))) / (0.6745 * np.sqrt(6.0))
    least = max(_SHARE * (high - low), _NOISE * noise)
    return bool(low + least < float(np.median(before)) < high - least)


_ZIP, _XDF, _HDF5, _MATLAB = b'PK\x03\x04', b'XDF:', b'\x89HDF', b'MATLAB'


def read_signals(path: Path, block: int | None = None, sheet: str | None = None) -> SignalFile:
    """Return what a file holds.

    Parameters
    ----------
    path : Path
        Table of text, LabChart text, MATLAB, Excel or XDF file.
    block : int, optional
        Block of a LabChart file, from 1.
    sheet : str, optional
        Sheet of a workbook.

    Raises
    ------
    RecordingError
        If it cannot be read; the message says what was expected and which option decides.
    """
    # A pipe would be waited for without end.
    if not path.is_file():
        what = 'regular' if path.exists() else 'such'
        raise RecordingError(f'expected a file at {path}, got no {what} file')
    try:
        with path.open('rb') as file:
            head = file.read(1024)
    except OSError as error:
        raise RecordingError(f'expected a file at {path}, got {error}') from error
    if head.startswith(_ZIP):
        known: Callable[[Path], SignalFile] = partial(read_excel, sheet=sheet)
    elif sheet is not None:
        raise RecordingError(f'expected a workbook with --sheet, got {path}')
    elif _HDF5 in head:
        fault = "expected a MATLAB file up to version 7, as save(..., '-v7') writes it"
        raise RecordingError(f'{fault}, got 7.3 in {path}')
    elif head.startswith(_XDF):
        known = read_xdf
    elif head.startswith(_MATLAB) or path.suffix.lower() == '.mat':
        known = read_matlab
    else:
        return read_text(path, block)
    if block is not None:
        raise RecordingError(f'expected a LabChart file with --block, got {path}')
    return known(path)
