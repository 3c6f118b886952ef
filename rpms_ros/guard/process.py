# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The guard as a process, a child of the driver."""

import argparse
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
    options = _parser().parse_args(arguments)
    try:
        limits = GuardLimits(
            options.maximum_percent,
            options.beat_limit,
            options.answer_limit,
            options.keep_alive,
        )
        wakeup = _woken_by_signals()
        driver = socket.socket(fileno=options.driver_descriptor)
        os.set_blocking(options.line_descriptor, False)
        driver.setblocking(False)
        driver.send(packets.packed(Packet(packets.HELLO)))
        reason = Guard(options.line_descriptor, driver.fileno(), limits, wakeup).run()
    except (OSError, ValueError) as error:
        _say(str(error))
        return 2
    if reason != 'the driver has left':
        _say(f'disarmed: {reason}')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description='Started by the driver of a stimulator.')
    for name in ('line-descriptor', 'driver-descriptor'):
        parser.add_argument(f'--{name}', type=int, required=True)
    for name, limit in (
        ('maximum-percent', GuardLimits.maximum_percent),
        ('beat-limit', GuardLimits.beat_limit_s),
        ('answer-limit', GuardLimits.answer_limit_s),
        ('keep-alive', GuardLimits.keep_alive_s),
    ):
        parser.add_argument(f'--{name}', type=type(limit), default=limit)
    return parser


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
