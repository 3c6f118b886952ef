# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as CSV files in a folder, for other programs.

A file or folder is there as a whole or not at all.
"""

import csv
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import IntArray
from rpms_ros.recording.rosbag.reading import Recording, session_hash

_FORCE_COLUMNS = {'N': 'force_N', 'N m': 'torque_Nm'}
# What no program takes in a name, nor a digit before it.
_NO_NAME = re.compile(r'\W|^(?=\d)', re.ASCII)

Table = Mapping[str, Sequence[Any]]
"""Cells of each column."""


def write_tables(
    folder: Path,
    recording: Recording,
    name: str,
    estimates: tuple[IntArray, Table] | None = None,
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
    estimates : (ndarray of int64, mapping of str to list) or None
        Newest force sample (estimates,) [ns] and cells (estimates,) of each column; None if none
        were recorded.
    anonymous : bool
        Whether date, name and notes are left out; times begin at 0 then.
    """
    pulses, forces = recording.pulses, recording.forces
    origin_ns = next((int(one.min()) for one in (forces.stamp_ns, pulses.onset_ns) if len(one)), 0)
    facts: dict[str, Any] = {'origin_ns': str(origin_ns), 'unit': recording.unit}
    if anonymous:
        facts['origin_ns'] = str(origin_ns - int(pulses.onset_ns.min(initial=origin_ns)))
    else:
        notes = dict(recording.facts.custom)
        facts |= {'name': name, 'session_hash': session_hash(recording), 'notes': notes}
    train = {'intensity': pulses.intensity, 'width_s': pulses.width, 'sequence': pulses.sequence}
    tables: dict[str, tuple[IntArray, Table]] = {
        'force': (forces.stamp_ns, {_FORCE_COLUMNS[recording.unit]: forces.force.tolist()}),
        'pulses': (pulses.onset_ns, {column: cells.tolist() for column, cells in train.items()}),
    }
    if estimates is not None:
        tables['estimates'] = estimates
    folder.mkdir()
    text = json.dumps(facts, allow_nan=False, indent=1)
    (folder / 'session.json').write_text(text, encoding='utf-8')
    for title, (stamp_ns, table) in tables.items():
        times = [f'{Decimal(stamp - origin_ns).scaleb(-9):f}' for stamp in stamp_ns.tolist()]
        with (folder / f'{title}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            # names of parameters come from a recording, that is from anybody
            writer.writerow(('time_s', *(_NO_NAME.sub('_', column) for column in table)))
            writer.writerows(zip(times, *table.values(), strict=True))


def written_whole(place: Path, write: Callable[[Path], object]) -> None:
    """Write a folder beside its place and move it there when it is complete.

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
            made.replace(place)
    except OSError as error:
        raise RecordingError(f'expected to write {place}, got {error}') from error
