# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random schedules, faults and interleavings of threads, in virtual time: 100,000 of them.

Runs test/stimulation/test_controller_property.py with as many examples as asked for; exit code 1
if a pulse violates a limit of device or patient, comes after a stop, a missed heartbeat or its
latest time, or is not reported.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEST = ROOT / 'test' / 'stimulation' / 'test_controller_property.py'


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--examples', type=int, default=100_000)
    parser.add_argument('--processes', type=int, default=2)
    arguments = parser.parse_args(argv)
    environment = {**os.environ, 'RPMS_RANDOM_SCHEDULES': str(arguments.examples)}
    command = [sys.executable, '-m', 'pytest', '-q', '-n', str(arguments.processes), str(TEST)]
    began = time.monotonic()
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False)
    verdict = 'none broke a limit' if done.returncode == 0 else 'SOME FAILED'
    print(f'{arguments.examples} examples in {time.monotonic() - began:.0f} s: {verdict}')
    return done.returncode


if __name__ == '__main__':
    sys.exit(main())
