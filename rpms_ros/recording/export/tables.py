# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""CSV files in a folder, and one MATLAB file.

Files that are there as a whole or not at all.
"""

import csv
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable, spreadsheet_text
from rpms_ros.recording.export.content import (
    FORCE_COLUMNS,
    INTENSITY,
    SEQUENCE,
    TIME,
    WIDTH,
    EstimateTable,
    SessionExport,
    column_names,
    seconds,
    seconds_text,
)

FACTS, FORCE, PULSES, ESTIMATES = 'session.json', 'force.csv', 'pulses.csv', 'estimates.csv'
"""Files of a folder of CSV."""
MARK = 'rpms_ros_session'
"""Variable of a MATLAB file by which it is known as an export."""


def write_tables(folder: Path, session: SessionExport) -> None:
    """Write a folder of CSV files and ``session.json``.

    Numbers have as many digits as it takes to read the same number again; times have all of their
    nanoseconds.

    Parameters
    ----------
    folder : Path
        Does not exist yet.
    session : SessionExport
        What is written.
    """
    folder.mkdir()
    origin = session.origin_ns
    force = session.forces
    text = json.dumps(session.facts(), allow_nan=False, indent=1)
    (folder / FACTS).write_text(text, encoding='utf-8')
    columns: dict[str, Sequence[Any]] = {
        TIME: seconds_text(force.stamp_ns, origin),
        FORCE_COLUMNS[session.unit]: force.force.tolist(),
    }
    _write_csv(folder / FORCE, columns)
    pulses = session.pulses
    columns = {
        TIME: seconds_text(pulses.onset_ns, origin),
        INTENSITY: pulses.intensity.tolist(),
        WIDTH: pulses.width.tolist(),
        SEQUENCE: pulses.sequence.tolist(),
    }
    _write_csv(folder / PULSES, columns)
    if session.estimates is not None:
        _write_csv(folder / ESTIMATES, estimate_columns(session.estimates, origin))


def estimate_columns(table: EstimateTable, origin_ns: int) -> dict[str, Sequence[Any]]:
    """Return the columns of estimates, their names and texts such that no program runs them."""
    names = column_names((*table.texts, *table.numbers))
    texts = ([spreadsheet_text(printable(one)) for one in row] for row in table.texts.values())
    columns = [*texts, *(values.tolist() for values in table.numbers.values())]
    return {
        TIME: seconds_text(table.stamp_ns, origin_ns),
        **dict(zip(names, columns, strict=True)),
    }


def _write_csv(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    rows: Iterable[tuple[Any, ...]] = zip(*columns.values(), strict=True)
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(rows)


def write_matlab(path: Path, session: SessionExport) -> None:
    """Write a MATLAB file of version 5, with a structure for each table.

    ``force`` and ``pulses`` have their times twice: ``time_s``, and ``stamp_ns`` as whole
    nanoseconds, which are exact.

    Parameters
    ----------
    path : Path
        File to write.
    session : SessionExport
        What is written.

    Raises
    ------
    RecordingError
        If it does not fit into a file of version 5, whose variables have 4 GB at most.
    """
    origin, shift = session.origin_ns, session.origin_ns - session.stated_origin_ns
    forces, pulses = session.forces, session.pulses
    facts = session.facts()
    content: dict[str, Any] = {
        MARK: {
            **{name: value for name, value in facts.items() if isinstance(value, str | int)},
            'notes': json.dumps(facts.get('notes', {})),
        },
        'force': {
            TIME: seconds(forces.stamp_ns, origin),
            'stamp_ns': forces.stamp_ns - shift,
            FORCE_COLUMNS[session.unit]: forces.force,
        },
        'pulses': {
            TIME: seconds(pulses.onset_ns, origin),
            'stamp_ns': pulses.onset_ns - shift,
            INTENSITY: pulses.intensity,
            WIDTH: pulses.width,
            SEQUENCE: pulses.sequence,
        },
    }
    if (table := session.estimates) is not None:
        names = column_names((*table.texts, *table.numbers))
        texts = [np.array(row, dtype=object) for row in table.texts.values()]
        columns = dict(zip(names, (*texts, *table.numbers.values()), strict=True))
        content['estimates'] = {TIME: seconds(table.stamp_ns, origin), **columns}
    try:
        savemat(path, content, do_compression=True, long_field_names=True, oned_as='column')
    except (OverflowError, ValueError) as error:
        raise RecordingError(
            f'expected a session that fits into a MATLAB file, got {error}; --to csv takes any'
        ) from error


def written_whole(place: Path, write: Callable[[Path], object]) -> None:
    """Write a file or folder beside its place and move it there when it is complete.

    Parameters
    ----------
    place : Path
        Where it goes; there must be nothing yet.
    write : callable
        Is given the path to write.

    Raises
    ------
    RecordingError
        If there is something already, or it cannot be written.
    """
    if os.path.lexists(place):
        raise RecordingError(f'expected nothing at {place} yet, got something')
    parent = place.resolve().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix='.rpms-', dir=parent) as folder:
            made = Path(folder) / place.name
            write(made)
            if not made.is_dir():
                # a rename would replace a file that has come meanwhile without a word
                place.touch(exist_ok=False)
            made.replace(place)
    except OSError as error:
        raise RecordingError(f'expected to write {place}, got {error}') from error
