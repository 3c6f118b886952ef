# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Mutated files of every other kind that the package reads: what comes of them.

Files of laboratories (text, LabChart, MATLAB, Excel) into `rpms import`; recordings
into `rpms export`; checksums into `rpms verify`; results into `rpms identify --start-from`;
history laws, scenarios, device specifications, patients, parameter files and audit logs into what
reads them.  `bench/hostile_recordings.py` does it with recordings, `bench/hostile_texts.py` with
schedules.

None may end in a traceback, end the process, take more than 10 s of processor time twice or more
memory than 1 GB, or return an exit code that is not documented.  The files are read in processes
of their own, of 200 files each, so that one that ends such a process is found.

python bench/hostile_files.py [--count 10000] [--seed 1] [--kind xlsx]
"""

import argparse
import contextlib
import io
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

import hostile_streams as streams
from hostile_recordings import changed, mutated
from laboratory_files import FORMATS, tables

import rpms_ros
from rpms_ros.cli import main as rpms
from rpms_ros.errors import RpmsError
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.muscle.scenario import load_scenario
from rpms_ros.recording import write_recording
from rpms_ros.stimulation.limits import patient
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, ChainedFile

LONGEST = 10.0
MEMORY = 1_000_000_000
A_PROCESS = 200
LONGEST_PROCESS = 1200.0
DOCUMENTED = frozenset({0, 1, 2, 3})
LAW = {'half_level': 3.0, 'facilitation': 0.3, 'time_constant': 25e-3, 'order': 3}
DOCUMENTS = ('history law', 'scenario', 'device', 'patient', 'audit log')
NAMES = (*FORMATS, *DOCUMENTS, *('export', 'checksums', 'result'))


class Kind(NamedTuple):
    """Files that may be mutated, and what reads them; the reading returns an exit code."""

    files: tuple[Path, ...]
    read: Callable[[], int]


def recording(folder: Path) -> Path:
    """Write a recording of four seconds."""
    path = folder / 'session'
    muscle = streams.session(1, 4)
    write_recording(path, muscle.pulses, muscle.forces)
    return path


def made(folder: Path, *words: str | Path) -> Callable[[], int]:
    """Return a command that writes something new each time."""

    def read() -> int:
        target = folder / 'out.mat'
        try:
            return rpms([*map(str, words), '--out', str(target)])
        finally:
            shutil.rmtree(target, ignore_errors=True)
            target.unlink(missing_ok=True)

    return read


def told(load: Callable[[], object]) -> Callable[[], int]:
    """Return a reading that gives something or one of the errors of the package."""

    def read() -> int:
        try:
            load()
        except RpmsError:
            return 2
        return 0

    return read


def kind_of(name: str, folder: Path) -> Kind:
    """Write the files of one of `NAMES`; return them with what reads them."""
    if name in FORMATS:
        path = tables(folder)[name]
        return Kind((path,), made(folder, 'import', path))
    if name in DOCUMENTS:
        return document(name, folder)
    session = recording(folder)
    files = tuple(sorted(session.iterdir()))
    if name == 'export':
        return Kind(files, made(folder, 'export', session))
    if name == 'checksums':
        return Kind((session / 'SHA256SUMS',), lambda: rpms(['verify', str(session)]))
    identify = ['identify', str(session), '--quiet', '--estimator', 'tracking']
    rpms([*identify, '--out', str(folder / 'result')])
    result = folder / 'result' / 'result.json'
    return Kind((result,), lambda: rpms([*identify, '--start-from', str(result)]))


def document(name: str, folder: Path) -> Kind:
    """Return one of the files that describe something, and what reads it."""
    path = folder / 'document.yaml'
    load: Callable[[], object]
    if name == 'history law':
        path.write_text(json.dumps(LAW))
        load = partial(TemporalSummation.of_file, path)
    elif name == 'scenario':
        copy('muscle/scenarios', path)
        load = partial(load_scenario, str(path))
    elif name == 'device':
        copy('stimulation/limits/device_specifications', path)
        load = partial(load_device_specification, str(path))
    elif name == 'patient':
        path.write_text(str(patient.__doc__).partition('\n\n')[2])
        load = partial(patient.load_patient, path)
    else:
        with contextlib.closing(ChainedFile(path, AUDIT_LOG)) as audit:
            for number in range(5):
                audit.append('refusal', {'limit': 'maximum_rate_hz', 'pulse': number})
        return Kind((path,), lambda: rpms(['audit', str(path)]))
    return Kind((path,), told(load))


def copy(part: str, path: Path) -> None:
    """Copy the first YAML file of a folder of the package."""
    shutil.copyfile(min((Path(rpms_ros.__file__).parent / part).glob('*.yaml')), path)


def run(read: Callable[[], int]) -> int | str:
    """Return the exit code of a reading, or its traceback."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            return read()
        except SystemExit as ended:
            return ended.code if isinstance(ended.code, int) else 2
        except Exception:  # noqa: BLE001
            return traceback.format_exc()


