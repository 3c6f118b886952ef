# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the stimulator driver, and what is built from them."""

import dataclasses
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rpms_ros.axis import UNITS
from rpms_ros.errors import NodeError, StimulationError
from rpms_ros.nodes.common.parameters import NodeParameters, parameter, sensed
from rpms_ros.stimulation.devices import registry
from rpms_ros.stimulation.devices.registry import Device, DeviceOptions, require_device
from rpms_ros.stimulation.driver.states import DriverSettings
from rpms_ros.stimulation.limits.device_specification import (
    DeviceSpecification,
    load_device_specification,
)
from rpms_ros.stimulation.limits.patient import Patient, for_session, load_patient
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger

# nobody is stimulated, and a busy computer lets a thread wait for longer than is safe elsewhere
_SIMULATED_PATIENCE_S = 2.0
_SILENCE = {'unit': 's', 'bounds': (0.01, 10.0)}
_NODE_NAME = re.compile(r'(/\w+)+|\w+', re.ASCII)


@dataclass(frozen=True)
class DriverParameters(NodeParameters):
    """Parameters of the stimulator driver."""

    device: str = parameter('simulated', 'Kind of device, by the name it is registered under.')
    port: str = parameter('/dev/ttyUSB0', 'Serial port of a device on one.')
    device_specification: str = parameter('simulated', 'Limits of the device: name or YAML file.')
    maximum_intensity: float = parameter(
        1.0, 'Hard bound; never raised while armed.', bounds=(0.0, 1.0), dynamic=True
    )
    maximum_rate: float = parameter(
        50.0, 'Hard bound on the repetition rate.', unit='Hz', bounds=(0.1, 1000.0)
    )
    lateness_limit: float = parameter(
        0.01, 'A pulse later than this is dropped.', unit='s', bounds=(1e-4, 0.1)
    )
    require_stop_button: bool = parameter(
        True, 'Ask for a stop button that speaks; false is for a simulated device only.'
    )
    stop_button_timeout: float = parameter(0.3, 'Longest silence of a stop button.', **_SILENCE)
    stop_buttons: tuple[str, ...] = parameter(
        (), 'Nodes of the stop buttons that must be there: full names or their last parts.'
    )
    require_operator: bool = parameter(
        True, 'Ask for two steps to arm and a held enable; false is for a simulated device only.'
    )
    heartbeat_timeout: float = parameter(0.3, 'Longest silence of the operator.', **_SILENCE)
    force_limit: float = parameter(
        0.0, 'Stop above this force; 0 does not listen.', unit='N', bounds=(0.0, 1e5)
    )
    force_timeout: float = parameter(0.2, 'Longest silence of a limited force.', **_SILENCE)
    force_frame: str = parameter('force_sensor', 'Frame of the force that is limited.')
    quantity: str = sensed('What is measured, and limited: a force, or a torque in N m.')
    temperature_limit: float = parameter(
        40.0, 'Stop above this coil temperature.', unit='Celsius', bounds=(0.0, 100.0)
    )
    patient_file: str = parameter('', 'YAML file of the patient; a real device needs one.')
    ledger_folder: str = parameter('', 'Absolute folder of the ledgers; a real device needs one.')
    audit_log: str = parameter('', 'File of the audit log; a real device needs one.')
    autostart: bool = parameter(False, 'Arm and run schedule_file; simulated device only.')
    minimum_subscribers: int = parameter(
        1, 'Subscribers of the pulses that autostart waits for.', bounds=(0, 100)
    )
    schedule_file: str = parameter('', 'YAML file of the schedule of an automatic start.')

    def __post_init__(self) -> None:
        super().__post_init__()
        require_device(self.device)
        if not self.simulated:
            self._require_safeguards()
        # from another directory a relative one would be another, without the doses so far
        folder = self.ledger_folder
        if folder and not Path(folder).expanduser().is_absolute():
            raise NodeError(f'expected ledger_folder with an absolute path, got {folder}')
        for name in self.stop_buttons:
            if not _NODE_NAME.fullmatch(name):
                raise NodeError(
                    "expected stop_buttons with a node's full name or its last part, such as "
                    f'/left/foot_switch or foot_switch, got {name!r}'
                )
        if self.autostart and not self.schedule_file:
            raise NodeError('expected schedule_file with autostart, got none')

    def _require_safeguards(self) -> None:
        """Raise NodeError if something that a real device needs is switched off."""
        files = 'audit_log', 'ledger_folder', 'patient_file'
        for name in ('require_operator', 'require_stop_button', *files):
            if not getattr(self, name):
                got = 'none' if name in files else 'false'
                raise NodeError(f'expected {name} with a real device, got {got}')
        if self.autostart:
            raise NodeError('expected no autostart with a real device, got true')

    @property
    def simulated(self) -> bool:
        """Whether the device exists only as a program."""
        return self.device == 'simulated'


