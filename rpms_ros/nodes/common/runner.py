# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run one node as a process: discovery, init, build, spin, signals, shut down."""

import os
import random
import re
import signal
import socket
import sys
import threading
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from traceback import walk_stack
from types import FrameType
from typing import Any

import rclpy
import yaml
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args

from rpms_ros import __version__
from rpms_ros.errors import NodeError, RpmsError
from rpms_ros.nodes.common.diagnostics import logger_of
from rpms_ros.nodes.common.parameters import NodeParameters, descriptions
from rpms_ros.nodes.common.subscriptions import second_node
from rpms_ros.report.text import labelled

# Signals that would suspend the process; SIGSTOP cannot be caught.
_SUSPENDING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)

# Nothing can be done after a fault of the processor, in whose instruction these come.
_FAULTS = {'SIGSEGV', 'SIGBUS', 'SIGFPE', 'SIGILL', 'SIGTRAP', 'SIGSYS'}
_NEVER_CAUGHT = {'SIGKILL', 'SIGSTOP'}
# Ignored, by default or by Python.
_IGNORED = {'SIGCHLD', 'SIGCONT', 'SIGURG', 'SIGWINCH', 'SIGPIPE', 'SIGXFSZ'}


def name_of(number: int) -> str:
    """Return the name of a signal; most of those for real time have none."""
    named = number in list(signal.Signals)
    return signal.Signals(number).name if named else f'SIGRTMIN+{number - signal.SIGRTMIN}'


ENDING = tuple(
    number
    for number in sorted(signal.valid_signals() - set(_SUSPENDING))
    if name_of(number) not in _FAULTS | _NEVER_CAUGHT | _IGNORED
)
"""Signals that would end the process: all that can be caught."""


