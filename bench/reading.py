"""Reading a recording in bulk beside the rosbags deserialisation loop, and from bag to result.

One hour at 1 kHz with 72,000 pulses by default: read by this package; by rosbags as raw messages
and with every message deserialised (on a part, scaled up); for each way of storing.  Then
`rpms identify` from start to result as a process of its own.  The targets are ten times the
rosbags loop, and 15 s and 1.5 GB for the recursion.

python bench/reading.py [--hours 1] [--estimator recursive]
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from rosbags.highlevel import AnyReader

from rpms_ros.cli import main as rpms
from rpms_ros.recording import read_recording
from rpms_ros.recording import write_recording

LOOP_MESSAGES = 100_000
STORAGES = (('mcap', ''), ('mcap', 'lz4'), ('mcap', 'zstd'), ('sqlite3', ''))
LEAST_RATIO, LONGEST, LARGEST = 10.0, 15.0, 1.5


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


def compare(path: Path, messages: int, label: str) -> float:
    """Print one line; return how many times faster than the loop reading is."""
    bulk = min(seconds(lambda: read_recording(path)) for _ in range(3))
    raw, loop = (loop_time(path, messages, decode) for decode in (False, True))
    size = sum(file.stat().st_size for file in path.iterdir()) / 1e6
    print(
        f'  {label:<12}{size:8.0f} MB{bulk:9.2f} s{1e6 * bulk / messages:8.3f} us{raw:11.2f} s'
        f'{loop:11.2f} s{loop / bulk:9.1f}'
    )
    return loop / bulk


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
            f'{"with loop":>13}{"ratio":>9}'
        )
        ratios = [compare(first, messages, 'mcap')]
        for storage, compression in STORAGES[1:]:
            path = Path(folder, f'{storage}{compression}')
            write_recording(
                path,
                recording.pulses,
                recording.forces,
                storage=storage,
                compression=compression,
            )
            ratios.append(compare(path, messages, f'{storage} {compression}'.strip()))
        span, processor, memory = identify(first, arguments.estimator)
        print(
            f'  rpms identify --estimator {arguments.estimator}: {span:.1f} s '
            f'({processor:.1f} s of processor), {memory:.2f} GB'
        )
    return 0 if ratios[0] >= LEAST_RATIO and span <= LONGEST and memory <= LARGEST else 1


if __name__ == '__main__':
    sys.exit(main())
