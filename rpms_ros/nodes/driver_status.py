# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages that a stimulator driver sends about itself."""

from array import array
from dataclasses import dataclass
from typing import Any

from rpms_msgs.msg import DriverStatus
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.stimulation.authority import Authority
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.dose_ledger import MemoryLedger
from rpms_ros.stimulation.stop_buttons import StopButtons


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
