# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Time from `rpms demo --live` to the first curve in the browser.

Once with nothing compiled, as after installation, and once more.  The target is two minutes.

python bench/first_curve.py
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from live_page import Browser, free_port

LONGEST = 120.0
DEMO = 'import sys; from rpms_ros.cli import main; sys.exit(main())'


def seconds_to_the_curve(folder: Path, cache: Path) -> float:
    """Time from the command to the first frame that has a curve [s]."""
    port = free_port()
    command = [sys.executable, '-c', DEMO, 'demo', '--live', str(port), '--out', str(folder)]
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(cache)}
    begun = time.monotonic()
    demo = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    try:
        while not _answers(port):
            time.sleep(0.1)
        browser = Browser(f'ws://127.0.0.1:{port}/stream')
        browser.start()
        while not browser.curve_at:
            if demo.poll() is not None:
                sys.exit(f'expected a demo that runs, got exit code {demo.returncode}')
            time.sleep(0.02)
        return browser.curve_at - begun
    finally:
        if demo.poll() is None:
            demo.send_signal(signal.SIGINT)
        demo.wait()


def _answers(port: int) -> bool:
    try:
        socket.create_connection(('127.0.0.1', port)).close()
    except ConnectionRefusedError:
        return False
    return True


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, second = (
            seconds_to_the_curve(folder / run, folder / 'cache') for run in ('first', 'second')
        )
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    print('from `rpms demo --live` to a curve in the browser')
    print(f'  nothing compiled {first:6.1f} s (target < {LONGEST:.0f})')
    print(f'  once more        {second:6.1f} s')
    print(f'  processes that wanted a core, a core: {load:.1f}')
    return 0 if first < LONGEST else 1


if __name__ == '__main__':
    sys.exit(main())
