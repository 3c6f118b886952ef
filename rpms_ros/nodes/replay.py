# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Plays a recording through the real identifier: both nodes in one process, over real DDS."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace
from typing import Any

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from rpms_ros.errors import NodeError
from rpms_ros.identification import Estimate
from rpms_ros.identification.arrival_order import feed
from rpms_ros.nodes.discovery import reserved_domain
from rpms_ros.nodes.discovery import use_fast_discovery
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.identifier_parameters import build_stream
from rpms_ros.nodes.replayer import PATIENCE
from rpms_ros.nodes.replayer import Replayer
from rpms_ros.nodes.replayer import ReplaySettings
from rpms_ros.recording import Recording

_READY_LIMIT = 10.0
# Silence after which missing estimates are given up [s].
_GIVE_UP = 10 * PATIENCE


@dataclass(frozen=True)
class Replay:
    """Result of a replay.

    Attributes
    ----------
    estimates : list of Estimate
        Estimates that the identifier published.
    expected : list of Estimate
        Estimates of the same estimator without nodes.
    messages : int
        Pulses and force samples that were sent.
    elapsed_s : float
        Duration of the replay, from the first message to the last estimate [s].
    recorded_s : float
        Duration of the recording [s].
    """

    estimates: list[Estimate]
    expected: list[Estimate]
    messages: int
    elapsed_s: float
    recorded_s: float

    @property
    def factor(self) -> float:
        """Seconds of the recording in one second."""
        return self.recorded_s / self.elapsed_s if self.elapsed_s > 0.0 else 0.0


def replay(
    recording: Recording,
    parameters: dict[str, Any] | None = None,
    settings: ReplaySettings | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Replay:
    """Play a recording through an identifier.

    Parameters
    ----------
    recording : Recording
        The recording.
    parameters : dict, optional
        Parameters of the identifier by name; axis and quantity are ignored.
    settings : ReplaySettings, optional
        Speed.
    progress : callable
        Called with the number of messages sent since the last call.

    Raises
    ------
    NodeError
        If a parameter is not valid or the nodes do not find each other.
    """
    chosen = {**(parameters or {}), 'axis': 'z', 'quantity': recording.quantity}
    expected = _expected(recording, _parameters(chosen))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    use_fast_discovery()
    context = Context()
    with reserved_domain() as domain:
        rclpy.init(
            args=[],
            context=context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            return _play(context, recording, chosen, settings, expected, progress)
        finally:
            context.try_shutdown()


def _play(
    context: Context,
    recording: Recording,
    parameters: dict[str, Any],
    settings: ReplaySettings | None,
    expected: list[Estimate],
    progress: Callable[[int], object],
) -> Replay:
    options: dict[str, Any] = {'context': context, 'use_global_arguments': False}
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    executor = EventsExecutor(context=context)
    nodes: list[Any] = []
    # the command prints what is replayed; the node logs faults and doubts
    set_logger_level('identifier', LoggingSeverity.WARN)
    try:
        nodes.append(Identifier(parameter_overrides=overrides, **options))
        replayer = Replayer(recording, settings, **options)
        nodes.append(replayer)
        for node in nodes:
            executor.add_node(node)
        _wait_until_ready(replayer, executor)
        started = time.monotonic()
        while replayer.sent < len(replayer):
            went = replayer.step()
            progress(went)
            executor.spin_once(timeout_sec=0.0 if went else 0.01)
        while len(replayer.estimates) < len(expected) and replayer.silence < _GIVE_UP:
            executor.spin_once(timeout_sec=0.05)
        elapsed = time.monotonic() - started
    finally:
        for node in nodes:
            executor.remove_node(node)
            node.destroy_node()
        executor.shutdown()
        set_logger_level('identifier', LoggingSeverity.UNSET)
    return Replay(replayer.estimates, expected, replayer.sent, elapsed, _span(recording))


def _wait_until_ready(replayer: Replayer, executor: Executor) -> None:
    end = time.monotonic() + _READY_LIMIT
    while not replayer.ready:
        if time.monotonic() > end:
            raise NodeError(f'expected the nodes to find each other within {_READY_LIMIT:g} s')
        executor.spin_once(timeout_sec=0.05)


def _parameters(values: dict[str, Any]) -> IdentifierParameters:
    try:
        return IdentifierParameters(**values)
    except TypeError as error:
        raise NodeError(f'expected parameters of the identifier, got {error}') from error


def _expected(recording: Recording, parameters: IdentifierParameters) -> list[Estimate]:
    """Return the estimates due on line: not those of the last `reorder_delay` of the recording."""
    stream = build_stream(parameters)
    estimates: list[Estimate] = []
    arrival = recording.samples_before_pulse
    for _ in feed(stream, recording.pulses, recording.forces, arrival):
        estimates += stream.advance()
    return [replace(one, unit=recording.unit) for one in estimates]


def _span(recording: Recording) -> float:
    received = np.concatenate([recording.pulse_received_ns, recording.force_received_ns])
    return float(np.ptp(received)) * 1e-9
