# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a stimulator driver tells: pulses, log, refusals, schedules, status, diagnostics, audit.

Arming and schedules are on the disk before anything follows from them.  Refusals, stops and
resets before them are written with them, or by a thread of their own, so that nobody can hold
the executor up with goals that are refused; of too many at once some are counted only.
"""

import hashlib
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from rpms_msgs.msg import AcceptedSchedule, DriverStatus, Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.errors import StimulationError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import DiagnosticsPublisher, Health, logger_of, plain_text
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.printable import counted
from rpms_ros.pulses import Pulse, PulseHash
from rpms_ros.stimulation import Schedule, schedule_to_text
from rpms_ros.stimulation.devices import registry
from rpms_ros.stimulation.driver.authority import Authority
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.states import Fired, State
from rpms_ros.stimulation.driver.stop_buttons import StopButtons
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, ChainedFile

UNVERIFIED = {
    name: getattr(PulseMessage, f'UNVERIFIED_{name.upper()}') for name in registry.UNVERIFIED
}
"""Bit in a message for each thing that a device may be unable to confirm."""

_FRAME = 'coil'


class PulsePublisher:
    """Publishes the pulses of one driver; called by the thread that fires them.

    Not a life-cycle publisher: a pulse that was given is reported whatever the state.

    Parameters
    ----------
    node : Node
        The driver's.

    Attributes
    ----------
    hash : PulseHash
        Of what was published as given.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.hash = PulseHash()
        self._given = node.create_publisher(PulseMessage, topics.PULSES, qos.PULSES)
        self._asked = node.create_publisher(PulseMessage, topics.PULSES_COMMANDED, qos.PULSES)

    @property
    def listeners(self) -> int:
        """How many subscribe to the pulses."""
        return int(self._given.get_subscription_count())

    def publish(self, fired: Fired) -> None:
        """Publish one trigger that was sent to the device, answered or not."""
        if not self._node.context.ok():
            # the process is about to end, and nobody can be told any more
            return
        offset_ns = clock_offset_ns()
        asked = Pulse(fired.due_ns + offset_ns, fired.intensity, fired.sequence, fired.width_s)
        self._asked.publish(self._message(asked))
        if fired.delivery is not None:
            # one that was not answered may have been given: nothing of it is confirmed
            unverified = sum(UNVERIFIED[name] for name in fired.delivery.unverified)
            given = Pulse(
                fired.delivery.time_ns + offset_ns,
                fired.delivery.intensity,
                fired.delivered_sequence,
                fired.width_s,
                unverified,
            )
            self._given.publish(self._message(given))
            self.hash.add(given)

    def _message(self, pulse: Pulse) -> PulseMessage:
        return messages.pulse_message(pulse, MESSAGE_TYPES, _FRAME)


