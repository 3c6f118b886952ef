# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms identify` of one hour at 1 kHz, from start to result, as a process of its own.

3.6 million WrenchStamped and 72,000 pulses from mcap in the page cache.  The targets are
15 s for the recursion, 6 s for the batch, and 1.5 GB: of processor time, in the program and in the
kernel, since other work on the machine lengthens the time on the clock.

python bench/hour.py [--hours 1] [--repeat 3]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

LARGEST_GB = 1.5
LONGEST = {'recursive': 15.0, 'batch': 6.0}
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True)
class Cost:
    """Resources of one run.

    Attributes
    ----------
    span, user, system : float
        Time on the clock, and of the processor in the program and in the kernel [s].
    memory_gb : float
        Largest resident memory [GB].
    """

    span: float
    user: float
    system: float
    memory_gb: float


def simulate(path: Path, duration: float) -> None:
    """Write a recording of this length [s].

    In a process of its own: one that this one starts counts this one's memory as its own at first.
    """
    command = [sys.executable, '-m', 'rpms_ros.cli', 'simulate', '--out', str(path)]
    command += ['--duration', str(duration), '--quiet']
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def identify(path: Path, estimator: str) -> Cost:
    """Run the command once."""
    options = ('--preset', 'paper_table_4') if estimator == 'recursive' else ()
    command = [sys.executable, '-m', 'rpms_ros.cli', 'identify', str(path), '--json']
    begun = time.perf_counter()
    process = subprocess.Popen(
        [*command, '--estimator', estimator, *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    # Not `wait`: this tells the usage of this one process.
    _, status, usage = os.wait4(process.pid, 0)
    span = time.perf_counter() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return Cost(span, usage.ru_utime, usage.ru_stime, usage.ru_maxrss * 1024 / 1e9)


def measure(path: Path, short: Path, estimator: str, repeat: int) -> bool:
    """Print the resources of the estimator; return whether its best run meets the targets."""
    # Compilation does not count.
    identify(short, estimator)
    costs = [identify(path, estimator) for _ in range(repeat)]
    for cost in costs:
        print(
            f'  {estimator:<10}{cost.span:7.2f} s (processor {cost.user:.2f} s user, '
            f'{cost.system:.2f} s system), {cost.memory_gb:.2f} GB'
        )
    best = min(cost.user + cost.system for cost in costs)
    memory = max(cost.memory_gb for cost in costs)
    print(f'  {"":<10}targets {LONGEST[estimator]:g} s of the processor, {LARGEST_GB:g} GB')
    return best <= LONGEST[estimator] and memory <= LARGEST_GB


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hours', type=float, default=1.0)
    parser.add_argument('--repeat', type=int, default=3)
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        paths = {'hour': SECONDS_PER_HOUR * arguments.hours, 'short': 10.0}
        for name, duration in paths.items():
            simulate(Path(folder, name), duration)
        print(f'load of the machine {os.getloadavg()[0]:.1f} of {os.cpu_count()} processors')
        good = [
            measure(Path(folder, 'hour'), Path(folder, 'short'), estimator, arguments.repeat)
            for estimator in LONGEST
        ]
    return 0 if all(good) else 1


if __name__ == '__main__':
    sys.exit(main())
