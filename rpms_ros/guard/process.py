# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`stimulator_guard`: started by the driver's device, or by hand on a socket of its own."""

import argparse
import contextlib
import gc
import os
import signal
import socket
import stat
import sys
from pathlib import Path

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
    """Run the guard; return the exit status."""
    options = _parser().parse_args(arguments)
    try:
        limits = GuardLimits(
            options.maximum_percent,
            options.beat_limit,
            options.answer_limit,
            options.keep_alive,
        )
        if options.line_descriptor is not None:
            return _serve_parent(options, limits)
        if options.port is None or options.socket is None:
            raise ValueError('expected --port and --socket, got no such thing')
        return _serve_by_hand(options.port, Path(options.socket), limits)
    except (OSError, ValueError) as error:
        _say(str(error))
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='stimulator_guard',
        description='Hold the serial port of a stimulator of the Rapid2 class for a driver; '
        'disarm it when the driver dies, hangs or is stopped.',
    )
    parser.add_argument('--port', help='serial port, e.g. /dev/ttyUSB0')
    parser.add_argument('--socket', help='where a driver finds this guard; its `port`')
    parser.add_argument(
        '--maximum-percent', type=int, default=100, help='refuse triggers above this intensity'
    )
    parser.add_argument(
        '--beat-limit', type=float, default=0.25, help='longest silence of the driver [s]'
    )
    parser.add_argument(
        '--answer-limit', type=float, default=0.2, help='longest wait for the instrument [s]'
    )
    parser.add_argument(
        '--keep-alive', type=float, default=0.4, help='the instrument hears something so often [s]'
    )
    # what the driver's device passes on to its child
    parser.add_argument('--line-descriptor', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--driver-descriptor', type=int, help=argparse.SUPPRESS)
    return parser


def _serve_parent(options: argparse.Namespace, limits: GuardLimits) -> int:
    wakeup = _woken_by_signals()
    driver = socket.socket(fileno=options.driver_descriptor)
    os.set_blocking(options.line_descriptor, False)
    driver.setblocking(False)
    driver.send(packets.packed(Packet(packets.HELLO)))
    reason = Guard(options.line_descriptor, driver.fileno(), limits, wakeup).run()
    if reason != 'the driver has left':
        _say(f'disarmed: {reason}')
    return 0


def _serve_by_hand(port: str, path: Path, limits: GuardLimits) -> int:
    """Hold a port, and serve one driver after another until a signal comes."""
    # only here: a child is handed its port
    from rpms_ros.guard.port import open_port

    line = open_port(port)
    with contextlib.closing(_listening(path)) as listening:
        wakeup = _woken_by_signals()
        _say(f'{port} is held; drivers find it at {path}')
        while not _was_told_to_end():
            listening.settimeout(0.2)
            try:
                driver, _ = listening.accept()
            except TimeoutError:
                continue
            with driver:
                driver.setblocking(False)
                hello = packets.packed(Packet(packets.HELLO))
                try:
                    # the descriptor lets the driver disarm when this process is gone
                    socket.send_fds(driver, [hello], [line])
                except OSError as error:
                    # it waited for the one before it, and gave up: the next one may come
                    _say(f'a driver has left before it was served: {error}')
                    continue
                reason = Guard(line, driver.fileno(), limits, wakeup).run()
            _say(f'disarmed: {reason}')
    path.unlink(missing_ok=True)
    return 0


def _listening(path: Path) -> socket.socket:
    """Return a socket at a path that only this user can reach; a dead one is replaced."""
    if path.exists():
        if not stat.S_ISSOCK(path.stat().st_mode):
            raise ValueError(f'expected a free path for the socket, got {path}')
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
            try:
                probe.connect(str(path))
            except ConnectionRefusedError:
                path.unlink()
            else:
                raise ValueError(f'expected no guard at {path}, got one that runs')
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    # it gets its name when it listens: who finds it can connect
    hidden = path.with_name(f'.{path.name}.{os.getpid()}')
    before = os.umask(0o177)
    try:
        listening.bind(str(hidden))
    finally:
        os.umask(before)
    # one driver at a time
    listening.listen(0)
    hidden.rename(path)
    return listening


_signals: list[int] = []


def _was_told_to_end() -> bool:
    return bool(_signals)


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
                signal.signal(number, lambda number, _: _signals.append(number))
    return reading


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f'stimulator_guard: {text}\n')
        sys.stderr.flush()
