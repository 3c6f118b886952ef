# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Use an installed wheel as a stranger would: `python tools/try_wheel.py bare|extras`.

`bare` is without any extra, where what an extra brings is refused in one line; `extras` is with
report and notebooks.
"""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import rpms_ros

# Nothing may come from a folder of sources, and there is no ROS.
if 'site-packages' not in str(Path(rpms_ros.__file__)):
    sys.exit(f'expected an installed rpms_ros, got {rpms_ros.__file__}')
for ros in ('rclpy', 'rpms_msgs'):
    if importlib.util.find_spec(ros) is not None:
        sys.exit(f'expected an environment without ROS, got {ros}')


def rpms(*arguments: str, status: int = 0) -> str:
    """Run a command; return what it printed, or its message where it is to fail."""
    done = subprocess.run(['rpms', *arguments], capture_output=True, text=True, check=False)
    if done.returncode != status or 'Traceback' in done.stderr:
        sys.exit(f'expected status {status} of rpms {arguments}, got {done}')
    return done.stderr if status else done.stdout


def bare() -> None:
    """Simulate, save, load, identify, plot; in Python and by the commands."""
    session = rpms_ros.simulate(duration=10.0, noise=0.02)
    session.save('session')
    result = rpms_ros.load('session').identify()
    truth = float(session.subject.steady_force(1.0, 20.0))
    stated = result.force_at(1.0)
    # 0.02 N of noise over 10 s leave less than 1 % of 10 N
    if not abs(stated.value - truth) < 0.01 * truth:
        sys.exit(f'expected a steady force of {truth:.3f} N, got {stated}')
    result.plot().savefig('session.png')
    printed = json.loads(rpms('identify', 'session', '--estimator', 'batch', '--json'))
    if printed != result.to_dict():
        sys.exit('expected the same result of the command and of Python, got another')
    rpms('--version')
    rpms('verify', 'session')
    rpms('export', 'session', '--out', 'tables')
    rpms('simulate', '--scenario', 'fatigue', '--duration', '5', '--out', 'tired')
    rpms('protocol', 'muscle', '--out', 'muscle.yaml')
    for arguments, extra in ((('report', 'session'), 'report'), (('demo',), 'ROS')):
        text = rpms(*arguments, status=2)
        if extra not in text or text.count('\n') != 1:
            sys.exit(f'expected one line that names {extra}, got {text!r}')


def extras() -> None:
    """The report."""
    rpms('report', 'session', '--estimator', 'batch', '--out', 'report.html')
    if '<script' not in Path('report.html').read_text(encoding='utf-8'):
        sys.exit('expected a page with its script, got one without')


{'bare': bare, 'extras': extras}[sys.argv[1]]()
