"""Messages that a stimulator driver sends about itself."""

from array import array
from typing import Any

from rpms_msgs.msg import DriverStatus
from rpms_ros.stimulation.controller import StimulationController


def status_message(
    controller: StimulationController, stamp: Any, now_ns: int, note: str
) -> DriverStatus:
    """Return the status at `stamp`; `now_ns` is the same moment on the controller's clock."""
    state, latched, reason = controller.status()
    message = DriverStatus()
    message.header.stamp = stamp
    message.state = DriverStatus.STOPPED if latched else int(state.value)
    message.reason = f'{reason}; {note}' if note else reason
    run = controller.run
    if run is not None and not run.ended:
        message.schedule = run.schedule.name
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
    faults = controller.fault_counts()
    message.fault_names = list(faults)
    message.fault_counts = array('Q', list(faults.values()))
    return message
