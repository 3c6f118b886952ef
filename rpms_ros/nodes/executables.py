# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The executables: each runs its node, or says in one line that ROS is missing."""

import os
import sys
from importlib import import_module


def identifier() -> int:
    """Run the identifier as a process."""
    return _run('identifier')


def plant_simulator() -> int:
    """Run the plant simulator as a process."""
    return _run('plant_simulator')


def recorder() -> int:
    """Run the recorder as a process."""
    return _run('recorder')


def stimulator_driver() -> int:
    """Run the stimulator driver as a process."""
    return _run('stimulator_driver')


def stop_button() -> int:
    """Run the stop button as a process."""
    return _run('stop_button')


def operator_console() -> int:
    """Run the operator's console as a process."""
    return _run('operator_console')


def live_page() -> int:
    """Run the live page as a process."""
    return _run('live_page')


def _run(name: str) -> int:
    # before NumPy is imported: its matrices are small, and threads that wait take processor time
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    try:
        module = import_module(f'rpms_ros.nodes.{name}')
    except ModuleNotFoundError as error:
        print(f'error: {error}; {name} needs ROS 2 Jazzy and rpms_msgs', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        # importing takes seconds, on a machine that is busy many
        return 0
    code: int = module.main()
    return code
