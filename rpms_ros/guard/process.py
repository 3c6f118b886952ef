# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The guard as a process, a child of the driver.

Its arguments are the descriptors of line and driver, then the fields of `GuardLimits`.
"""

import contextlib
import gc
import os
import signal
import socket
import sys

from rpms_ros.guard import packets
from rpms_ros.guard.packets import Packet
from rpms_ros.guard.relay import Guard, GuardLimits

# Stopping for a debugger or a terminal, news of a child or a window, and what cannot be caught or
# must not be ignored; whatever else would end the process disarms first.
_LEFT_ALONE = {
    'SIGKILL', 'SIGSTOP', 'SIGTSTP', 'SIGTTIN', 'SIGTTOU', 'SIGCONT', 'SIGCHLD', 'SIGWINCH',
    'SIGURG', 'SIGSEGV', 'SIGBUS', 'SIGILL', 'SIGFPE', 'SIGABRT', 'SIGTRAP', 'SIGSYS', 'SIGPIPE',
}  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Serve the driver that has started this process; return the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        line, number, percent = map(int, given[:3])
        limits = GuardLimits(percent, *map(float, given[3:]))
        wakeup = _woken_by_signals()
        driver = socket.socket(fileno=number)
        os.set_blocking(line, False)
        driver.setblocking(False)
        driver.send(packets.packed(Packet(packets.HELLO)))
        reason = Guard(line, driver.fileno(), limits, wakeup).run()
    except (OSError, ValueError) as error:
        _say(str(error))
        return 2
    if reason != 'the driver has left':
        _say(f'disarmed: {reason}')
    return 0


def _woken_by_signals() -> int:
    """Return a descriptor that becomes readable with any signal that asks this process to end."""
    # nothing here makes cycles; a collection would only hold a disarming up
    gc.disable()
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in signal.valid_signals():
        name = signal.Signals(number).name if number in list(signal.Signals) else ''
        if name not in _LEFT_ALONE and number not in (32, 33):
            with contextlib.suppress(OSError, ValueError):
                signal.signal(number, lambda *_: None)
    return reading


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f'stimulator_guard: {text}\n')
        sys.stderr.flush()
