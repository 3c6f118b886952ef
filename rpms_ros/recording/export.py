# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as CSV files in a folder, for other programs.

A file or folder is there as a whole or not at all.
"""

import csv
import itertools
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable, spreadsheet_text
from rpms_ros.pulses import FloatArray, IntArray
from rpms_ros.recording.rosbag.reading import Recording, session_hash

_FORCE_COLUMNS = {'N': 'force_N', 'N m': 'torque_Nm'}
# MATLAB takes no longer name of a field.
_LONGEST_NAME = 60


@dataclass(frozen=True)
class EstimateTable:
    """Estimates of an identifier, one row each.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (estimates,)
        Newest force sample of each [ns].
    numbers : mapping of str to ndarray, shape (estimates,)
        Columns; not a number where an estimate has none.
    texts : mapping of str to sequence of str
        Columns.
    """

    stamp_ns: IntArray
    numbers: Mapping[str, FloatArray]
    texts: Mapping[str, Sequence[str]]


def column_names(names: Iterable[str]) -> list[str]:
    """Return names that any program takes: letters, digits and underscores, no two the same.

    The names of parameters come from a recording, that is from anybody.
    """
    taken: list[str] = []
    for name in names:
        plain = re.sub(r'[^A-Za-z0-9_]', '_', name)[:_LONGEST_NAME]
        plain = plain if plain[:1].isalpha() else f'x{plain}'
        numbered = (f'{plain[: _LONGEST_NAME - 5]}_{count}' for count in itertools.count(2))
        taken.append(next(one for one in itertools.chain([plain], numbered) if one not in taken))
    return taken


def write_tables(
    folder: Path,
    recording: Recording,
    name: str,
    estimates: EstimateTable | None = None,
    anonymous: bool = False,
) -> None:
    """Write a folder of CSV files and ``session.json``.

    Numbers have as many digits as it takes to read the same number again; times have all of their
    nanoseconds and count from the first force sample.

    Parameters
    ----------
    folder : Path
        Does not exist yet.
    recording : Recording
        What is written.
    name : str
        What people call it.
    estimates : EstimateTable or None
        None if none were recorded.
    anonymous : bool
        Whether date, name and notes are left out; times begin at 0 then.
    """
    pulses, forces = recording.pulses, recording.forces
    stamps = (forces.stamp_ns, pulses.onset_ns)
    origin_ns = next((int(one.min()) for one in stamps if len(one)), 0)
    facts: dict[str, Any] = {'origin_ns': str(origin_ns), 'unit': recording.unit}
    if anonymous:
        facts['origin_ns'] = str(origin_ns - int(pulses.onset_ns.min(initial=origin_ns)))
    else:
        notes = dict(recording.facts.custom)
        facts |= {'name': name, 'session_hash': session_hash(recording), 'notes': notes}
    train = {'intensity': pulses.intensity, 'width_s': pulses.width, 'sequence': pulses.sequence}
    tables: dict[str, tuple[IntArray, Mapping[str, npt.NDArray[Any]]]] = {
        'force': (forces.stamp_ns, {_FORCE_COLUMNS[recording.unit]: forces.force}),
        'pulses': (pulses.onset_ns, train),
    }
    if estimates is not None:
        names = column_names((*estimates.texts, *estimates.numbers))
        # no text that a spreadsheet would run
        texts = (map(spreadsheet_text, map(printable, row)) for row in estimates.texts.values())
        columns = [*(np.array([*row], object) for row in texts), *estimates.numbers.values()]
        tables['estimates'] = estimates.stamp_ns, dict(zip(names, columns, strict=True))
    folder.mkdir()
    text = json.dumps(facts, allow_nan=False, indent=1)
    (folder / 'session.json').write_text(text, encoding='utf-8')
    for title, (stamp_ns, table) in tables.items():
        times = [f'{Decimal(stamp - origin_ns).scaleb(-9):f}' for stamp in stamp_ns.tolist()]
        with (folder / f'{title}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(('time_s', *table))
            cells = (column.tolist() for column in table.values())
            writer.writerows(zip(times, *cells, strict=True))


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
