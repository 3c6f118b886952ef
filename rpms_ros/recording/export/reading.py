# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exports of this package are read again, with the same numbers in every bit."""

import csv
import gzip
import json
import pickle
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, IntArray, PulseTrain
from rpms_ros.recording.export.content import (
    FORCE_COLUMNS,
    FORMAT,
    INTENSITY,
    SEQUENCE,
    TIME,
    VERSION,
    WIDTH,
)
from rpms_ros.recording.export.tables import FACTS, FORCE, MARK, PULSES

Columns = Mapping[str, Sequence[str]]
# A packed file may promise more than any session has [characters].
_MOST_TEXT = 1_000_000_000
# Beyond that nanoseconds do not fit into 64 bits [s].
_LATEST = 9_000_000_000
# Where a run is within a dataset, or within the folder of a subject or a visit.
_PLACES = ('beh', 'ses-*/beh', 'sub-*/beh', 'sub-*/ses-*/beh')
# What a wrong file leads to when it is read or its numbers are made.
_NO_NUMBERS = (
    AttributeError, EOFError, InvalidOperation, KeyError, LookupError, OSError, OverflowError,
    TypeError, ValueError, csv.Error,
)  # fmt: skip

# SciPy ends with a fault of memory on some damaged files.
_SCIPY = """\
import pickle, sys
import scipy.io
function, path, *flags = sys.argv[1:]
try:
    options = dict(flag.split('=') for flag in flags)
    options = {name: text == 'True' for name, text in options.items()}
    found = getattr(scipy.io, function)(path, **options)
except Exception as error:
    sys.exit(str(error) or repr(error))
pickle.dump(found, sys.stdout.buffer, protocol=5)
"""


