# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Plays a recording through the real identifier: both nodes in one process, over real DDS.

As fast as possible means: ahead of the newest estimate by no more messages than the queues of the
identifier hold, so that nothing is lost.  Messages are sent in the order in which they were
received, in the same bytes as a driver and a sensor send.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from rpms_msgs.msg import MuscleEstimate, Pulse
from rpms_ros import estimate_messages, messages
from rpms_ros.errors import NodeError
from rpms_ros.identification import Estimate
from rpms_ros.identification.session import feed
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import free_domain, use_fast_discovery
from rpms_ros.nodes.identifier import Identifier, IdentifierParameters, build_stream
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, IntArray
from rpms_ros.recording import Recording
from rpms_ros.recording.rosbag.writing import encode_forces, encode_pulses

# Messages that may be ahead of the newest estimate: fewer than the queues of the identifier hold.
WINDOW = 2000
# After so long without an estimate, no estimate is due from the messages sent so far [s].
PATIENCE = 0.5
_AXIS = np.array(messages.AXES['z'])
_COIL = 'coil'


class Replayer(Node):
    """Plays a recording and keeps the estimates that come back.

    Parameters
    ----------
    recording : Recording
        The recording; its force or torque is published along the z axis.
    factor : float
        Seconds of the recording in one second; 0 for as fast as possible.
    **options
        Passed to `rclpy.node.Node`.
    """

    def __init__(self, recording: Recording, factor: float = 0.0, **options: Any) -> None:
        super().__init__('replayer', **options)
        self._factor = factor
        self.estimates: list[Estimate] = []
        self.sent = 0
        pulses, forces = recording.pulses, recording.forces
        self._is_pulse, self._index, self._due_ns = _order(recording)
        self._pulse_bytes = encode_pulses(pulses, _COIL)
        self._force_bytes = encode_forces(forces, _AXIS, recording.quantity)
        self._force_stamp_ns = np.maximum.accumulate(forces.stamp_ns)
        # how many messages were sent up to each force sample
        self._sent_with_force = np.flatnonzero(~self._is_pulse) + 1
        self._used = 0
        self._started: float | None = None
        self._heard = time.monotonic()
        self._pulses = self.create_publisher(Pulse, topics.PULSES, qos.PULSES)
        self._force = self.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
        self.create_subscription(MuscleEstimate, topics.ESTIMATE, self._on_estimate, qos.ESTIMATE)

    def __len__(self) -> int:
        """Return how many messages there are to send."""
        return len(self._index)

    @property
    def ready(self) -> bool:
        """Whether pulses and force have subscribers and estimates a publisher."""
        return (
            self._pulses.get_subscription_count() > 0
            and self._force.get_subscription_count() > 0
            and self.count_publishers(self.resolve_topic_name(topics.ESTIMATE)) > 0
        )

    @property
    def silence(self) -> float:
        """Time since the last estimate was received or the last message sent [s]."""
        return time.monotonic() - self._heard

    def step(self, most: int = 200) -> int:
        """Send the messages allowed now, at most `most`; return how many were sent."""
        until = min(self._allowed(), self.sent + most)
        for place in range(self.sent, until):
            index = int(self._index[place])
            if self._is_pulse[place]:
                self._pulses.publish(self._pulse_bytes.message(index))
            else:
                self._force.publish(self._force_bytes.message(index))
        went = until - self.sent
        if went:
            self._heard = time.monotonic()
        self.sent = until
        return went

    def _allowed(self) -> int:
        """Return how many messages may be sent by now."""
        if self._factor > 0.0:
            now = time.monotonic()
            self._started = now if self._started is None else self._started
            elapsed = (now - self._started) * self._factor * NANOSECONDS_PER_SECOND
            return int(np.searchsorted(self._due_ns, elapsed, side='right'))
        if self.silence > PATIENCE:
            self._used = self.sent
        return min(len(self), self._used + WINDOW)

    def _on_estimate(self, message: MuscleEstimate) -> None:
        estimate = estimate_messages.estimate_of(message)
        self.estimates.append(estimate)
        self._heard = time.monotonic()
        used = int(np.searchsorted(self._force_stamp_ns, estimate.stamp_ns, side='right'))
        if used:
            self._used = max(self._used, int(self._sent_with_force[used - 1]))


def _order(recording: Recording) -> tuple[BoolArray, IntArray, IntArray]:
    """Return kind, index and time after the first [ns] of all messages (messages,), as received.

    After the clock was set back, messages are due at the time of those before them.
    """
    counts = len(recording.pulses), len(recording.forces)
    is_pulse = np.repeat([True, False], counts)
    index = np.concatenate([np.arange(count, dtype=np.int64) for count in counts])
    samples_before = np.concatenate([recording.samples_before_pulse, index[counts[0] :]])
    order = np.lexsort((~is_pulse, samples_before))
    received = np.concatenate([recording.pulse_received_ns, recording.force_received_ns])[order]
    return is_pulse[order], index[order], np.maximum.accumulate(received) - received[0]


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
    factor: float = 0.0,
    progress: Callable[[int], object] = lambda _: None,
) -> Replay:
    """Play a recording through an identifier.

    Parameters
    ----------
    recording : Recording
        The recording.
    parameters : dict, optional
        Parameters of the identifier by name; axis and quantity are ignored.
    factor : float
        Seconds of the recording in one second; 0 for as fast as possible.
    progress : callable
        Called with the number of messages sent since the last call.

    Raises
    ------
    NodeError
        If a parameter or the factor is not valid or the nodes do not find each other.
    """
    if not (np.isfinite(factor) and factor >= 0.0):
        raise NodeError(f'expected a factor of 0 or above, got {factor}')
    chosen = {**(parameters or {}), 'axis': 'z', 'quantity': recording.quantity}
    try:
        expected = _expected(recording, IdentifierParameters(**chosen))
    except TypeError as error:
        raise NodeError(f'expected parameters of the identifier, got {error}') from error
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    use_fast_discovery()
    context = Context()
    with free_domain() as domain:
        rclpy.init(
            args=[],
            context=context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            return _play(context, recording, chosen, factor, expected, progress)
        finally:
            context.try_shutdown()


def _play(
    context: Context,
    recording: Recording,
    parameters: dict[str, Any],
    factor: float,
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
        replayer = Replayer(recording, factor, **options)
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
