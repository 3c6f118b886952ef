# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A study: many recordings identified by several processes, one table as CSV and JSON."""

import csv
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rpms_ros.errors import RecordingError, RpmsError
from rpms_ros.identification.estimation.statement import PHYSIOLOGY_NAMES
from rpms_ros.identification.quality.explained_force import Stated
from rpms_ros.identification.quality.verdict import EXPECTED_FORCE
from rpms_ros.printable import spreadsheet_text
from rpms_ros.recording import Topics, read_recording
from rpms_ros.recording.rosbag.scan import READERS
from rpms_ros.report.result import (
    IdentificationOptions,
    IdentificationResult,
    identified,
    result_of,
)
from rpms_ros.schema import plain

Row = dict[str, Any]
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
    """

    pulses_topic: str = 'pulses'
    force_topic: str = 'force'
    axis: str = 'z'
    sign: int = 1
    quantity: str = 'force'
    max_memory: int | None = None
    expected_force: float = EXPECTED_FORCE


def columns() -> list[str]:
    """Return the names of the columns."""
    stated = dict.fromkeys((*PHYSIOLOGY_NAMES, *_TRAIN_INTERVALS))
    curve = (f'steady_force_{share}' for share in _CURVE_SHOWN)
    return [
        *('recording', 'status', 'reason', 'verdict', 'reasons', 'estimator', 'train_model'),
        *('unit', 'session_hash', 'samples', 'pulses', 'start_ns', 'duration_s', 'rate_hz'),
        *('output_error_n', 'output_error_of_range', *_PARAMETERS),
        *('u_thr_lower', 'u_thr_upper', 'confidence'),
        *(f'{name}{end}' for name in curve for end in _ENDS),
        *('peak_force', 'time_to_peak_s', 'train_rate_hz', 'train_peak_force'),
        *('train_fit_percent', *(f'{name}{end}' for name in stated for end in _ENDS)),
        *('faults', 'notes'),
    ]


def work(path: str, options: StudyOptions) -> Row:
    """Return the row of one recording; a recording that cannot be identified has a row too."""
    try:
        topics = Topics(options.pulses_topic, options.force_topic)
        force = options.axis, options.sign, None, options.max_memory, options.quantity
        recording = read_recording(path, topics, *force)
        session = identified(recording, options, most_estimates=1)
        row = row_of(result_of(recording, session, options.expected_force))
    except RpmsError as error:
        return failure(str(error))
    return row | {'start_ns': int(recording.forces.stamp_ns.min())}


def _replace_text(path: Path, text: str) -> None:
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
    workers = min(count, len(paths))
    # Fresh interpreters: a fork would copy locks that threads of this process hold.
    several = ProcessPoolExecutor(workers, get_context('spawn')) if workers > 1 else None
    with several or ThreadPoolExecutor(1) as pool:
        futures = {pool.submit(work, str(path), options): path for path in paths}
        for future in as_completed(futures):
            yield futures[future], _outcome(future)


def _outcome(future: 'Future[Row]') -> Row:
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        return failure('a worker process died, perhaps for want of memory')
    if error is not None:
        return failure(f'{type(error).__name__}: {error}')
    return future.result()


_VERSION = 3
# By these a folder or a file is known as something that a command of this package has written.
_RESULTS = {'index.html', 'result.json', 'report.json', 'results.csv', 'results.json'}
_RESULT_FILES = ('.html', '.png', '.svg', '.json', '.csv', '.yaml', '.md', '.txt')


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
    folder = path.is_dir() and not _is_recording(path)
    return folder and any(one.name in _RESULTS for one in path.iterdir())


def _is_recording(path: Path) -> bool:
    if not path.is_dir():
        return False
    names = (one.name.removesuffix('.zstd') for one in path.iterdir())
    return any(name.endswith(tuple(READERS)) for name in names)


class StudyTable:
    """Rows of a study.

    Parameters
    ----------
    folder : Path
        Where the table goes; rows that are in it already are used again.
    recordings : sequence of Path
        In the order of the table.
    options : StudyOptions
        Rows of other options are not used again.

    Raises
    ------
    RecordingError
        If the folder cannot be written to.
    """

    def __init__(self, folder: Path, recordings: Sequence[Path], options: StudyOptions) -> None:
        self.folder = folder
        self.recordings = recordings
        self._keys = {path: _key(path, options) for path in recordings}
        before: dict[str, Row] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # there is none yet, or it is of another version, or cut off
            with suppress(FileNotFoundError, KeyError, TypeError, ValueError):
                rows = json.loads((folder / 'results.json').read_text('utf-8'))
                before = {row['key']: row for row in rows if row['status'] == 'ok'}
        except OSError as error:
            raise RecordingError(f'expected to write into {folder}, got {error}') from error
        self._rows = {path: before[key] for path, key in self._keys.items() if key in before}

    def waiting(self) -> list[Path]:
        """Return the recordings that have no row yet."""
        return [path for path in self.recordings if path not in self._rows]

    def rows(self) -> list[Row]:
        """Return the rows that are there, in the order of the recordings, every column set."""
        empty: Row = dict.fromkeys(columns())
        done = (path for path in self.recordings if path in self._rows)
        return [empty | self._rows[path] | {'recording': str(path)} for path in done]

    def add(self, path: Path, row: Row) -> None:
        """Take a row."""
        self._rows[path] = row | {'key': self._keys[path]}

    def write(self) -> None:
        """Write results.csv and results.json.

        Raises
        ------
        RecordingError
            If the folder cannot be written to.
        """
        file = StringIO()
        writer = csv.DictWriter(file, columns(), extrasaction='ignore')
        writer.writeheader()
        for row in self.rows():
            # no value that a spreadsheet takes for a formula
            cells = ((name, value) for name, value in row.items() if isinstance(value, str))
            writer.writerow(row | {name: spreadsheet_text(text) for name, text in cells})
        try:
            _replace_text(self.folder / 'results.csv', file.getvalue())
            _replace_text(self.folder / 'results.json', json.dumps(self.rows(), indent=1))
        except OSError as error:
            raise RecordingError(f'expected to write into {self.folder}, got {error}') from error

    def remarks(self) -> list[str]:
        """Return what must be known before rows are compared."""
        sessions: dict[str, list[str]] = {}
        models: set[str] = set()
        for row in self.rows():
            if row['session_hash']:
                sessions.setdefault(row['session_hash'], []).append(row['recording'])
            if row['twitch_time_constant_s'] is not None and row['verdict'] != 'no':
                models.add(row['train_model'] or 'response to one pulse')
        twice = (', '.join(paths) for paths in sessions.values() if len(paths) > 1)
        alike = 'hold the same pulses and forces: they count more than once'
        remarks = [f'{paths} {alike}' for paths in twice]
        if len(models) > 1:
            remarks.append(
                f'T_a is that of different models ({", ".join(sorted(models))}), which do not '
                'measure the same: compare it within one (column train_model)'
            )
        return remarks


def _key(path: Path, options: StudyOptions) -> str:
    """Return a text that changes with the recording, the options and the columns."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    found = [(file.name, file.stat()) for file in files if file.exists()]
    states = [(name, state.st_size, state.st_mtime_ns) for name, state in found]
    text = json.dumps([_VERSION, str(path.resolve()), states, asdict(options)], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