def by_scipy(function: str, path: Path, **flags: bool) -> Any:
    """Return what ``loadmat`` or ``whosmat`` tells of a file, read in a process of its own.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    options = [f'{name}={flag}' for name, flag in flags.items()]
    command = [sys.executable, '-P', '-W', 'ignore', '-c', _SCIPY, function, str(path), *options]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        raise ValueError(f'damage on which SciPy crashes ({name})')
    if done.returncode:
        raise ValueError(done.stderr.decode(errors='replace').strip().splitlines()[-1])
    return pickle.loads(done.stdout)


def is_export(path: Path) -> bool:
    """Return whether a folder or file looks like an export of this package."""
    try:
        if path.is_dir():
            return (path / FACTS).is_file() or any(_events(path))
        if path.suffix.lower() != '.mat' or not path.is_file():
            return False
        return MARK in {name for name, _, _ in by_scipy('whosmat', path)}
    # scipy raises whatever the damage leads to; reading it will say so
    except Exception:  # noqa: BLE001
        return False


def read_export(path: Path) -> tuple[PulseTrain, ForceTrace, str]:
    """Return pulses, force and its unit of an export: a folder of CSV, a MATLAB file, or BIDS.

    Parameters
    ----------
    path : Path
        What `rpms export` wrote; of a BIDS dataset with several runs, a folder with one of them.

    Raises
    ------
    RecordingError
        If it is damaged, or of another version.
    """
    try:
        if path.is_file():
            return _of_matlab(path)
        return _of_tables(path) if (path / FACTS).is_file() else _of_bids(path)
    except RecordingError:
        raise
    except _NO_NUMBERS as error:
        reason = f'{type(error).__name__}: {error}'
        raise RecordingError(f'expected an export of rpms at {path}, got {reason}') from error


def _origin(facts: Mapping[str, Any], path: Path) -> int:
    """Return the stamp of the first sample, after a look at what the export is."""
    if facts.get('format') != FORMAT or facts.get('version') != VERSION:
        found = f'{facts.get("format")!r} {facts.get("version")!r}'
        raise RecordingError(f'expected {FORMAT!r} version {VERSION} in {path}, got {found}')
    return int(facts['origin_ns'])


def _of_tables(folder: Path) -> tuple[PulseTrain, ForceTrace, str]:
    origin = _origin(json.loads((folder / FACTS).read_text(encoding='utf-8')), folder / FACTS)
    with (folder / PULSES).open(encoding='utf-8', newline='') as file:
        pulses = _columns(csv.reader(file))
    with (folder / FORCE).open(encoding='utf-8', newline='') as file:
        force = _columns(csv.reader(file))
    return _pulses(pulses, origin, folder), *_force(force, origin)


def _columns(rows: Any) -> dict[str, list[str]]:
    """Return the columns of a table by its header."""
    head = next(rows, None)
    if head is None:
        raise ValueError('expected a header, got an empty table')
    columns = list(zip(*rows, strict=True)) or [()] * len(head)
    return {name: list(column) for name, column in zip(head, columns, strict=True)}


def _pulses(columns: Columns, origin: int, path: Path) -> PulseTrain:
    return _checked(
        PulseTrain(
            _stamps(columns[TIME], origin),
            np.array([float(cell) for cell in columns[INTENSITY]], dtype=np.float64),
            np.array([int(cell) for cell in columns[SEQUENCE]], dtype=np.int64),
            np.array([float(cell) for cell in columns[WIDTH]], dtype=np.float64),
        ),
        path,
    )


def _force(columns: Columns, origin: int) -> tuple[ForceTrace, str]:
    unit, name = _measured(columns)
    values = np.array([_number(cell) for cell in columns[name]], dtype=np.float64)
    return ForceTrace(_stamps(columns[TIME], origin), values), unit


def _measured(columns: Mapping[str, object]) -> tuple[str, str]:
    """Return unit and name of the column with what the sensor measured."""
    ((unit, name),) = (one for one in FORCE_COLUMNS.items() if one[1] in columns)
    return unit, name


def _number(cell: str) -> float:
    return float('nan') if cell == 'n/a' else float(cell)


def _stamps(seconds: Sequence[str], origin: int) -> IntArray:
    """Return stamps from times in seconds, exact to the nanosecond."""
    stamps = []
    for cell in seconds:
        time = Decimal(cell)
        if not -_LATEST < time < _LATEST:
            raise ValueError(f'expected times below {_LATEST} s, got {cell[:40]}')
        stamps.append(origin + int(time.scaleb(9).to_integral_value()))
    return np.array(stamps, dtype=np.int64)


def _checked(pulses: PulseTrain, path: Path) -> PulseTrain:
    wrong = ~((pulses.intensity >= 0.0) & (pulses.intensity <= 1.0))
    if wrong.any():
        first = int(np.argmax(wrong))
        raise RecordingError(
            f'expected intensities from 0 to 1 in {path}, got {pulses.intensity[first]} of pulse '
            f'{first + 1}'
        )
    return pulses


def _of_matlab(path: Path) -> tuple[PulseTrain, ForceTrace, str]:
    try:
        content = by_scipy('loadmat', path, simplify_cells=True)
    # scipy raises whatever the damage leads to
    except Exception as error:
        raise RecordingError(f'expected a MATLAB file at {path}, got {error}') from error
    _origin(content[MARK], path)
    force, pulses = content['force'], content['pulses']
    unit, name = _measured(force)

    def column(table: Any, key: str, kind: type) -> Any:
        return np.atleast_1d(np.asarray(table[key], dtype=kind))

    train = PulseTrain(
        column(pulses, 'stamp_ns', np.int64),
        column(pulses, INTENSITY, np.float64),
        column(pulses, SEQUENCE, np.int64),
        column(pulses, WIDTH, np.float64),
    )
    trace = ForceTrace(column(force, 'stamp_ns', np.int64), column(force, name, np.float64))
    return _checked(train, path), trace, unit


def _events(folder: Path) -> list[Path]:
    found = (path for place in _PLACES for path in folder.glob(f'{place}/sub-*_events.tsv'))
    return sorted(path for path in found if path.is_file())


def _of_bids(folder: Path) -> tuple[PulseTrain, ForceTrace, str]:
    found = _events(folder)
    if len(found) != 1:
        names = ', '.join(str(path.relative_to(folder)) for path in found)
        raise RecordingError(
            f'expected one run in {folder}, got {names}: the folder of one of them decides'
        )
    events = found[0]
    start = events.name.removesuffix('events.tsv')
    physio = events.with_name(f'{start}recording-force_physio.json')
    sidecar = json.loads(physio.read_text(encoding='utf-8'))
    origin = _origin(sidecar['RpmsRos'], physio)
    with events.open(encoding='utf-8') as file:
        rows = _columns(_tab_separated(file))
    nibs = events.parent.parent / 'nibs' / f'{start}nibs.tsv'
    with nibs.open(encoding='utf-8') as file:
        sets = _columns(_tab_separated(file))
    share = [str(Decimal(cell).scaleb(-2)) for cell in sets['stimulus_intensity']]
    intensity = dict(zip(sets['nibs_event_id'], share, strict=True))
    pulses = {
        TIME: rows['onset'],
        INTENSITY: [intensity[label] for label in rows['nibs_event_id']],
        WIDTH: rows['duration'],
        SEQUENCE: rows['sequence'],
    }
    quantity = FORCE_COLUMNS[sidecar['RpmsRos']['unit']]
    with gzip.open(physio.with_suffix('.tsv.gz'), 'rt', encoding='utf-8') as file:
        text = file.read(_MOST_TEXT)
        if file.read(1):
            raise RecordingError(f'expected less than {_MOST_TEXT:.0e} characters in {file.name}')
    columns = list(zip(*(line.split('\t') for line in text.splitlines()), strict=True))
    force = dict(zip((TIME, quantity), columns, strict=True))
    return _pulses(pulses, origin, events), *_force(force, origin)


def _tab_separated(file: TextIO) -> Any:
    return iter([line.rstrip('\n').split('\t') for line in file])
