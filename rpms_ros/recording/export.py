# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as CSV files in a folder, for other programs.

A file or folder is there as a whole or not at all.
"""

import csv
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable, spreadsheet_text
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, ForceTrace, IntArray, PulseTrain

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


@dataclass(frozen=True)
class SessionExport:
    """A session to be exported.

    Attributes
    ----------
    name : str
        What people call it.
    pulses, forces : PulseTrain, ForceTrace
        In the order in which they were received.
    unit : str
        Of the force: ``N``, or ``N m`` for a torque.
    estimates : EstimateTable or None
        None if none were recorded.
    session_hash : str
        Of what was read.
    notes : mapping of str to str
        What the recorder noted for people.
    anonymous : bool
        Whether date, name and notes are left out; times begin at 0 then.
    """

    name: str
    pulses: PulseTrain
    forces: ForceTrace
    unit: str = 'N'
    estimates: EstimateTable | None = None
    session_hash: str = ''
    notes: Mapping[str, str] = field(default_factory=dict)
    anonymous: bool = False

    @property
    def origin_ns(self) -> int:
        """Stamp of the first force sample, from which times are counted [ns]."""
        for stamps in (self.forces.stamp_ns, self.pulses.onset_ns):
            if len(stamps):
                return int(stamps.min())
        return 0

    def facts(self) -> dict[str, Any]:
        """Return what is written beside the tables; an anonymous session begins at 0."""
        if self.anonymous:
            first = min(int(self.pulses.onset_ns.min(initial=self.origin_ns)), self.origin_ns)
            return {'origin_ns': str(self.origin_ns - first), 'unit': self.unit}
        return {
            'origin_ns': str(self.origin_ns),
            'unit': self.unit,
            'name': self.name,
            'session_hash': self.session_hash,
            'notes': dict(self.notes),
        }

    def tables(self) -> dict[str, tuple[IntArray, dict[str, npt.NDArray[Any]]]]:
        """Return stamps [ns] and columns of each table, by its name."""
        forces, pulses, found = self.forces, self.pulses, self.estimates
        train: dict[str, npt.NDArray[Any]] = {
            'intensity': pulses.intensity,
            'width_s': pulses.width,
            'sequence': pulses.sequence,
        }
        force = {_FORCE_COLUMNS[self.unit]: forces.force}
        tables = {'force': (forces.stamp_ns, force), 'pulses': (pulses.onset_ns, train)}
        if found is not None:
            names = column_names((*found.texts, *found.numbers))
            # no text that a spreadsheet would run
            texts = (map(spreadsheet_text, map(printable, row)) for row in found.texts.values())
            columns = [*(np.array([*row], object) for row in texts), *found.numbers.values()]
            tables['estimates'] = found.stamp_ns, dict(zip(names, columns, strict=True))
        return tables


def seconds_text(stamp_ns: IntArray, origin_ns: int) -> list[str]:
    """Return times after the origin in seconds with all of their nanoseconds."""
    texts = []
    for stamp in stamp_ns.tolist():
        whole, rest = divmod(abs(stamp - origin_ns), NANOSECONDS_PER_SECOND)
        texts.append(f'{"-" if stamp < origin_ns else ""}{whole}.{rest:09d}')
    return texts


def column_names(names: Iterable[str]) -> list[str]:
    """Return names that any program takes: letters, digits and underscores, no two the same.

    The names of parameters come from a recording, that is from anybody.
    """
    taken: list[str] = []
    for name in names:
        plain = re.sub(r'[^A-Za-z0-9_]', '_', name)[:_LONGEST_NAME]
        plain = plain if plain[:1].isalpha() else f'x{plain}'
        count = 2
        unlike = plain
        while unlike in taken:
            unlike = f'{plain[: _LONGEST_NAME - 5]}_{count}'
            count += 1
        taken.append(unlike)
    return taken


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
    text = json.dumps(session.facts(), allow_nan=False, indent=1)
    (folder / 'session.json').write_text(text, encoding='utf-8')
    for name, (stamp_ns, columns) in session.tables().items():
        times = seconds_text(stamp_ns, session.origin_ns)
        with (folder / f'{name}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(('time_s', *columns))
            cells = (column.tolist() for column in columns.values())
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
