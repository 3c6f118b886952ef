# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stimulator driver tells: lines in its log, refusals, schedules, status, diagnostics.

Messages that a stimulator driver sends about itself.

Diagnostics of a stimulator driver: one status with a level, and its figures.

The audit log of a driver: what a train depends on is written first, the rest beside it.

Arming and schedules are on the disk before anything follows from them.  Refusals, stops and
resets are written by a thread of their own, so that nobody can hold the executor up with goals
that are refused; of too many at once some are counted only.
"""

import hashlib
import queue
import threading
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from rpms_msgs.msg import AcceptedSchedule, DriverStatus
from rpms_ros import messages
from rpms_ros.errors import StimulationError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import Health, RecentChange, diagnostics_message
from rpms_ros.nodes.common.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.common.logger import logger_of, plain_text
from rpms_ros.printable import counted
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation import Schedule, schedule_to_text
from rpms_ros.stimulation.driver.authority import Authority
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.states import State
from rpms_ros.stimulation.driver.stop_buttons import StopButtons
from rpms_ros.stimulation.records.audit_log import AuditLog
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger


@dataclass(frozen=True)
class DriverView:
    """What a status is made of.

    Attributes
    ----------
    controller : StimulationController
        What decides.
    buttons : StopButtons
        The stop buttons.
    authority : Authority
        The operator.
    ledger : MemoryLedger
        What the patient got.
    device : str
        Kind of device, and its port.
    """

    controller: StimulationController
    buttons: StopButtons
    authority: Authority
    ledger: MemoryLedger
    device: str

    def status(self, stamp: Any, now_ns: int, note: str) -> DriverStatus:
        """Return the status at `stamp`; `now_ns` is the same moment on the monotonic clock."""
        controller = self.controller
        state, latched, reason = controller.status()
        message = DriverStatus()
        message.header.stamp = stamp
        message.state = DriverStatus.STOPPED if latched else int(state.value)
        message.reason = plain_text(f'{reason}; {note}' if note else reason)
        run = controller.run
        if run is not None and not run.ended:
            message.schedule = plain_text(run.schedule.name)
            message.segment = int(run.segment)
            message.segments = len(run.schedule.segments)
            message.time_left = float(run.time_left_s(now_ns))
        message.pulses_commanded = int(controller.commanded)
        message.pulses_delivered = int(controller.delivered)
        message.pulses_dropped = int(controller.dropped)
        message.coil_energy = float(controller.limiter.session_energy_j)
        message.coil_temperature = float(controller.coil_temperature)
        message.lateness_mean = float(controller.lateness.mean_s)
        message.lateness_max = float(controller.lateness.max_s)
        message.pulses_unverified = int(controller.unverified)
        message.maximum_intensity = float(controller.limits.maximum_intensity)
        faults = controller.fault_counts()
        message.fault_names = list(faults)
        message.fault_counts = array('Q', list(faults.values()))
        self._add_people(message, now_ns)
        return message

    def _add_people(self, message: DriverStatus, now_ns: int) -> None:
        """Say who has armed, what every button says, and what the patient got."""
        totals = self.ledger.totals()
        message.dose_pulses, message.dose_energy = int(totals.pulses), float(totals.energy_j)
        message.device = self.device
        message.operator_id = plain_text(self.authority.operator)
        message.enabled = bool(self.authority.enabled)
        states = self.buttons.states(now_ns)
        message.button_names = [name for name, _ in states]
        message.button_states = array('B', [int(state) for _, state in states])


SIMULATED = 'simulated'


class DriverDiagnostics:
    """Makes the diagnostics of one driver.

    Parameters
    ----------
    controller : StimulationController
        What decides.
    name : str
        Name of the node with its namespace: two drivers of one graph differ in it.
    hardware : str
        Kind of device, and its port; a simulated one is known by its node.
    """

    def __init__(self, controller: StimulationController, name: str, hardware: str) -> None:
        self._controller = controller
        self._name = name
        self._hardware = f'{hardware} {name}' if hardware == SIMULATED else hardware
        self._dropped = RecentChange()

    def message(self, stamp: Any, note: str, now_ns: int | None = None) -> DiagnosticArray:
        """Return the diagnostics at `stamp`.

        Error in the fault state, a warning while a stop is latched or `note` says something, and
        for ten seconds after a pulse was dropped, ok otherwise.
        """
        state, latched, reason = self._controller.status()
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        recent = self._dropped.seen(self._controller.dropped, now_ns)
        level = DiagnosticStatus.WARN if latched or note or recent else DiagnosticStatus.OK
        if state is State.FAULT:
            level = DiagnosticStatus.ERROR
        said = f'{reason}; {note}' if note else reason
        health = Health(said, level, self._figures())
        return diagnostics_message(f'{self._name}: stimulator', self._hardware, stamp, health)

    def _figures(self) -> dict[str, object]:
        controller = self._controller
        state, latched, _ = controller.status()
        return {
            'state': 'STOPPED' if latched else state.name,
            'device specification': controller.specification.name,
            'pulses delivered': controller.delivered,
            'pulses dropped': controller.dropped,
            'lateness mean [s]': f'{controller.lateness.mean_s:.6f}',
            'lateness max [s]': f'{controller.lateness.max_s:.6f}',
            'energy [J]': f'{controller.limiter.session_energy_j:.1f}',
            'coil temperature [Celsius]': f'{controller.coil_temperature:.1f}',
            **{f'fault {fault}': count for fault, count in controller.fault_counts().items()},
        }


_WAITING = 500
_JOIN_S = 5.0
# how often the file is looked at while there is nothing to write
_LOOK_S = 0.2

Entry = tuple[str, dict[str, object]]


class DriverAudit:
    """Writes for one driver; does nothing where no file is named.

    Parameters
    ----------
    path : str
        Of the log; empty for none.
    failed : callable
        Told once why the log cannot be written any more.

    Raises
    ------
    StimulationError
        If the log cannot be opened.
    """

    def __init__(self, path: str, failed: Callable[[str], None]) -> None:
        self._log = AuditLog(Path(path).expanduser()) if path else None
        self._failed = failed
        self._lock = threading.Lock()
        self._broken = ''
        self._left_out = 0
        self._entries: queue.Queue[Entry | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._run, name='audit', daemon=True)
        if self._log is not None:
            self._thread.start()

    def require(self, kind: str, **fields: object) -> None:
        """Write an entry before this returns.

        Raises
        ------
        StimulationError
            If it cannot be written.
        """
        if self._broken:
            raise StimulationError(self._broken)
        self._append(kind, fields)

    def note(self, kind: str, **fields: object) -> None:
        """Have an entry written soon."""
        if self._log is None:
            return
        try:
            self._entries.put_nowait((kind, fields))
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Write what is left, and close the file."""
        if self._log is None:
            return
        if self._thread.is_alive():
            self._entries.put(None)
            self._thread.join(_JOIN_S)
        self._log.close()

    def _run(self) -> None:
        try:
            while self._step():
                pass
        except StimulationError as error:
            self._broken = f'expected an audit log that can be written, got {error}'
            self._failed(self._broken)

    def _step(self) -> bool:
        """Write what comes next, or look at the file; return whether there is more to come."""
        try:
            entry = self._entries.get(timeout=_LOOK_S)
        except queue.Empty:
            if self._log is not None:
                self._log.look()
            return True
        if entry is not None:
            kind, fields = entry
            left_out, self._left_out = self._left_out, 0
            self._append(kind, {**fields, **({'left_out': left_out} if left_out else {})})
        return entry is not None

    def _append(self, kind: str, fields: dict[str, object]) -> None:
        if self._log is not None:
            with self._lock:
                self._log.append(kind, **fields)


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

    def announce(self, schedule: Schedule, operator: str) -> None:
        """Log and publish a schedule before its first pulse.

        Raises
        ------
        StimulationError
            If the audit log cannot be written.
        """
        name, operator_id = plain_text(schedule.name), plain_text(operator)
        pulses, text = int(schedule.pulse_count), schedule_to_text(schedule)
        # as `sha256sum` of its file
        sha256 = hashlib.sha256(text.encode('utf-8', 'replace')).hexdigest()
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
