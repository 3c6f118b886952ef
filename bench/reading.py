# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading a recording in bulk beside the rosbags deserialisation loop, and from bag to result.

One hour at 1 kHz with 72,000 pulses by default: read by this package; by rosbags as raw messages
and with every message deserialised (on a part, scaled up); for each way of storing.  Besides, the
same file checked with zlib in place of isal, and with its checksums taken out.  Then
`rpms identify` from start to result as a process of its own.  The targets are ten times the
rosbags loop, a tenth more for checking, and 15 s and 1.5 GB for the recursion.

python bench/reading.py [--hours 1] [--estimator recursive]
"""

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from rosbags.highlevel import AnyReader

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from sqlite_bags import as_sqlite3

from rpms_ros.cli import main as rpms
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.recording.rosbag import mcap_files
from rpms_ros.recording.rosbag.mcap_files import MAGIC, walk

LOOP_MESSAGES = 100_000
STORAGES = ('', 'lz4', 'zstd', 'sqlite3')
LEAST_RATIO, LONGEST, LARGEST = 10.0, 15.0, 1.5
DEAREST_CHECK = 1.1
_REPEATS = 7


def seconds(action: Callable[[], object]) -> float:
    """Time of the processor for one call [s], which other processes do not disturb."""
    begun = time.process_time()
    action()
    return time.process_time() - begun


def rosbags_loop(path: Path, count: int, decode: bool) -> int:
    """Read messages one by one; return how many."""
    done = 0
    with AnyReader([path]) as reader:
        for connection, _, raw in islice(reader.messages(), count):
            if decode:
                reader.deserialize(raw, connection.msgtype)
            done += 1
    return done


def loop_time(path: Path, messages: int, decode: bool) -> float:
    """Time of the loop over all messages [s], from a part of them; opening is not scaled up."""
    part = min(LOOP_MESSAGES, messages)
    opening = seconds(lambda: rosbags_loop(path, 1, decode))
    return opening + (seconds(lambda: rosbags_loop(path, part, decode)) - opening) * (
        messages / part
    )


def unchecked(path: Path) -> Path:
    """Return a copy of a recording without any checksum."""
    copy = path.with_name(f'{path.name}_unchecked')
    shutil.copytree(path, copy)
    (copy / 'SHA256SUMS').unlink(missing_ok=True)
    for file in copy.glob('*.mcap'):
        content = bytearray(file.read_bytes())
        frame, _ = walk(np.frombuffer(content, np.uint8), len(MAGIC))
        # In a chunk behind two times and a size, at the end of the data and of the footer.
        places = [start + 24 for start, _ in frame.of_kind(Opcode.CHUNK)]
        places += [
            end - 4 for kind in (Opcode.DATA_END, Opcode.FOOTER) for _, end in frame.of_kind(kind)
        ]
        for place in places:
            content[place : place + 4] = bytes(4)
        file.write_bytes(content)
    return copy


def bulk_times(path: Path) -> tuple[float, float, float]:
    """Least times of reading, of reading with zlib and without checking [s], taken by turns."""
    copy, installed = unchecked(path), mcap_files.crc32
    times = []
    for _ in range(_REPEATS):
        checked = seconds(lambda: read_recording(path))
        vars(mcap_files)['crc32'] = zlib.crc32
        slowly = seconds(lambda: read_recording(path))
        vars(mcap_files)['crc32'] = installed
        times.append((checked, slowly, seconds(lambda: read_recording(copy))))
    shutil.rmtree(copy)
    checked, slowly, plain = (min(column) for column in zip(*times, strict=True))
    return checked, slowly, plain


def compare(path: Path, messages: int, label: str) -> tuple[float, float]:
    """Print one line; return the ratio of the loop to reading, and of reading to not checking."""
    bulk, slowly, plain = bulk_times(path)
    raw, loop = (loop_time(path, messages, decode) for decode in (False, True))
    size = sum(file.stat().st_size for file in path.iterdir()) / 1e6
    print(
        f'  {label:<12}{size:8.0f} MB{bulk:9.2f} s{1e6 * bulk / messages:8.3f} us{raw:11.2f} s'
        f'{loop:11.2f} s{loop / bulk:9.1f}{bulk / plain:11.2f}{slowly / plain:8.2f}'
    )
    return loop / bulk, bulk / plain


def identify(path: Path, estimator: str) -> tuple[float, float, float]:
    """Run `rpms identify` as a process; return time, processor time [s], largest memory [GB]."""
    command = [sys.executable, '-m', 'rpms_ros.cli', 'identify', str(path), '--json']
    command += ['--estimator', estimator]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    span = time.perf_counter() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return span, processor, after.ru_maxrss / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=1.0)
    parser.add_argument('--estimator', default='recursive')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder, 'mcap')
        options = ['--duration', str(3600 * arguments.hours), '--noise', '0.05', '--quiet']
        rpms(['simulate', '--out', str(first), '--schedule', 'uniform_random', *options])
        recording = read_recording(first)
        messages = len(recording.pulses) + len(recording.forces)
        print(f'{messages} messages in the page cache; processor times; ratio: loop over bulk')
        print(
            f'  {"storage":<12}{"size":>11}{"bulk":>11}{"a message":>11}{"rosbags raw":>13}'
            f'{"with loop":>13}{"ratio":>9}{"checking":>11}{"zlib":>8}'
        )
        ratios = [compare(first, messages, 'mcap')]
        for storage in STORAGES[1:]:
            path = Path(folder, storage)
            compression = '' if storage == 'sqlite3' else storage
            write_recording(path, recording.pulses, recording.forces, compression=compression)
            if storage == 'sqlite3':
                as_sqlite3(path)
            ratios.append(compare(path, messages, storage))
        span, processor, memory = identify(first, arguments.estimator)
        print(
            f'  rpms identify --estimator {arguments.estimator}: {span:.1f} s '
            f'({processor:.1f} s of processor), {memory:.2f} GB'
        )
    quick = ratios[0][0] >= LEAST_RATIO and all(check <= DEAREST_CHECK for _, check in ratios)
    return 0 if quick and span <= LONGEST and memory <= LARGEST else 1


if __name__ == '__main__':
    sys.exit(main())
