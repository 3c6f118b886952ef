# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Ten thousand hostile goals on the real driver node: the test of the suite, at full count.

Prints how many goals were answered; exit code 1 if one was not, or if the node did not live.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEST = 'test/nodes/test_driver_goals.py'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=10_000)
    arguments = parser.parse_args()
    command = [sys.executable, '-m', 'pytest', '-q', '-s', '--timeout=0', TEST]
    environment = {**os.environ, 'RPMS_HOSTILE_GOALS': str(arguments.count)}
    # the node logs a line for each of them
    answer = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=False,
    )
    print('\n'.join(line for line in answer.stdout.splitlines() if 'hostile goals' in line))
    return answer.returncode


if __name__ == '__main__':
    sys.exit(main())