def clock_offset_ns() -> int:
    """Return the system's clock minus the monotonic clock [ns].

    The thread may be held up between the two readings; the tightest of a few counts.
    """
    readings = []
    for _ in range(5):
        before, now = time.monotonic_ns(), time.time_ns()
        width = time.monotonic_ns() - before
        readings.append((width, now - before - width // 2))
    return min(readings)[1]


SIMULATED = 'simulated'


_FIGURES = (
    'device', 'pulses_delivered', 'pulses_dropped', 'lateness_mean', 'lateness_max',
    'coil_energy', 'coil_temperature',
)  # fmt: skip


def driver_health(status: DriverStatus, state: State, doubtful: bool) -> Health:
    """Return how a driver is: error in the fault state, a warning where it is doubtful."""
    level = DiagnosticStatus.WARN if doubtful else DiagnosticStatus.OK
    if state is State.FAULT:
        level = DiagnosticStatus.ERROR
    figures = {name.replace('_', ' '): getattr(status, name) for name in _FIGURES}
    faults = zip(status.fault_names, status.fault_counts, strict=True)
    counts = {f'fault {fault}': count for fault, count in faults}
    return Health(status.reason, level, {'state': state.name, **figures, **counts})


_WAITING = 100
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
        self._log = ChainedFile(Path(path).expanduser(), AUDIT_LOG) if path else None
        self._failed = failed
        self._broken, self._left_out, self._closing = '', 0, False
        self._noted: deque[Entry] = deque(maxlen=_WAITING)
        self._more, self._order = threading.Event(), threading.Lock()
        self._thread = threading.Thread(
            target=self._run, args=(self._log,), name='audit', daemon=True
        )
        if self._log is not None:
            self._thread.start()

    def require(self, kind: str, **fields: object) -> None:
        """Write an entry, and what was noted before it, before this returns.

        Raises
        ------
        StimulationError
            If it cannot be written.
        """
        if self._log is not None:
            self._write(self._log, (kind, fields))

    def note(self, kind: str, **fields: object) -> None:
        """Have an entry written soon."""
        if self._log is None:
            return
        # of too many the oldest ones are left out
        if len(self._noted) == _WAITING:
            self._left_out += 1
        self._noted.append((kind, fields))
        self._more.set()

    def close(self) -> None:
        """Write what is left, and close the file."""
        if self._log is not None:
            self._closing = True
            self._more.set()
            self._thread.join(_JOIN_S)
            self._log.close()

    def _run(self, log: ChainedFile) -> None:
        """Write what comes, and look at the file while nothing does."""
        try:
            while self._noted or not self._closing:
                self._more.wait(_LOOK_S)
                self._more.clear()
                self._write(log)
        except StimulationError:
            self._failed(self._broken)

    def _write(self, log: ChainedFile, *required: Entry) -> None:
        """Write what was noted, then what is required; all of it is on the disk after that.

        If an entry cannot be written no other one is: those behind it would be lost unseen.
        """
        with self._order:
            if self._broken:
                raise StimulationError(self._broken)
            entries = [*(self._noted.popleft() for _ in range(len(self._noted))), *required]
            try:
                for left, (kind, fields) in zip(range(len(entries))[::-1], entries, strict=True):
                    left_out, self._left_out = self._left_out, 0
                    both = {**fields, **({'left_out': left_out} if left_out else {})}
                    log.append(kind, both, sync=not left)
                if not entries:
                    log.look()
            except StimulationError as error:
                self._broken = f'expected an audit log that can be written, got {error}'
                raise


_DIAGNOSTICS_PERIOD_NS = 1_000_000_000
# how long a refusal is shown in the status, and a pulse that was dropped in the diagnostics
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
    controller, buttons, authority
        What a status is made of.
    device : str
        Kind of device, and its port; in diagnostics a simulated one is known by its node.

    Attributes
    ----------
    refusal : str
        Reason of the newest refusal, empty when it is no longer shown.
    """

    def __init__(
        self,
        node: Node,
        audit: DriverAudit,
        controller: StimulationController,
        buttons: StopButtons,
        authority: Authority,
        device: str,
    ) -> None:
        self._node = node
        self._controller, self._buttons = controller, buttons
        self._authority, self._device = authority, device
        accepted = topics.ACCEPTED_SCHEDULE, qos.ACCEPTED_SCHEDULE
        self._accepted = node.create_publisher(AcceptedSchedule, *accepted)
        self._audit = audit
        self._status = node.create_publisher(DriverStatus, topics.DRIVER_STATUS, qos.STATUS)
        hardware = f'{device} {node.get_fully_qualified_name()}' if device == SIMULATED else device
        self._diagnostics = DiagnosticsPublisher(node, 'stimulator', hardware)
        # pulses so far, and when the newest was
        self._dropped, self._dropped_ns = 0, -_SHOWN_NS
        self.refusal, self._refused_ns = '', 0
        # when what was expected was refused last, of the last second
        self._repeated: dict[str, int] = {}
        self._next_diagnostics_ns = 0
        self._said: tuple[Any, ...] = ()

    def say(self, line: str) -> None:
        """Write a line into the log of ROS."""
        logger_of(self._node).info(plain_text(line))

    def refuse(self, reason: str) -> None:
        """Tell why something was refused; what is repeated at once is shown and not logged.

        Of what was expected: what came, such as the age of a sample, may differ each time.
        """
        said, now_ns = plain_text(reason), time.monotonic_ns()
        expected = said.partition(', got ')[0]
        last = {one: ns for one, ns in self._repeated.items() if now_ns - ns < _REPEATED_NS}
        self.refusal, self._refused_ns, self._repeated = said, now_ns, {**last, expected: now_ns}
        if expected not in last:
            logger_of(self._node).warning(f'refused: {said}')
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
        both = {'name': name, 'pulses': pulses}
        log = {'operator': operator_id, 'text': plain_text(text), 'text_sha256': sha256}
        self._audit.require('schedule', **both, **log)
        message = AcceptedSchedule(schedule=text, sha256=sha256, operator_id=operator_id, **both)
        message.header = messages.header_message(time.time_ns(), _FRAME, MESSAGE_TYPES)
        message.duration = float(schedule.length_s)
        self._accepted.publish(message)
        self.say(f'running {name}, {counted(pulses, "pulse")}')

    def publish(self, stamp: Any, now_ns: int) -> None:
        """Publish the status, and diagnostics once a second and when something changed.

        Parameters
        ----------
        stamp : builtin_interfaces.msg.Time
            Now.
        now_ns : int
            The same moment on the monotonic clock [ns].
        """
        if now_ns - self._refused_ns > _SHOWN_NS:
            self.refusal = ''
        state, latched, reason = self._controller.status()
        note = f'; refused: {self.refusal}' if self.refusal else ''
        said = state, latched, reason + note
        before, self._said = self._said, said
        if state is State.FAULT and before[:1] != said[:1]:
            logger_of(self._node).error(f'fault: {plain_text(reason)}')
        status = self._status_message(stamp, now_ns, *said)
        self._status.publish(status)
        if said != before or now_ns >= self._next_diagnostics_ns:
            self._next_diagnostics_ns = now_ns + _DIAGNOSTICS_PERIOD_NS
            if self._dropped != self._controller.dropped:
                self._dropped, self._dropped_ns = self._controller.dropped, now_ns
            doubtful = latched or bool(note) or now_ns - self._dropped_ns < _SHOWN_NS
            self._diagnostics.publish(driver_health(status, state, doubtful))

    def _status_message(
        self, stamp: Any, now_ns: int, state: State, latched: bool, reason: str
    ) -> DriverStatus:
        controller = self._controller
        faults, totals = controller.fault_counts(), controller.ledger.totals()
        states = self._buttons.states(now_ns)
        message = DriverStatus(
            state=DriverStatus.STOPPED if latched else int(state.value),
            reason=plain_text(reason),
            pulses_commanded=int(controller.commanded),
            pulses_delivered=int(controller.delivered),
            pulses_dropped=int(controller.dropped),
            pulses_unverified=int(controller.unverified),
            coil_energy=float(controller.limiter.session_energy_j),
            coil_temperature=float(controller.coil_temperature),
            lateness_mean=float(controller.lateness.mean_s),
            lateness_max=float(controller.lateness.max_s),
            maximum_intensity=float(controller.limits.maximum_intensity),
            fault_names=list(faults),
            fault_counts=array('Q', list(faults.values())),
            dose_pulses=int(totals.pulses),
            dose_energy=float(totals.energy_j),
            device=self._device,
            operator_id=plain_text(self._authority.operator),
            enabled=bool(self._authority.enabled),
            button_names=[name for name, _ in states],
            button_states=array('B', [int(state) for _, state in states]),
        )
        message.header.stamp = stamp
        run = controller.run
        if run is not None and not run.ended:
            message.schedule = plain_text(run.schedule.name)
            message.segment, message.segments = int(run.segment), len(run.schedule.segments)
            message.time_left = float(run.time_left_s(now_ns))
        return message