def worker(kind: str, first: int, count: int) -> None:
    """Mutate files of one kind with seeds from `first` on; print a line for each way it ended."""
    with tempfile.TemporaryDirectory() as name:
        with contextlib.redirect_stdout(io.StringIO()):
            own = kind_of(kind, Path(name))
        clean = run(own.read)
        print(json.dumps(['clean', clean]), flush=True)
        for seed in range(first, first + count):
            print(json.dumps(['begun', seed]), flush=True)
            generator = random.Random(seed)
            path = generator.choice(own.files)
            with changed(path, mutated(path.read_bytes(), generator)):
                begun = time.process_time()
                code = run(own.read)
                if time.process_time() - begun > LONGEST:
                    # What is compiled or loaded once is in nobody's time.
                    begun = time.process_time()
                    code = run(own.read)
                span = time.process_time() - begun
            print(json.dumps(['done', code, round(span, 2)]), flush=True)
    print(json.dumps(['memory', resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))


def tried(kind: str, first: int, count: int) -> tuple[Counter[str], float]:
    """Run a worker; return how its files ended, and its largest memory [bytes]."""
    words = [sys.executable, __file__, '--kind', kind, '--worker', str(first), str(count)]
    ends: Counter[str] = Counter()
    lines: list[list[object]] = []
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, check=False, timeout=LONGEST_PROCESS
        )
        output, code = done.stdout, done.returncode
        problem = done.stderr
    except subprocess.TimeoutExpired as late:
        output = (late.stdout or b'').decode()
        code, problem = -1, 'expected an end, got none'
    lines = [json.loads(line) for line in output.splitlines()]
    seeds = [line[1] for line in lines if line[0] == 'begun']
    memory = 0.0
    finished = 0
    for line in lines:
        if line[0] == 'clean' and line[1] not in DOCUMENTED - {2}:
            print(f'{kind}, not mutated: {line[1]}')
            ends['bad'] += 1
        if line[0] == 'memory':
            memory = float(str(line[1]))
        if line[0] == 'done':
            end, span = line[1], float(str(line[2]))
            ends[f'exit {end}' if end in DOCUMENTED else 'traceback'] += 1
            if end not in DOCUMENTED or span > LONGEST:
                print(f'{kind}, seed {seeds[finished]}, {span} s: {end}')
                ends['bad'] += 1
            finished += 1
    if code:
        print(f'{kind}, seed {seeds[-1] if seeds else first}: ended with {code} {problem[-500:]}')
        ends['bad'] += 1
    return ends, memory


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=10_000, help='files of all kinds together')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--kind', default='', help='one of them; all')
    parser.add_argument('--worker', type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    if arguments.worker:
        # a warning of NumPy is no line that a user can do something with
        warnings.simplefilter('error', RuntimeWarning)
        worker(arguments.kind, *arguments.worker)
        return 0
    names = [arguments.kind] if arguments.kind else NAMES
    total: Counter[str] = Counter()
    largest = 0.0
    each = -(-arguments.count // len(names))
    for kind in names:
        ends: Counter[str] = Counter()
        for first in range(0, each, A_PROCESS):
            seed = 1_000_000 * arguments.seed + first
            found, memory = tried(kind, seed, min(A_PROCESS, each - first))
            ends += found
            largest = max(largest, memory)
        print(f'{kind}: {dict(ends)}', flush=True)
        total += ends
    print(f'{each * len(names)} files: {dict(total)}')
    print(f'largest memory {largest / 1e9:.2f} GB, target {MEMORY / 1e9:.2f} GB')
    return 1 if total['bad'] or largest > MEMORY else 0


if __name__ == '__main__':
    sys.exit(main())
