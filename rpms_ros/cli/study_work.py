# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The row of each recording of a study, computed by local processes or a Dask cluster."""

import hashlib
import json
import os
import re
from collections.abc import Iterator
from collections.abc import Sequence
from concurrent.futures import Executor
from concurrent.futures import Future
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rpms_ros.errors import RecordingError
from rpms_ros.errors import ReportError
from rpms_ros.errors import RpmsError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.identification.physiology import PHYSIOLOGY_NAMES
from rpms_ros.identification.verdict_settings import VerdictSettings
from rpms_ros.recording import Recording
from rpms_ros.recording import Topics
from rpms_ros.recording import read_recording
from rpms_ros.recording.reading import held_bytes
from rpms_ros.report.identified import IdentificationOptions
from rpms_ros.report.identified import identified
from rpms_ros.report.named import interval_of
from rpms_ros.report.recorded import recorded_messages
from rpms_ros.report.result import IdentificationResult
from rpms_ros.report.result import result_of
from rpms_ros.schema import plain

Row = dict[str, Any]
# There is a process for each processor already: threads in each would only compete.
_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
_CURVE_SHOWN = (25, 50, 75, 100)
_WITH_INTERVAL = PHYSIOLOGY_NAMES
_TRAIN_INTERVALS = ('onset_s', 'twitch_time_constant_s', 'latency_s')
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
    for share in _CURVE_SHOWN:
        numbers += [f'steady_force_{share}{end}' for end in ('', '_lower', '_upper')]
    numbers += ['peak_force', 'time_to_peak_s']
    numbers += ['train_rate_hz', 'train_peak_force', 'train_fit_percent']
    for name in dict.fromkeys((*_WITH_INTERVAL, *_TRAIN_INTERVALS)):
        numbers += [name, f'{name}_lower', f'{name}_upper']
    texts: dict[str, type] = {'recording': str, 'status': str, 'reason': str}
    texts |= {'verdict': str, 'reasons': str, 'estimator': str}
    texts |= {'train_model': str, 'unit': str, 'session_hash': str, 'report': str}
    counts: dict[str, type] = {'samples': int, 'pulses': int, 'start_ns': int}
    return texts | counts | dict.fromkeys(numbers, float) | {'faults': str, 'notes': str}


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
        row = _row(plain(result))
        row['start_ns'] = int(recording.forces.stamp_ns.min())
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
    from rpms_ros.report.session import analyse
    from rpms_ros.report.session import as_document
    from rpms_ros.report.session import as_page

    analysis = analyse(
        Path(path).resolve().name,
        recording,
        recorded_messages(path, memory=options.max_memory, held=held_bytes(recording)),
        session,
        result,
        lambda: estimator_by_name(
            options.estimator, options.preset, options.seed, options.rate_hz
        ),
    )
    place = Path(options.reports or '', f'{_file_name(path)}.html')
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        replace_text(place, as_page(analysis, as_document(analysis)))
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
    part.write_text(text, encoding='utf-8')
    part.replace(path)


def failure(reason: str) -> Row:
    """Return the row of a recording that could not be identified."""
    return {'status': 'failed', 'reason': reason, 'faults': '{}'}


def _row(document: dict[str, Any]) -> Row:
    response, curve = document['impulse_response'], document['curve']
    scalars = [name for name in columns() if not isinstance(document.get(name), dict | None)]
    row: Row = {name: document[name] for name in scalars}
    row |= document['recruitment'] or {}
    if curve:
        for name, end in (('force', ''), ('lower', '_lower'), ('upper', '_upper')):
            if values := curve.get(name):
                row |= {f'steady_force_{share}{end}': values[share] for share in _CURVE_SHOWN}
    row |= _threshold_interval(document)
    for name, found in document.get('physiology', {}).items():
        row |= {name: found['value']}
        row |= {f'{name}_{end}': found[end] for end in ('lower', 'upper')}
    peak = max(response['force'])
    row |= {
        'peak_force': peak,
        'time_to_peak_s': response['time_s'][response['force'].index(peak)],
    }
    if found := document.get('dynamics'):
        row |= _of_dynamics(found)
    verdict = document['verdict']
    return row | {
        'status': 'ok',
        'verdict': verdict['grade'],
        'reasons': '; '.join(verdict['reasons']),
        'faults': json.dumps(document['faults'], sort_keys=True),
        'notes': '; '.join(document['notes']),
    }


def _threshold_interval(document: dict[str, Any]) -> Row:
    """Return the ends of the interval of the threshold, as far as the data determine it."""
    value = (document['recruitment'] or {}).get('u_thr')
    deviation = (document.get('deviation') or {}).get('u_thr')
    known = value is not None and interval_of(
        'u_thr', value, deviation, document.get('confidence')
    )
    return dict(zip(('u_thr_lower', 'u_thr_upper'), known, strict=True)) if known else {}


def _of_dynamics(found: dict[str, Any]) -> Row:
    """Return the columns of trains of one intensity."""
    row: Row = dict.fromkeys(('peak_force', 'time_to_peak_s'))
    row |= {f'train_{name}': found[name] for name in ('rate_hz', 'peak_force', 'fit_percent')}
    row |= {'train_model': found['model'], 'order': found['order']}
    # It is that of the estimator, whose model is not the one that is stated.
    row |= dict.fromkeys(('output_error_n', 'output_error_of_range'))
    for name in _TRAIN_INTERVALS:
        if stated := found[name]:
            row |= {name: stated['value']}
            row |= {f'{name}_{end}': stated[end] for end in ('lower', 'upper')}
    return row


def finished(
    paths: Sequence[Path], options: StudyOptions, jobs: int | None, scheduler: str | None
) -> Iterator[tuple[Path, Row]]:
    """Yield recordings with their rows as they are done, in any order.

    Raises
    ------
    RecordingError
        If there is no process to work or no cluster at the address.
    """
    if not paths:
        return
    if scheduler:
        yield from _on_cluster(paths, options, scheduler)
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


def _on_cluster(
    paths: Sequence[Path], options: StudyOptions, scheduler: str
) -> Iterator[tuple[Path, Row]]:
    try:
        distributed = import_module('distributed')
    except ModuleNotFoundError as error:
        raise RecordingError(
            f'expected the extra rpms_ros[cluster] to be installed, got: {error}'
        ) from error
    try:
        client = distributed.Client(scheduler, timeout='10s')
    except (OSError, ValueError) as error:
        raise RecordingError(f'expected a Dask scheduler at {scheduler}, got {error}') from error
    with client:
        # Not pure: the cluster must not return a cached result of an earlier study.
        names = [str(path.resolve()) for path in paths]
        futures = dict(
            zip(client.map(work, names, options=options, pure=False), paths, strict=True)
        )
        for future in distributed.as_completed(list(futures)):
            yield futures[future], _outcome(future)


def _outcome(future: 'Future[Row]') -> Row:
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        return failure('a worker process died, perhaps for want of memory')
    if error is not None:
        return failure(f'{type(error).__name__}: {error}')
    return future.result()
