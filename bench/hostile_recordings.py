# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Behaviour of the commands on mutated recordings and on recordings with a flipped bit.

Mutations: bytes changed, cut out, doubled, cut off, of every file of small recordings in every
storage, one of them packed as a whole, given to `rpms info`, `verify` and `identify`.  None may
end in a traceback, take more than 10 s of processor time or more memory than 1 GB and four times
the file, or return an exit code that is not documented.  Flips: one bit of a storage file or of
metadata.yaml; either a fault is named, or nothing that is printed changes.  A warning of NumPy
counts as a traceback: it is no line that a user can do something with.

python bench/hostile_recordings.py [--mutations 10000] [--flips 2000] [--seed 1]
"""

import argparse
import contextlib
import io
import json
import os
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from backports import zstd

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from sqlite_bags import as_sqlite3

from rpms_ros.cli import main as rpms
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import write_recording
from rpms_ros.recording.rosbag.metadata import NAME as METADATA, write_checksums

STORAGES = ('', 'lz4', 'zstd', 'sqlite3')
COMMANDS = ('info', 'verify', 'identify')
# The quickest estimator: it is the reading that is tried.
_OPTIONS = {'identify': ('--estimator', 'recursive')}
LONGEST = 10.0
MEMORY = 1_000_000_000
DOCUMENTED = frozenset({0, 1, 2, 3})
_HOSTILE = (b'\xff' * 8, b'\0' * 8, b'\x7f' + b'\xff' * 7, b'[' * 64, b'&a *a ', b'\n- ')


def simulated(folder: Path) -> list[Path]:
    """Write a recording of a second in every storage; return their folders."""
    stamp_ns = 10**18 + np.arange(1000, dtype=np.int64) * 1_000_000
    generator = np.random.default_rng(1)
    pulses = PulseTrain.regular(generator.random(20), 20.0, 10**18)
    forces = ForceTrace(stamp_ns, generator.standard_normal(1000))
    paths = []
    for storage in STORAGES:
        path = folder / f'mcap{storage}'
        custom = {'operator': 'somebody', 'seed': '7'}
        compression = '' if storage == 'sqlite3' else storage
        write_recording(path, pulses, forces, compression=compression, custom=custom)
        if storage == 'sqlite3':
            as_sqlite3(path)
            # nothing else could tell a flipped bit of a number from the number
            write_checksums(path, sorted(one.name for one in path.iterdir()))
        paths.append(path)
    return [*paths, packed(paths[0], folder / 'mcapfile')]


def packed(source: Path, path: Path) -> Path:
    """Write a copy whose storage file is packed as a whole, as `ros2 bag record` can do it."""
    path.mkdir()
    name = f'{source.name}_0.mcap'
    (path / f'{name}.zstd').write_bytes(zstd.compress((source / name).read_bytes()))
    text = (source / METADATA).read_text().replace(name, f'{name}.zstd')
    text = text.replace("compression_format: ''", 'compression_format: zstd')
    text = text.replace("compression_mode: ''", 'compression_mode: FILE')
    (path / METADATA).write_text(text)
    write_checksums(path, (f'{name}.zstd', METADATA))
    return path


def mutated(content: bytes, generator: random.Random) -> bytes:
    """Return the content with a few changes of the kinds that break readers."""
    data = bytearray(content)
    for _ in range(generator.choice((1, 1, 1, 2, 5))):
        place = generator.randrange(len(data)) if data else 0
        size = generator.choice((1, 4, 8, 64, 1000))
        match generator.randrange(6):
            case 0:
                data[place : place + size] = generator.randbytes(size)
            case 1:
                del data[place : place + size]
            case 2:
                data[place:place] = data[place : place + size]
            case 3:
                del data[place:]
            case 4:
                piece = generator.choice(_HOSTILE)
                data[place : place + len(piece)] = piece
            case _:
                if data:
                    data[place] ^= 1 << generator.randrange(8)
    return bytes(data)


@contextlib.contextmanager
def changed(path: Path, content: bytes) -> Iterator[None]:
    """Give a file other content for a while."""
    before = path.read_bytes()
    path.write_bytes(content)
    try:
        yield
    finally:
        path.write_bytes(before)


def run(command: str, path: Path) -> tuple[int | str, str]:
    """Run a command in this process; return its exit code or traceback, and what it printed."""
    output = io.StringIO()
    words = [command, str(path), '--quiet', '--json', *_OPTIONS.get(command, ())]
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        try:
            return rpms(words), output.getvalue()
        except Exception:  # noqa: BLE001
            return traceback.format_exc(), ''


def try_mutations(paths: list[Path], count: int, seed: int) -> Counter[str]:
    """Return how many mutations ended how; print those that must not occur."""
    generator = random.Random(seed)
    ends: Counter[str] = Counter()
    for number in range(count):
        path = generator.choice(paths)
        file = generator.choice(sorted(path.iterdir()))
        command = COMMANDS[number % len(COMMANDS)]
        with changed(file, mutated(file.read_bytes(), generator)):
            begun = time.process_time()
            code, _ = run(command, path)
            span = time.process_time() - begun
        if code not in DOCUMENTED:
            print(f'mutation {number} of {file.name}, rpms {command}: {code}')
        if span > LONGEST:
            print(f'mutation {number} of {file.name}, rpms {command}: {span:.1f} s')
        ends[f'exit {code}' if code in DOCUMENTED else 'traceback'] += 1
        ends['too long'] += span > LONGEST
    return ends


_NAMED = ('faults', 'remarks', 'notes')


def shown(output: str) -> tuple[dict[str, object], dict[str, object]]:
    """Return what was printed without the faults, and the faults."""
    document: dict[str, object] = json.loads(output) if output else {}
    named = {key: document.pop(key) for key in _NAMED if key in document}
    return document, named


def try_flips(paths: list[Path], count: int, seed: int) -> Counter[str]:
    """Return how many flips ended how; print those that are not reported."""
    generator = random.Random(seed)
    clean = {path: run('identify', path) for path in paths}
    ends: Counter[str] = Counter()
    for number in range(count):
        path = generator.choice(paths)
        files = [
            file
            for file in sorted(path.iterdir())
            if file.suffix in ('.mcap', '.db3', '.yaml', '.zstd')
        ]
        file = generator.choice(files)
        content = bytearray(file.read_bytes())
        place, bit = generator.randrange(len(content)), generator.randrange(8)
        content[place] ^= 1 << bit
        with changed(file, bytes(content)):
            code, output = run('identify', path)
        where = f'flip {number}: bit {bit} of byte {place} of {path.name}/{file.name}'
        if code not in DOCUMENTED:
            print(f'{where}: {code}')
            ends['traceback'] += 1
        elif code == 2 or shown(output)[1] != shown(clean[path][1])[1]:
            ends['named'] += 1
        elif shown(output)[0] != shown(clean[path][1])[0]:
            print(f'{where} unnamed')
            ends['unnamed'] += 1
        else:
            ends['without effect'] += 1
    return ends


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--mutations', type=int, default=10_000)
    parser.add_argument('--flips', type=int, default=2000)
    parser.add_argument('--seed', type=int, default=1)
    arguments = parser.parse_args()
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    warnings.simplefilter('error', RuntimeWarning)
    with tempfile.TemporaryDirectory() as name:
        paths = simulated(Path(name))
        # Compilation does not count.
        for path in paths:
            run('identify', path)
        mutations = try_mutations(paths, arguments.mutations, arguments.seed)
        flips = try_flips(paths, arguments.flips, arguments.seed)
        largest = max(file.stat().st_size for path in paths for file in path.iterdir())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f'{arguments.mutations} mutations: {dict(mutations)}')
    print(f'{arguments.flips} flips: {dict(flips)}')
    print(f'largest memory {memory / 1e9:.2f} GB, target {(MEMORY + 4 * largest) / 1e9:.2f} GB')
    good = not (mutations['traceback'] or mutations['too long'])
    good &= not (flips['traceback'] or flips['unnamed'])
    return 0 if good and memory <= MEMORY + 4 * largest else 1


if __name__ == '__main__':
    sys.exit(main())
