# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms study` over many simulated recordings with one process and with two.

500 recordings of one minute by default, each of another seed; the tables have to be the same, and
two processes at least 1.8 times as fast as one.

python bench/study.py [--count 500] [--seconds 60]
"""

import argparse
import sys
import tempfile
import time
from contextlib import redirect_stdout
from os import devnull
from pathlib import Path

from rpms_ros.cli import main as rpms

LEAST_RATIO = 1.8


def study(sessions: Path, out: Path, jobs: int) -> float:
    """Time of a study from start to table [s]."""
    begun = time.perf_counter()
    rpms(['study', str(sessions), '--out', str(out), '--jobs', str(jobs), '--quiet'])
    return time.perf_counter() - begun


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=500)
    parser.add_argument('--seconds', type=float, default=60.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sessions = Path(folder, 'sessions')
        with open(devnull, 'w') as nothing, redirect_stdout(nothing):  # noqa: PTH123
            for seed in range(arguments.count):
                options = ['--duration', str(arguments.seconds), '--seed', str(seed), '--quiet']
                rpms(['simulate', '--out', str(sessions / f'{seed:04}'), *options])
            # Compilation does not count.
            study(sessions / '0000', Path(folder, 'warm'), 1)
            spans = {jobs: study(sessions, Path(folder, str(jobs)), jobs) for jobs in (1, 2)}
        tables = {Path(folder, str(jobs), 'results.csv').read_bytes() for jobs in spans}
    ratio = spans[1] / spans[2]
    print(f'{arguments.count} recordings of {arguments.seconds:g} s')
    for jobs, span in spans.items():
        each = 1e3 * span / arguments.count
        print(f'  {jobs} process{"es" if jobs > 1 else ""}: {span:7.1f} s, {each:6.1f} ms each')
    print(f'  ratio {ratio:.2f}; tables {"equal" if len(tables) == 1 else "DIFFER"}')
    return 0 if ratio >= LEAST_RATIO and len(tables) == 1 else 1


if __name__ == '__main__':
    sys.exit(main())
