# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A study: many recordings identified by several processes, one table, one page.

Rows are kept one by one while it runs, then written as CSV and Parquet.
"""

import csv
import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import (
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from importlib import import_module
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rpms_ros.errors import RecordingError, ReportError, RpmsError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.model.physiology import PHYSIOLOGY_NAMES
from rpms_ros.identification.quality.verdict import VerdictSettings
from rpms_ros.printable import spreadsheet_text
from rpms_ros.recording import Recording, Topics, read_recording
from rpms_ros.recording.rosbag.scan import READERS
from rpms_ros.report.recorded import recorded_messages
from rpms_ros.report.result import (
    IdentificationOptions,
    IdentificationResult,
    Stated,
    identified,
    result_of,
)
from rpms_ros.schema import plain

Row = dict[str, Any]
# There is a process for each processor already: threads in each would only compete.
_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
_ENDS = ('', '_lower', '_upper')
_CURVE_SHOWN = (25, 50, 75, 100)
_TRAIN_INTERVALS = ('onset_s', 'twitch_time_constant_s', 'latency_s')
# columns that are fields of a result
_SAME = (
    *('session_hash', 'estimator', 'unit', 'samples', 'pulses', 'duration_s', 'rate_hz'),
    *('confidence', 'output_error_n', 'output_error_of_range'),
)
_PARAMETERS = ('u_thr', 'u_sat', 'alpha_sat', 'alpha_thr')


@dataclass(frozen=True)
class StudyOptions(IdentificationOptions):
    """How each recording is read and identified.

    Attributes
    ----------
    pulses_topic, force_topic : str
        Names of the topics.
    axis : str
        Axis of the force.
    sign : int
        1 or -1.
    quantity : str
        ``force`` or ``torque``: then every force of the table is in N m.
    max_memory : int or None
        What reading may take [bytes]; None for the default.
    expected_force : float
        Largest force that the muscles can have [N], for the verdict.
    reports : str or None
        Folder for a report page of each recording; None for none.
    """

    pulses_topic: str = 'pulses'
    force_topic: str = 'force'
    axis: str = 'z'
    sign: int = 1
    quantity: str = 'force'
    max_memory: int | None = None
    expected_force: float = 200.0
    reports: str | None = None


def columns() -> dict[str, type]:
    """Return the names of the columns and the type of their values."""
    numbers = ['duration_s', 'rate_hz', 'output_error_n', 'output_error_of_range', *_PARAMETERS]
    numbers += ['u_thr_lower', 'u_thr_upper', 'confidence']
    curve = [f'steady_force_{share}' for share in _CURVE_SHOWN]
    numbers += [f'{name}{end}' for name in curve for end in _ENDS]
    numbers += ['peak_force', 'time_to_peak_s']
    numbers += ['train_rate_hz', 'train_peak_force', 'train_fit_percent']
    stated = dict.fromkeys((*PHYSIOLOGY_NAMES, *_TRAIN_INTERVALS))
    numbers += [f'{name}{end}' for name in stated for end in _ENDS]
    texts = ['recording', 'status', 'reason', 'verdict', 'reasons', 'estimator']
    texts += ['train_model', 'unit', 'session_hash', 'report']
    counts = ['samples', 'pulses', 'start_ns']
    kinds: dict[str, type] = dict.fromkeys(texts, str) | dict.fromkeys(counts, int)
    return kinds | dict.fromkeys(numbers, float) | {'faults': str, 'notes': str}


def work(path: str, options: StudyOptions) -> Row:
    """Return the row of one recording; a recording that cannot be identified has a row too."""
    try:
        topics = Topics(options.pulses_topic, options.force_topic)
        recording = read_recording(
            path,
            topics,
            options.axis,
            options.sign,
            memory=options.max_memory,
            quantity=options.quantity,
        )
        session = identified(recording, options, most_estimates=None if options.reports else 1)
        settings = VerdictSettings(expected_force=options.expected_force)
        result = result_of(recording, session, settings)
        row = row_of(result) | {'start_ns': int(recording.forces.stamp_ns.min())}
        if options.reports:
            row['report'] = str(_write_report(path, options, recording, session, result))
    except RpmsError as error:
        return failure(str(error))
    return row


def _write_report(
    path: str,
    options: StudyOptions,
    recording: Recording,
    session: IdentifiedSession,
    result: IdentificationResult,
) -> Path:
    """Write the report page of a recording, as `rpms report` makes it; return its place."""
    # the extra rpms_ros[report]
    from rpms_ros.report.page import as_page
    from rpms_ros.report.session import report_of

    messages = recorded_messages(path, memory=options.max_memory)
    title = Path(path).resolve().name
    report = report_of(title, recording, messages, session, result, options.build)
    place = Path(options.reports or '', f'{_file_name(path)}.html')
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        replace_text(place, as_page(report))
    except OSError as error:
        raise ReportError(f'expected to write {place}, got {error}') from error
    return place


def _file_name(path: str) -> str:
    """Return a name for the page of a recording: readable, and not that of another one."""
    plain_name = re.sub(r'[^A-Za-z0-9_-]', '_', Path(path).name)[:60]
    return f'{plain_name}-{hashlib.sha256(str(Path(path).resolve()).encode()).hexdigest()[:8]}'


def replace_text(path: Path, text: str) -> None:
    """Write a file as a whole or not at all."""
    part = path.with_suffix('.part')
    part.write_text(text, encoding='utf-8', newline='')
    part.replace(path)


def failure(reason: str) -> Row:
    """Return the row of a recording that could not be identified."""
    return {'status': 'failed', 'reason': reason, 'faults': '{}'}


def row_of(result: IdentificationResult) -> Row:
    """Return the columns of a result; numbers with intervals have three."""
    response, trains = result.impulse_response, result.dynamics
    row: Row = {name: getattr(result, name) for name in _SAME} | (result.recruitment or {})
    stated = dict(result.physiology or {})
    if curve := result.curve:
        stated |= {f'steady_force_{share}': curve.at(share / 100) for share in _CURVE_SHOWN}
    if 'u_thr' in row and (ends := result.interval('u_thr')):
        stated['u_thr'] = Stated(row['u_thr'], *ends)
    if trains is None:
        row |= {'peak_force': response.peak.value, 'time_to_peak_s': response.peak_time_s}
    else:
        names = ('rate_hz', 'peak_force', 'fit_percent', 'model')
        row |= {f'train_{name}': getattr(trains, name) for name in names}
        row['order'] = trains.order
        # that of the estimator, whose model is not the one that is stated
        row |= dict.fromkeys(('output_error_n', 'output_error_of_range'))
        stated |= {name: one for name in _TRAIN_INTERVALS if (one := getattr(trains, name))}
    for name, one in stated.items():
        row |= {name: one.value, f'{name}_lower': one.lower, f'{name}_upper': one.upper}
    row |= {
        'status': 'ok',
        'verdict': result.verdict.grade,
        'reasons': '; '.join(result.verdict.reasons),
        'faults': json.dumps(result.faults, sort_keys=True),
        'notes': '; '.join(result.notes),
    }
    found: Row = plain(row)
    return found


def finished(
    paths: Sequence[Path], options: StudyOptions, jobs: int | None
) -> Iterator[tuple[Path, Row]]:
    """Yield recordings with their rows as they are done, in any order.

    Raises
    ------
    RecordingError
        If there is no process to work.
    """
    if not paths:
        return
    count = len(os.sched_getaffinity(0)) if jobs is None else jobs
    if count < 1:
        raise RecordingError(f'expected at least one job, got {jobs}')
    with _pool(min(count, len(paths))) as pool:
        futures = {pool.submit(work, str(path), options): path for path in paths}
        for future in as_completed(futures):
            yield futures[future], _outcome(future)


def _pool(count: int) -> Executor:
    if count == 1:
        return ThreadPoolExecutor(1)
    for name in _THREADS:
        os.environ.setdefault(name, '1')
    # Fresh interpreters: a fork would copy locks that threads of this process hold.
    return ProcessPoolExecutor(count, get_context('spawn'))


def _outcome(future: 'Future[Row]') -> Row:
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        return failure('a worker process died, perhaps for want of memory')
    if error is not None:
        return failure(f'{type(error).__name__}: {error}')
    return future.result()


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
        folders = (Path(folder) for folder, _, _ in os.walk(path))
        below = sorted(folder for folder in folders if _is_recording(folder))
        inner = [path] if _is_recording(path) or not path.is_dir() else below
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
    return any(one.name in _RESULTS for one in path.iterdir())


def _is_recording(path: Path) -> bool:
    if not path.is_dir():
        return False
    names = (one.name.removesuffix('.zstd') for one in path.iterdir())
    return any(name.endswith(tuple(READERS)) for name in names)


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
    one_person : bool
        Whether the recordings are sessions of one person.
    remarks : list of str
        What could not be written.
    """

    folder: Path
    recordings: Sequence[Path]
    options: StudyOptions
    one_person: bool = False
    remarks: list[str] = field(default_factory=list)

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
        file = StringIO()
        writer = csv.DictWriter(file, list(columns()))
        writer.writeheader()
        for row in self.rows():
            # no value that a spreadsheet takes for a formula
            cells = ((name, str(value)) for name, value in row.items() if isinstance(value, str))
            writer.writerow(row | {name: spreadsheet_text(text) for name, text in cells})
        replace_text(self.folder / 'results.csv', file.getvalue())

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
        from rpms_ros.report.group import group_document
        from rpms_ros.report.page import as_group_page

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
        found = [(file.name, file.stat()) for file in files if file.exists()]
        states = [(name, state.st_size, state.st_mtime_ns) for name, state in found]
        text = json.dumps([_VERSION, str(path.resolve()), states, asdict(self.options)])
        return f'{hashlib.sha256(text.encode()).hexdigest()[:32]}.json'
