"""Messages that a stimulator driver sends about itself."""

from array import array
from typing import Any

from rpms_msgs.msg import DriverStatus
from rpms_ros.stimulation.core import StimulatorCore


def status_message(core: StimulatorCore, stamp: Any, now_ns: int, note: str) -> DriverStatus:
    """Return the status of `core` at `stamp`; `now_ns` is the same moment on its own clock."""
    state, latched, reason = core.status()
    message = DriverStatus()
    message.header.stamp = stamp
    message.state = DriverStatus.STOPPED if latched else int(state.value)
    message.reason = f'{reason}; {note}' if note else reason
    run = core.run
    if run is not None and not run.ended:
        message.schedule = run.schedule.name
        message.segment = int(run.segment)
        message.segments = len(run.schedule.segments)
        message.time_left = float(run.time_left_s(now_ns))
    message.pulses_commanded = int(core.commanded)
    message.pulses_delivered = int(core.delivered)
    message.pulses_dropped = int(core.dropped)
    message.coil_energy = float(core.gate.session_energy_j)
    message.coil_temperature = float(core.coil_temperature)
    message.lateness_mean = float(core.lateness.mean_s)
    message.lateness_max = float(core.lateness.max_s)
    faults = core.fault_counts()
    message.fault_names = list(faults)
    message.fault_counts = array('Q', list(faults.values()))
    return message
