# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver publishes of a pulse: what was asked for, and what the device did.

Real-time priority, so that pulses come in time on a machine that is busy.
"""

import os
import time
from pathlib import Path

from rclpy.node import Node

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.interfaces import MESSAGE_TYPES
from rpms_ros.pulses import Pulse, PulseHash
from rpms_ros.stimulation.devices import Delivery
from rpms_ros.stimulation.driver.pulse_owner import Fired

UNVERIFIED = {
    'delivery': PulseMessage.UNVERIFIED_DELIVERY,
    'intensity': PulseMessage.UNVERIFIED_INTENSITY,
    'coil': PulseMessage.UNVERIFIED_COIL,
    'ready': PulseMessage.UNVERIFIED_READY,
    'error': PulseMessage.UNVERIFIED_ERROR,
}
"""Bit in a message for each thing that a device may be unable to confirm."""

_CLOCK_READINGS = 5
_TIGHT_NS = 50_000
_LONG_NS = 10**18


class PulsePublisher:
    """Publishes the pulses of one driver; called by the thread that fires them.

    Not a life-cycle publisher: a pulse that was given is reported whatever the state.

    Parameters
    ----------
    node : Node
        The driver's.
    frame_id : str
        Frame of the pulses.

    Attributes
    ----------
    hash : PulseHash
        Of what was published as given.
    """

    def __init__(self, node: Node, frame_id: str) -> None:
        self._node = node
        self._frame_id = frame_id
        self.hash = PulseHash()
        self._given = node.create_publisher(PulseMessage, topics.PULSES, qos.PULSES)
        self._asked = node.create_publisher(PulseMessage, topics.PULSES_COMMANDED, qos.PULSES)

    @property
    def listeners(self) -> int:
        """How many subscribe to the pulses."""
        return int(self._given.get_subscription_count())

    def for_the_log(self) -> dict[str, object]:
        """Return number, first stamp and hash of the pulses since the last call, if any."""
        given = self.hash.taken()
        if given is None:
            return {}
        return {
            'pulses': given.count,
            'first_pulse_ns': given.first_ns,
            'pulses_sha256': given.sha256,
        }

    def publish(self, fired: Fired) -> None:
        """Publish one trigger that was sent to the device, answered or not."""
        if not self._node.context.ok():
            # the process is about to end, and nobody can be told any more
            return
        offset_ns = clock_offset_ns()
        asked = Pulse(fired.due_ns + offset_ns, fired.intensity, fired.sequence, fired.width_s)
        self._asked.publish(self._message(asked))
        if fired.delivery is not None:
            given = given_pulse(fired, fired.delivery, offset_ns)
            self._given.publish(self._message(given))
            self.hash.add(given)

    def _message(self, pulse: Pulse) -> PulseMessage:
        return messages.pulse_message(pulse, MESSAGE_TYPES, self._frame_id)


def given_pulse(fired: Fired, delivery: Delivery, offset_ns: int) -> Pulse:
    """Return a trigger as a pulse, with what the device did not confirm.

    One that was not answered may have been given: it is a pulse of which nothing is confirmed.
    """
    return Pulse(
        delivery.time_ns + offset_ns,
        delivery.intensity,
        fired.delivered_sequence,
        fired.width_s,
        sum(UNVERIFIED[name] for name in delivery.unverified),
    )


def clock_offset_ns() -> int:
    """Return the system's clock minus the monotonic clock [ns].

    The thread may be held up between the two readings; the tightest of a few counts.
    """
    best_width, best_offset = _LONG_NS, 0
    for _ in range(_CLOCK_READINGS):
        before = time.monotonic_ns()
        now = time.time_ns()
        width = time.monotonic_ns() - before
        if width < best_width:
            best_width, best_offset = width, now - before - width // 2
        if width < _TIGHT_NS:
            break
    return best_offset


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
