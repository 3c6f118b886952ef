# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The executables: each runs its node, or says in one line that ROS is missing."""

import os
import sys
from functools import partial
from importlib import import_module


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
    return int(module.main())


identifier = partial(_run, 'identifier')
plant_simulator = partial(_run, 'plant_simulator')
recorder = partial(_run, 'recorder')
stimulator_driver = partial(_run, 'stimulator_driver')
stop_button = partial(_run, 'stop_button')
operator_console = partial(_run, 'operator_console')
live_page = partial(_run, 'live_page')
