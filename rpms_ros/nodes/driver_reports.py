# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stimulator driver tells: lines in its log, refusals, schedules, status, diagnostics."""

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from rpms_msgs.msg import AcceptedSchedule
from rpms_msgs.msg import DriverStatus
from rpms_ros import messages
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.driver_audit import DriverAudit
from rpms_ros.nodes.driver_diagnostics import DriverDiagnostics
from rpms_ros.nodes.driver_status import DriverView
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.printable import counted
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation.description import text_hash
from rpms_ros.stimulation.states import State

_DIAGNOSTICS_PERIOD_S = 1.0
_REFUSED = 'refused: '
# how long a refusal is shown in the status
_SHOWN_NS = 10_000_000_000
# a heartbeat that is refused comes fifty times a second
_REPEATED_NS = 1_000_000_000


class DriverReports:
    """Tells of one driver.

    Parameters
    ----------
    node : Node
        The driver's.
    audit : DriverAudit
        Refusals are written there.
    view : DriverView
        What a status is made of.
    device : str
        Kind of device, and its port.
    frame_id : str
        Frame of the pulses.
    """

    def __init__(
        self, node: Node, audit: DriverAudit, view: DriverView, device: str, frame_id: str
    ) -> None:
        self._node = node
        self._frame_id = frame_id
        self._accepted = node.create_publisher(
            AcceptedSchedule, topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE
        )
        self._audit = audit
        self._view = view
        self._status = node.create_publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
        self._diagnostics = node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, qos.STOP)
        self._health = DriverDiagnostics(view.controller, node.get_fully_qualified_name(), device)
        self._note, self._noted_ns = '', 0
        self._next_status_ns = self._next_diagnostics_ns = 0
        self._said: tuple[Any, ...] = ()

    @property
    def refusal(self) -> str:
        """Reason of the newest refusal, empty when it is no longer shown."""
        return self._note.removeprefix(_REFUSED)

    def say(self, line: str) -> None:
        """Write a line into the log of ROS."""
        logger_of(self._node).info(plain_text(line))

    def refuse(self, reason: str) -> None:
        """Tell why something was refused; what is repeated at once is shown and not logged."""
        said, now_ns = plain_text(reason), time.monotonic_ns()
        repeated = self._note == _REFUSED + said and now_ns - self._noted_ns < _REPEATED_NS
        self._note, self._noted_ns = _REFUSED + said, now_ns
        if not repeated:
            logger_of(self._node).warning(self._note)
            self._audit.note('refusal', reason=said)

    def announce(self, schedule: Schedule, text: str, operator: str) -> None:
        """Log and publish a schedule before its first pulse; `text` is what it came as.

        Raises
        ------
        StimulationError
            If the audit log cannot be written.
        """
        name, operator_id = plain_text(schedule.name), plain_text(operator)
        pulses, sha256 = int(schedule.pulse_count), text_hash(text)
        self._audit.require(
            'schedule',
            operator=operator_id,
            name=name,
            pulses=pulses,
            text=plain_text(text),
            text_sha256=sha256,
        )
        message = AcceptedSchedule(
            header=messages.header_message(time.time_ns(), self._frame_id, MESSAGE_TYPES),
            name=name,
            schedule=text,
            sha256=sha256,
            operator_id=operator_id,
            pulses=pulses,
            duration=float(schedule.length_s),
        )
        self._accepted.publish(message)
        self.say(f'running {name}, {counted(pulses, "pulse")}')

    def forget_refusal(self) -> None:
        """Show no refusal any more."""
        self._note = ''

    def publish(self, stamp: Any, now_ns: int, status_rate: float) -> None:
        """Publish status and diagnostics when it is time, and at once when something changed.

        Parameters
        ----------
        stamp : builtin_interfaces.msg.Time
            Now.
        now_ns : int
            The same moment on the monotonic clock [ns].
        status_rate : float
            How often the status is published at least [Hz].
        """
        if self._note and now_ns - self._noted_ns > _SHOWN_NS:
            self._note = ''
        said = (*self._view.controller.status(), self._note)
        before, self._said = self._said, said
        changed = said != before
        if said[0] is State.FAULT and before[:1] != said[:1]:
            logger_of(self._node).error(f'fault: {plain_text(said[2])}')
        due = now_ns >= self._next_status_ns
        if due:
            # from when it was due: a tick that comes a little early or late moves none after it
            following_ns = self._next_status_ns + nanoseconds(1.0 / status_rate)
            self._next_status_ns = max(following_ns, now_ns)
        if changed or due:
            self._status.publish(self._view.status(stamp, now_ns, self._note))
        if changed or now_ns >= self._next_diagnostics_ns:
            self._next_diagnostics_ns = now_ns + nanoseconds(_DIAGNOSTICS_PERIOD_S)
            self._diagnostics.publish(self._health.message(stamp, self._note))
