"""Run one node as a process: init, build, spin, and leave without a trace."""

import os
import sys
from collections.abc import Callable
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from rpms_ros.errors import RpmsError
from rpms_ros.nodes.discovery import use_fast_discovery
from rpms_ros.nodes.stop_request import StopRequest

PARENT_VARIABLE = 'RPMS_ROS_PARENT'
"""Process id of whoever started this process and wants it to end when it ends itself."""

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
    stop = StopRequest()
    node: Node | None = None
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        node = build()
        _spin(node, stop)
    except (KeyboardInterrupt, ExternalShutdownException):
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


def _spin(node: Node, stop: StopRequest) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    stop.heed_between_callbacks()
    try:
        # In Jazzy the spin() of this executor neither waits nor heeds signals.
        while rclpy.ok() and not stop.made and not _orphaned():
            executor.spin_once(timeout_sec=0.1)
    finally:
        executor.remove_node(node)
        executor.shutdown()


def _orphaned() -> bool:
    parent = os.environ.get(PARENT_VARIABLE)
    return parent is not None and os.getppid() != int(parent)