def build_device(settings: DriverParameters, specification: DeviceSpecification) -> Device:
    """Return the device that the parameters name, not open yet.

    Parameters
    ----------
    settings : DriverParameters
        Kind of device and port.
    specification : DeviceSpecification
        That of the session: no intensity above its bound is asked of the
        device, and the device is told of that bound.

    Raises
    ------
    StimulationError
        If there is no such device or it cannot be built.
    """
    options = DeviceOptions(settings.port, specification.limits.maximum_intensity)
    return registry.build_device(settings.device, options)


class Session(NamedTuple):
    """Device and patient as their files say.

    Attributes
    ----------
    settings : DriverParameters
        Of the start: which files, and bounds beside them.
    specification : DeviceSpecification
        Its limits tightened by patient and parameters.
    patient : Patient or None
        Whose dose is counted; None where nobody is named.
    """

    settings: DriverParameters
    specification: DeviceSpecification
    patient: Patient | None

    def require_unchanged(self) -> None:
        """Read the files again: meanwhile the figures of a patient expire, or are set again.

        Raises
        ------
        StimulationError
            If they cannot be used today, or anything in them is another than at the start:
            limits, dose and ledger of a driver are those of its start.
        """
        if session_of(self.settings) != self:
            whose = self.settings.patient_file or 'nobody'
            raise StimulationError(
                f'expected the figures of {whose} and of the device specification as they were at '
                'the start, got others: start the driver again'
            )


def session_of(settings: DriverParameters) -> Session:
    """Return device and patient, the limits of the device tightened by patient and parameters.

    Raises
    ------
    StimulationError
        If there is no such device specification or patient, or the two do not go together today.
    """
    file = settings.patient_file
    patient = load_patient(Path(file).expanduser()) if file else None
    specification = for_session(load_device_specification(settings.device_specification), patient)
    limits = dataclasses.replace(
        specification.limits,
        maximum_intensity=min(specification.limits.maximum_intensity, settings.maximum_intensity),
        maximum_rate_hz=min(specification.limits.maximum_rate_hz, settings.maximum_rate),
    )
    return Session(settings, dataclasses.replace(specification, limits=limits), patient)


def ledger_of(settings: DriverParameters, session: Session) -> MemoryLedger:
    """Return where the dose is kept, open: in files where a folder and a patient are named.

    Raises
    ------
    StimulationError
        If the ledger is open elsewhere, damaged, or cannot be written, or if a real device has no
        serial number: by the name of a port it would be another one at each.
    """
    specification, patient = session.specification, session.patient
    if patient is None or not settings.ledger_folder:
        return MemoryLedger(None if patient is None else patient.dose)
    folder = Path(settings.ledger_folder).expanduser()
    device = settings.device if settings.simulated else specification.serial_number
    if not device:
        fault = 'expected serial_number in the device specification of a real device'
        own = 'state it in a file of your own'
        raise StimulationError(f'{fault}, got none in {specification.name!r}: {own}')
    return DoseLedger(folder, device, patient.identifier, patient.dose)


def patience_s(settings: DriverParameters, limit_s: float) -> float:
    """Return how long a thread of the driver may be silent [s], a limit unless simulated."""
    return max(limit_s, _SIMULATED_PATIENCE_S) if settings.simulated else limit_s


def driver_settings_of(settings: DriverParameters) -> DriverSettings:
    """Return how the driver watches over itself."""
    own = 'executor_timeout_s', 'response_limit_s', 'stuck_limit_s', 'supervisor_timeout_s'
    return DriverSettings(
        **{name: patience_s(settings, getattr(DriverSettings, name)) for name in own},
        lateness_limit_s=settings.lateness_limit,
        force_limit_n=settings.force_limit,
        force_unit=UNITS[settings.quantity],
        force_timeout_s=settings.force_timeout,
        temperature_limit=settings.temperature_limit,
    )
