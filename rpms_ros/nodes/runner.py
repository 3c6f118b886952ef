# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run one node as a process: init, build, spin, shut down."""

import os
import sys
from argparse import ArgumentParser
from argparse import RawDescriptionHelpFormatter
from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rpms_ros import __version__
from rpms_ros.errors import RpmsError
from rpms_ros.nodes.discovery import use_fast_discovery
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameter_files import files_of
from rpms_ros.nodes.parameter_files import without_effect
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import descriptions
from rpms_ros.nodes.stop_request import StopRequest
from rpms_ros.report.text import labelled

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
    hook, sys.unraisablehook = sys.unraisablehook, _without_interrupts
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        node = build()
        _say_which_files_were_dropped(given, node)
        at_once = getattr(node, 'stop_at_once', None)
        if at_once is not None:
            stop.call_at_once(at_once)
        _spin(node, stop)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (RpmsError, *_BAD_ARGUMENTS) as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        return 2
    except Exception:
        # while it is built, what fails after a signal fails because of it: compilation discards
        # the interrupt and goes on without what was interrupted
        if node is not None or not stop.made:
            raise
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        sys.unraisablehook = hook
    return 0


def _say_which_files_were_dropped(arguments: Sequence[str], node: Node) -> None:
    lines = list(without_effect(arguments, node.get_fully_qualified_name()))
    # a file for other nodes of a launch is no mistake while another one is for this node
    alone = len(lines) == len(files_of(arguments))
    severity = LoggingSeverity.WARN if alone else LoggingSeverity.INFO
    for line in lines:
        logger_of(node).log(line, severity)


def _without_interrupts(discarded: Any) -> None:
    """Say what a callback from C has discarded, unless it is an interrupt: that is stored."""
    if discarded.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(discarded)


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


def _spin(node: Node, stop: StopRequest) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    stop.heed_between_callbacks()
    try:
        # In Jazzy the spin() of this executor neither waits nor ends on signals.
        while rclpy.ok() and not stop.made and not _orphaned():
            executor.spin_once(timeout_sec=0.1)
    except Exception as error:
        # shutting an executor down during an exception has crashed processes
        getattr(node, 'stop_at_once', _nothing)(f'expected to spin on, got {error!r}')
        raise
    finally:
        executor.remove_node(node)
        executor.shutdown()


def _nothing(_reason: str) -> None:
    """Do nothing: for nodes without `stop_at_once`."""


def _orphaned() -> bool:
    parent = os.environ.get(PARENT_VARIABLE)
    return parent is not None and os.getppid() != int(parent)
