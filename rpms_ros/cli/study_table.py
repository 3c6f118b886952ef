# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of a study: rows kept one by one while it runs, then written as CSV and Parquet."""

import csv
import hashlib
import json
import os
from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import field
from importlib import import_module
from pathlib import Path

from rpms_ros.cli.study_work import Row
from rpms_ros.cli.study_work import StudyOptions
from rpms_ros.cli.study_work import columns
from rpms_ros.cli.study_work import replace_text
from rpms_ros.errors import RecordingError
from rpms_ros.printable import spreadsheet_text
from rpms_ros.recording.files import READERS

_VERSION = 2


# By these a folder or a file is known as something that a command of this package has written.
_RESULTS = {'index.html', 'result.json', 'report.json', 'results.csv', 'results.parquet', 'rows'}
_RESULT_FILES = ('.html', '.png', '.svg', '.json', '.csv', '.parquet', '.yaml', '.md', '.txt')


def found_recordings(paths: Iterable[Path], out: Path | None = None) -> list[Path]:
    """Return the recordings that are meant, each once, in the order of the command line.

    A folder that is no recording itself stands for every recording below it, by name.  What a
    command has written there before, results of this study in `out` among them, is no recording
    and is left out, so that ``out/*`` may be given.  A path where there is nothing, or a folder
    without a recording and without results, is kept: it fails, with a row that says so.
    """
    found: dict[Path, None] = {}
    for path in paths:
        inner = [path] if _is_recording(path) or not path.is_dir() else _below(path)
        if not inner and not _is_result(path, out):
            inner = [path]
        found.update(dict.fromkeys(one for one in inner if not _is_result(one, out)))
    return list(found)


def _is_result(path: Path, out: Path | None) -> bool:
    """Return whether a path holds what a command wrote, and no recording."""
    if out is not None and path.resolve().is_relative_to(out.resolve()):
        return True
    if path.is_file():
        return path.suffix in _RESULT_FILES
    if not path.is_dir() or _is_recording(path):
        return False
    names = {one.name for one in path.iterdir()}
    return bool(names & _RESULTS)


def _below(path: Path) -> list[Path]:
    folders = (Path(folder) for folder, _, _ in os.walk(path))
    return sorted(folder for folder in folders if _is_recording(folder))


def _is_recording(path: Path) -> bool:
    return path.is_dir() and any(
        name.name.removesuffix('.zstd').endswith(tuple(READERS)) for name in path.iterdir()
    )


@dataclass
class StudyTable:
    """Rows of a study.

    Attributes
    ----------
    folder : Path
        Where the table goes; rows that are done are kept below it.
    recordings : sequence of Path
        In the order of the table.
    options : StudyOptions
        Rows of other options are not used again.
    remarks : list of str
        What could not be written.
    one_person : bool
        Whether the recordings are sessions of one person.
    """

    folder: Path
    recordings: Sequence[Path]
    options: StudyOptions
    remarks: list[str] = field(default_factory=list)
    one_person: bool = False

    def __post_init__(self) -> None:
        self._rows: dict[Path, Row] = {}
        try:
            self._kept.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f'expected to write into {self.folder}, got {error}') from error
        for path in self.recordings:
            if (row := self._kept_row(path)) is not None:
                self._rows[path] = row

    @property
    def _kept(self) -> Path:
        return self.folder / 'rows'

    def waiting(self) -> list[Path]:
        """Return the recordings that have no row yet."""
        return [path for path in self.recordings if path not in self._rows]

    def rows(self) -> list[Row]:
        """Return the rows that are there, in the order of the recordings, every column set."""
        return [
            {name: {'recording': str(path), **self._rows[path]}.get(name) for name in columns()}
            for path in self.recordings
            if path in self._rows
        ]

    def add(self, path: Path, row: Row) -> None:
        """Take a row and, unless it is a failure, keep it for the next time."""
        self._rows[path] = row
        if row['status'] == 'ok':
            replace_text(self._kept / self._name(path), json.dumps(row))

    def write(self) -> None:
        """Write results.csv, results.parquet and index.html.

        Raises
        ------
        RecordingError
            If the folder cannot be written to.
        """
        try:
            self._write_csv()
            self._write_parquet()
            self._write_page()
        except OSError as error:
            raise RecordingError(f'expected to write into {self.folder}, got {error}') from error

    def _write_csv(self) -> None:
        part = self.folder / 'results.csv.part'
        with part.open('w', newline='', encoding='utf-8') as file:
            writer = csv.DictWriter(file, list(columns()))
            writer.writeheader()
            writer.writerows(
                {name: _cell(value) for name, value in row.items()} for row in self.rows()
            )
        part.replace(self.folder / 'results.csv')

    def _write_parquet(self) -> None:
        try:
            pa, parquet = import_module('pyarrow'), import_module('pyarrow.parquet')
        except ModuleNotFoundError:
            self.remarks.append('results.parquet left out: it needs the extra rpms_ros[study]')
            return
        kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
        schema = pa.schema([(name, kinds[kind]) for name, kind in columns().items()])
        table = pa.Table.from_pylist(self.rows(), schema=schema)
        part = self.folder / 'results.parquet.part'
        parquet.write_table(table, part)
        part.replace(self.folder / 'results.parquet')

    def _write_page(self) -> None:
        from rpms_ros.report.group import as_group_page
        from rpms_ros.report.group import group_document

        title = self.folder.resolve().name
        document = group_document(self.rows(), title, self.one_person)
        try:
            page = as_group_page(document, self.folder)
        except ModuleNotFoundError:
            self.remarks.append('index.html left out: it needs the extra rpms_ros[report]')
            return
        replace_text(self.folder / 'index.html', page)

    def _kept_row(self, path: Path) -> Row | None:
        try:
            row: Row = json.loads((self._kept / self._name(path)).read_text())
        except (OSError, ValueError):
            return None
        # somebody may have removed its page
        page = row.get('report')
        return row if page is None or Path(page).is_file() else None

    def _name(self, path: Path) -> str:
        """Return a name that changes with the recording, the options and the columns."""
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        states = [
            (file.name, file.stat().st_size, file.stat().st_mtime_ns)
            for file in files
            if file.exists()
        ]
        text = json.dumps([_VERSION, str(path.resolve()), states, asdict(self.options)])
        return f'{hashlib.sha256(text.encode()).hexdigest()[:32]}.json'


def _cell(value: object) -> object:
    """Return a value that no spreadsheet takes for a formula."""
    return spreadsheet_text(value) if isinstance(value, str) else value
