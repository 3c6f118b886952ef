# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command as a process of its own: streams, exit codes, nothing but JSON on stdout."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


def run(*arguments: object, **options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'rpms_ros.cli', *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
        env={**os.environ, **options},
    )


@pytest.mark.long
def test_works_where_there_is_no_ros(short_session: Path) -> None:
    code = (
        'import sys\n'
        'for name in ("rclpy", "rpms_msgs", "std_msgs"): sys.modules[name] = None\n'
        'from rpms_ros.cli import main\n'
        f'sys.exit(main(["identify", {str(short_session)!r}, "--json"]))\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=250, check=False
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert json.loads(done.stdout)['pulses'] == 200


@pytest.mark.parametrize(
    ('command', 'missing'),
    [('demo', 'rcl_interfaces'), ('live', 'rclpy')],
)
def test_a_command_that_needs_ros_says_so_in_a_line(command: str, missing: str) -> None:
    code = (
        f'import sys\nsys.modules[{missing!r}] = None\nfrom rpms_ros.cli import main\n'
        f'sys.exit(main([{command!r}]))\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=250, check=False
    )
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr == (
        f'rpms: error: rpms {command} finds no {missing}; it needs ROS 2 Jazzy and rpms_msgs: '
        'run make build, or source a workspace\n'
    )


def test_a_reader_that_leaves_early_is_no_error(short_session: Path) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, 'w') as pipe:
        done = subprocess.run(
            [sys.executable, '-m', 'rpms_ros.cli', 'info', str(short_session)],
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            timeout=250,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, '')


@pytest.mark.parametrize(
    'started',
    [
        'import rpms_ros.cli as one\nwith suppress(SystemExit): one.main(["--help"])',
        # up to the import of the node
        'import rpms_ros.nodes.executables as one\nwith suppress(ImportError): one._run("x.y")',
    ],
    ids=['rpms', 'node'],
)
def test_linear_algebra_has_one_thread(started: str) -> None:
    code = (
        f'import os, sys\nfrom contextlib import suppress\n{started}\nimport numpy\n'
        'numpy.ones((900, 900)) @ numpy.ones((900, 900))\n'
        'print(len(os.listdir("/proc/self/task")))'
    )
    environment = {k: v for k, v in os.environ.items() if not k.endswith('_NUM_THREADS')}
    done = subprocess.run(
        [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-1] == '1', done.stderr