class StopRequest:
    """Signals as a request to end: a process that spins finishes its callback first.

    The handlers of rclpy shut the context down at once, so that publishing in a callback fails.
    The handler of Python raises in the running code, where the exception may get lost: callbacks
    from C print and discard it.  So the request is always stored too.  Nothing is raised within
    numba: what was half compiled or loaded would be called and crash the process.  A second signal
    ends a process there that does not spin yet.

    Attributes
    ----------
    made : bool
        Whether a signal has come.
    """

    def __init__(self) -> None:
        self.made = False
        self._spinning = self._ignoring = False
        self._before: dict[int, Callable[[int, FrameType | None], Any] | int | None] = {}
        self._take_over(ENDING)

    def heed_between_callbacks(self) -> None:
        """From now on only store signals, so that the spinning loop can check for them."""
        self._spinning = True

    def call_at_once(self, callback: Callable[[str], None]) -> None:
        """Let a thread call `callback` on a signal, whatever the main thread does.

        A handler in Python waits until the main thread runs Python code; the byte that wakes this
        thread does not.  Signals that would suspend the process end it from now on.
        """
        self._take_over(_SUSPENDING)
        read, written = os.pipe()
        os.set_blocking(written, False)
        signal.set_wakeup_fd(written, warn_on_full_buffer=False)

        def wait() -> None:
            with os.fdopen(read, 'rb', buffering=0) as pipe:
                for number in iter(lambda: pipe.read(1), b''):
                    if number[0] in self._before:
                        callback(f'signal {name_of(number[0])}')

        threading.Thread(target=wait, name='signals', daemon=True).start()

    def raise_if_made(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self.made:
            raise KeyboardInterrupt

    def ignore(self) -> None:
        """Let no further signal interrupt the end, of which a recording needs all."""
        self._ignoring = True
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)

    def restore(self) -> None:
        """Restore the earlier handlers."""
        for number, handler in self._before.items():
            # one that was not set by Python cannot be restored by it
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def _take_over(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            self._before[number] = signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._ignoring:
            return
        again, self.made = self.made, True
        modules = {one.f_globals.get('__name__', '').split('.')[0] for one, _ in walk_stack(frame)}
        if again or not self._spinning:
            if 'numba' not in modules:
                raise KeyboardInterrupt
            if again and number != signal.SIGALRM and not self._spinning:
                # a large function compiles for a minute, and nothing has begun that has to end
                os._exit(0)
            signal.setitimer(signal.ITIMER_REAL, 0.05)


PROFILE = Path(__file__).with_name('fast_discovery.xml')

# Jazzy's Fast DDS reads the first name, later releases the second.
_PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')

# Domains above 100 use ports that Linux hands out to others; people choose the first ten.
_DOMAINS = range(10, 101)
# The first of a domain may have gone, and those that came after it may still be there.
_PARTICIPANTS = 8
_MARK = 5


def use_fast_discovery() -> None:
    """Make participants of this process find others quickly, unless the user chose a profile."""
    if not any(name in os.environ for name in _PROFILE_VARIABLES):
        os.environ.update(dict.fromkeys(_PROFILE_VARIABLES, str(PROFILE)))


def stay_on_this_machine() -> None:
    """Make participants of this process find those of this machine only, unless told otherwise."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


@contextmanager
def free_domain() -> Iterator[int]:
    """Yield a DDS domain in which nobody is on this machine, chosen at random.

    As long as it is held, whoever chooses likewise gets another one.

    Raises
    ------
    NodeError
        If somebody is in every domain.
    """
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        # by the rule of DDS-RTPS participants receive on 10, 12, ... ports above, nobody on _MARK
        base = 7400 + 250 * domain
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mark:
            try:
                mark.bind(('127.0.0.1', base + _MARK))
                for participant in range(_PARTICIPANTS):
                    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                        probe.bind(('', base + 10 + 2 * participant))
            except OSError:
                continue
            yield domain
            return
    raise NodeError(f'expected a free DDS domain of {_DOMAINS}, got none')


PARENT_VARIABLE = 'RPMS_ROS_PARENT'
"""Environment variable with the id of the process with which this process is to end."""

_ROS_ARGUMENTS = 'Arguments of ROS: -p NAME:=VALUE, --params-file FILE, -r OLD:=NEW'

_BAD_ARGUMENTS = (
    rclpy_implementation.RCLError,
    rclpy_implementation.RCLInvalidROSArgsError,
    rclpy_implementation.UnknownROSArgsError,
    NameValidationException,
)


def run(build: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Run the node that `build` makes until a signal or shutdown; return the exit code.

    If the node has a method `stop_at_once`, it is called on a signal by another thread, and on
    an error before the executor is shut down.

    Parameters
    ----------
    build : callable
        Makes the node, in the default context.
    args : sequence of str, optional
        Command line; `sys.argv` if not given.

    Returns
    -------
    int
        0 after a signal or shutdown, 2 if the node could not be made or failed.
    """
    given = list(sys.argv if args is None else args)
    with suppress(*_BAD_ARGUMENTS):  # rclpy.init says what is wrong with arguments of ROS
        _refuse_options(build, remove_ros_args(given)[1:])
    use_fast_discovery()
    stop = StopRequest()
    node: Node | None = None
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        node = build()
        _warn_of_files_without_effect(given, node)
        at_once = getattr(node, 'stop_at_once', None)
        if at_once is not None:
            stop.call_at_once(at_once)
        _spin(node, stop)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (RpmsError, *_BAD_ARGUMENTS) as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        return 2
    finally:
        stop.ignore()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _warn_of_files_without_effect(arguments: Sequence[str], node: Node) -> None:
    """Warn of each file of parameters on the command line that has none for the node."""
    name = node.get_fully_qualified_name()
    for option, path in pairwise(arguments):
        # a pipe can be read once
        if option == '--params-file' and Path(path).is_file():
            # ROS has taken it; texts alone: it reads other dates and tags than this parser
            told = yaml.load(Path(path).read_bytes(), yaml.BaseLoader)
            nodes = list(_nodes_of(told))
            if not any(_means(pattern, name) for pattern in nodes):
                got = f'those of {", ".join(nodes)}' if nodes else 'none'
                logger_of(node).warning(f'expected parameters for {name} in {path}, got {got}')


def _nodes_of(file: Any, place: str = '') -> Iterator[str]:
    """Yield the names of nodes in a file of parameters, wildcards included."""
    for key, value in file.items() if isinstance(file, dict) else ():
        if key == 'ros__parameters':
            yield place
        else:
            yield from _nodes_of(value, f'{place}/{key.strip("/")}')


def _means(pattern: str, name: str) -> bool:
    """Return whether a name of a file of parameters means a node: `*` is one part, `**` any."""
    expression = re.escape(pattern).replace(r'/\*\*', '(/.*)?').replace(r'\*', '[^/]+')
    return re.fullmatch(expression, name) is not None


def _refuse_options(build: Callable[[], Node], options: Sequence[str]) -> None:
    """Print help or version, or exit with 2: a node takes ROS arguments only."""
    settings: type[NodeParameters] | None = getattr(build, 'settings_type', None)
    parser = ArgumentParser(
        usage='%(prog)s [-h] [--version] [--ros-args ARGUMENTS]',
        description=f'{(build.__doc__ or "").partition(";")[0]}.\n\n{_ROS_ARGUMENTS}',
        epilog=f'parameters:\n{labelled(_explained(settings))}' if settings else None,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'rpms_ros {__version__}')
    parser.parse_args(options)


def _explained(settings: type[NodeParameters]) -> Iterator[tuple[str, str]]:
    """Yield name and meaning of each parameter, with what is allowed and the default."""
    for name, description in descriptions(settings).items():
        default = getattr(settings, name)
        shown = list(default) if isinstance(default, tuple) else default
        facts = (description.conditions(), f'default {shown!r}')
        yield name, f'{description.doc} ({"; ".join(fact for fact in facts if fact)})'


_LAST_WORDS_S = 0.2


def _spin(node: Node, stop: StopRequest) -> None:
    executor, parent = EventsExecutor(), os.environ.get(PARENT_VARIABLE)
    executor.add_node(node)
    stop.heed_between_callbacks()
    failed: Exception | None = None
    try:
        # In Jazzy the spin() of this executor neither waits nor ends on signals.
        while rclpy.ok() and not stop.made:
            if parent is not None and os.getppid() != int(parent):
                break
            executor.spin_once(timeout_sec=0.1)
    except Exception as error:  # noqa: BLE001 - raised below
        getattr(node, 'stop_at_once', str)(f'expected to spin on, got {error!r}')
        failed = error
    until = time.monotonic() + (_LAST_WORDS_S if hasattr(node, 'stop_at_once') else 0.0)
    # what was stopped at once tells how it ended: status, results of goals
    while rclpy.ok() and time.monotonic() < until:
        try:
            executor.spin_once(timeout_sec=0.01)
        except Exception as error:  # noqa: BLE001 - raised below
            failed = failed or error
    executor.remove_node(node)
    executor.shutdown()
    # shutting an executor down during an exception has crashed processes
    if failed is not None:
        raise failed


@contextmanager
def complete_or_gone(node: Node) -> Iterator[ExitStack]:
    """Build the parts of a node; if that fails, end those that were made and destroy the node.

    Half of a node would stay on the graph until Python collects it: under its name, with its
    parameter services, and with subscriptions from which nobody reads.

    Parameters
    ----------
    node : Node
        Constructed as a node; its parts are made inside.

    Yields
    ------
    ExitStack
        What has to end before the node is destroyed, the newest first; `destroy_node` of the
        node closes it.

    """
    parts = ExitStack()
    try:
        yield parts
    except BaseException:
        # destroy_node does so too, where a node has parts of its own
        parts.close()
        node.destroy_node()
        raise


class NodeOfParts(Node):
    """A node that is there whole or not at all; keyword arguments go to `rclpy.node.Node`.

    A subclass makes its parts in `_build`, each after those that it depends on; what is put on
    `_parts` ends before the node is destroyed, the newest first.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        with complete_or_gone(self) as self._parts:
            self._build()

    def _build(self) -> None:
        """Make the parts of the node."""
        raise NotImplementedError

    def second_node(self) -> Node:
        """Return a node for subscriptions that no executor serves; it ends with this one."""
        node = second_node(self)
        self._parts.callback(node.destroy_node)
        return node

    def destroy_node(self) -> None:
        """End the parts, then destroy the node."""
        self._parts.close()
        Node.destroy_node(self)


def every(node: Node, period_s: float, do: Callable[[], object]) -> Timer:
    """Return a timer of a node [s] by a clock that nobody sets."""
    return node.create_timer(period_s, do, clock=Clock(clock_type=ClockType.STEADY_TIME))
