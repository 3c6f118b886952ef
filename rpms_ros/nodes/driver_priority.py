# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Real-time priority, so that pulses come in time on a machine that is busy."""

import os
from pathlib import Path


def ask_for_realtime(priority: int) -> str:
    """Put every thread of this process under SCHED_FIFO; return why not, empty if it worked.

    All threads and not only the one that keeps the time: that one waits for the interpreter
    whenever another one holds it, and must not wait for whatever holds up that other one.
    Processes that are started afterwards inherit it.

    Parameters
    ----------
    priority : int
        1 to 99.
    """
    parameters = os.sched_param(priority)
    try:
        for task in Path('/proc/self/task').iterdir():
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, parameters)
    except OSError as error:
        return f'expected the right to real-time priority {priority}, got {error}'
    return ''
