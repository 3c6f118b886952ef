"""Run one node as a process: init, build, spin, and leave without a trace."""

import sys
from collections.abc import Callable
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from rpms_ros.errors import RpmsError
from rpms_ros.nodes.discovery import use_fast_discovery

_ASKED_TO_STOP = (KeyboardInterrupt, ExternalShutdownException, ROSInterruptException)
_BAD_ARGUMENTS = (
    rclpy_implementation.RCLError,
    rclpy_implementation.RCLInvalidROSArgsError,
    rclpy_implementation.UnknownROSArgsError,
    NameValidationException,
)


def run(build: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Run the node that `build` makes until SIGINT, SIGTERM or shutdown; return the exit code.

    Parameters
    ----------
    build : callable
        Makes the node, in the default context.
    args : sequence of str, optional
        Command line; `sys.argv` if not given.

    Returns
    -------
    int
        0 after a signal or shutdown, 2 if the node could not be made or cannot go on.
    """
    use_fast_discovery()
    node: Node | None = None
    try:
        rclpy.init(args=None if args is None else list(args))
        node = build()
        _spin(node)
    except _ASKED_TO_STOP:
        pass
    except (RpmsError, *_BAD_ARGUMENTS) as error:
        line = ' '.join(str(error).split())
        print(f'error: {line}', file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Node) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        # In Jazzy the spin() of this executor neither waits nor heeds signals.
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    finally:
        executor.remove_node(node)
        executor.shutdown()
