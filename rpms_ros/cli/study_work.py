"""The row of each recording of a study, computed by local processes or a Dask cluster."""

import json
import os
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
from rpms_ros.errors import RpmsError
from rpms_ros.identification.physiology import PHYSIOLOGY_NAMES
from rpms_ros.identification.verdict import VerdictSettings
from rpms_ros.recording import Topics
from rpms_ros.recording import read_recording
from rpms_ros.report.identified import IdentificationOptions
from rpms_ros.report.identified import identified
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
    max_memory : int or None
        What reading may take [bytes]; None for the default.
    expected_force : float
        Largest force that the muscles can have [N], for the verdict.
    """

    pulses_topic: str = 'pulses'
    force_topic: str = 'force'
    axis: str = 'z'
    sign: int = 1
    max_memory: int | None = None
    expected_force: float = 200.0


def columns() -> dict[str, type]:
    """Return the names of the columns and the type of their values."""
    numbers = ['duration_s', 'rate_hz', 'output_error_n', 'output_error_of_range', *_PARAMETERS]
    numbers += [f'steady_force_{share}' for share in _CURVE_SHOWN]
    numbers += ['peak_force', 'time_to_peak_s']
    numbers += ['train_rate_hz', 'train_peak_force', 'train_fit_percent']
    for name in dict.fromkeys((*_WITH_INTERVAL, *_TRAIN_INTERVALS)):
        numbers += [name, f'{name}_lower', f'{name}_upper']
    texts: dict[str, type] = {'recording': str, 'status': str, 'reason': str}
    texts |= {'verdict': str, 'reasons': str, 'estimator': str}
    texts |= {'train_model': str}
    counts: dict[str, type] = {'samples': int, 'pulses': int}
    return texts | counts | dict.fromkeys(numbers, float) | {'faults': str, 'notes': str}


def work(path: str, options: StudyOptions) -> Row:
    """Return the row of one recording; a recording that cannot be identified has a row too."""
    try:
        topics = Topics(options.pulses_topic, options.force_topic)
        recording = read_recording(
            path, topics, options.axis, options.sign, memory=options.max_memory
        )
        session = identified(recording, options, most_estimates=1)
        settings = VerdictSettings(expected_force=options.expected_force)
        document = plain(result_of(recording, session, settings))
    except RpmsError as error:
        return failure(str(error))
    return _row(document)


def failure(reason: str) -> Row:
    """Return the row of a recording that could not be identified."""
    return {'status': 'failed', 'reason': reason, 'faults': '{}'}


def _row(document: dict[str, Any]) -> Row:
    response, curve = document['impulse_response'], document['curve']
    scalars = [name for name in columns() if not isinstance(document.get(name), dict | None)]
    row: Row = {name: document[name] for name in scalars}
    row |= document['recruitment'] or {}
    if curve:
        row |= {f'steady_force_{share}': curve['force'][share] for share in _CURVE_SHOWN}
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


def _of_dynamics(found: dict[str, Any]) -> Row:
    """Return the columns of trains of one intensity."""
    row: Row = dict.fromkeys(('peak_force', 'time_to_peak_s'))
    row |= {f'train_{name}': found[name] for name in ('rate_hz', 'peak_force', 'fit_percent')}
    row |= {'train_model': found['model'], 'order': found['order']}
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
