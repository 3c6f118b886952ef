# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exports of this package, read again with the same numbers in every bit."""

import csv
import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, IntArray, PulseTrain
from rpms_ros.recording.export.tables import (
    FACTS,
    FORCE,
    FORCE_COLUMNS,
    FORMAT,
    INTENSITY,
    MARK,
    PULSES,
    SEQUENCE,
    STAMP,
    TIME,
    VERSION,
    WIDTH,
)
from rpms_ros.recording.importing.formats import by_scipy

Columns = Mapping[str, Any]
_MOST_TEXT = 1_000_000_000
_LATEST = 9_000_000_000
_PLACES = ('beh', 'ses-*/beh', 'sub-*/beh', 'sub-*/ses-*/beh')
_NO_NUMBERS = (
    AttributeError, EOFError, InvalidOperation, LookupError, OSError, OverflowError, TypeError,
    ValueError, csv.Error,
)  # fmt: skip


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
            content = by_scipy('loadmat', path, simplify_cells=True)
            facts, pulses, force = content[MARK], content['pulses'], content['force']
        elif (path / FACTS).is_file():
            facts = json.loads((path / FACTS).read_text('utf-8'))
            texts = [(path / name).read_text('utf-8').splitlines() for name in (PULSES, FORCE)]
            pulses, force = (_columns(csv.reader(lines)) for lines in texts)
        else:
            facts, pulses, force = _of_bids(path)
        return _session(facts, pulses, force, path)
    except RecordingError:
        raise
    except _NO_NUMBERS as error:
        reason = f'{type(error).__name__}: {error}'
        raise RecordingError(f'expected an export of rpms at {path}, got {reason}') from error


def _session(
    facts: Mapping[str, Any], pulses: Columns, force: Columns, path: Path
) -> tuple[PulseTrain, ForceTrace, str]:
    if (found := (facts.get('format'), facts.get('version'))) != (FORMAT, VERSION):
        raise RecordingError(
            f'expected {FORMAT!r} version {VERSION} in {path}, got {found[0]!r} {found[1]!r}'
        )
    origin = int(facts['origin_ns'])
    ((unit, name),) = (one for one in FORCE_COLUMNS.items() if one[1] in force)
    intensity = _numbers(pulses, INTENSITY, float)
    for wrong in np.flatnonzero(~((intensity >= 0.0) & (intensity <= 1.0)))[:1].tolist():
        raise RecordingError(
            f'expected intensities from 0 to 1 in {path}, got {intensity[wrong]} of pulse '
            f'{wrong + 1}'
        )
    sequence, width = _numbers(pulses, SEQUENCE, int), _numbers(pulses, WIDTH, float)
    train = PulseTrain(_stamps(pulses, origin), intensity, sequence, width)
    return train, ForceTrace(_stamps(force, origin), _numbers(force, name, float)), unit


def _columns(rows: Iterable[Sequence[str]], names: Sequence[str] = ()) -> dict[str, list[str]]:
    """Return the columns of a table by these names, or those in its first row."""
    names, *cells = [names, *rows] if names else rows
    columns = zip(*cells, strict=True) if cells else [()] * len(names)
    return {name: list(column) for name, column in zip(names, columns, strict=True)}


def _numbers(table: Columns, name: str, kind: type) -> Any:
    cells = table[name]
    if isinstance(cells, list):
        cells = ['nan' if cell == 'n/a' else cell for cell in cells]
    return np.atleast_1d(np.asarray(cells)).astype(kind)


def _stamps(table: Columns, origin: int) -> IntArray:
    """Return stamps [ns]: those of MATLAB, or times in seconds, exact to the nanosecond."""
    if STAMP in table:
        return np.atleast_1d(np.asarray(table[STAMP], np.int64))
    stamps = []
    for cell in table[TIME]:
        time = Decimal(cell)
        if not -_LATEST < time < _LATEST:
            raise ValueError(f'expected times below {_LATEST} s, got {cell[:40]}')
        stamps.append(origin + int(time.scaleb(9).to_integral_value()))
    return np.array(stamps, dtype=np.int64)


def _events(folder: Path) -> list[Path]:
    found = (path for place in _PLACES for path in folder.glob(f'{place}/sub-*_events.tsv'))
    return sorted(path for path in found if path.is_file())


def _of_bids(folder: Path) -> tuple[Mapping[str, Any], Columns, Columns]:
    found = _events(folder)
    if len(found) != 1:
        names = ', '.join(str(path.relative_to(folder)) for path in found)
        raise RecordingError(
            f'expected one run in {folder}, got {names}: the folder of one of them decides'
        )
    events = found[0]
    start = events.name.removesuffix('events.tsv')
    physio = events.with_name(f'{start}recording-force_physio.json')
    facts = json.loads(physio.read_text('utf-8'))['RpmsRos']
    rows = _columns(_tab_separated(events.read_text('utf-8')))
    nibs = events.parent.parent / 'nibs' / f'{start}nibs.tsv'
    sets = _columns(_tab_separated(nibs.read_text('utf-8')))
    shares = [str(Decimal(cell).scaleb(-2)) for cell in sets['stimulus_intensity']]
    intensity = dict(zip(sets['nibs_event_id'], shares, strict=True))
    pulses = {
        TIME: rows['onset'],
        INTENSITY: [intensity[label] for label in rows['nibs_event_id']],
        WIDTH: rows['duration'],
        SEQUENCE: rows['sequence'],
    }
    with gzip.open(physio.with_suffix('.tsv.gz'), 'rt', encoding='utf-8') as file:
        text = file.read(_MOST_TEXT)
        if file.read(1):
            raise RecordingError(f'expected less than {_MOST_TEXT:.0e} characters in {file.name}')
    return facts, pulses, _columns(_tab_separated(text), (TIME, FORCE_COLUMNS[facts['unit']]))


def _tab_separated(text: str) -> list[list[str]]:
    return [line.split('\t') for line in text.splitlines()]
