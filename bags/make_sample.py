# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Make bags/sample, the recording of README's off-line example; always the same.

The average subject of magnetic stimulation, half a minute of random intensities at 20 Hz, force at
1 kHz with a noise of 0.02 N, packed to stay small.
"""

import shutil
import sys
from pathlib import Path

from rpms_ros.cli import main

FOLDER = Path(__file__).parent / 'sample'
OPTIONS = '--duration 30 --subject rpms --noise 0.02 --seed 1 --compression zstd'


def make(folder: Path) -> int:
    return main(['simulate', '--out', str(folder), '--quiet', *OPTIONS.split()])


if __name__ == '__main__':
    shutil.rmtree(FOLDER, ignore_errors=True)
    sys.exit(make(FOLDER))
