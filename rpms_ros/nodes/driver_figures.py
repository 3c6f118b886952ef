# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of device and patient that a driver was started with, looked at again at every arming.

A driver may run for days: meanwhile the figures of a patient expire, or are set again.
"""

from rpms_ros.errors import StimulationError
from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.nodes.driver_parameters import device_specification_of
from rpms_ros.nodes.driver_parameters import patient_of


class SessionFigures:
    """The device specification for a patient, as it was at the start.

    Parameters
    ----------
    settings : DriverParameters
        Which files, and bounds beside them.

    Attributes
    ----------
    specification : DeviceSpecification
        Its limits tightened by patient and parameters.

    Raises
    ------
    StimulationError
        If there is no such device specification or patient, or the two do not go together today.
    """

    def __init__(self, settings: DriverParameters) -> None:
        self._settings = settings
        self._dose = _dose_of(settings)
        self.specification = device_specification_of(settings)

    def require_unchanged(self) -> None:
        """Read the files again.

        Raises
        ------
        StimulationError
            If they cannot be used today, or say something else than at the start: limits, dose
            and ledger of a driver are those of its start.
        """
        settings = self._settings
        read_again = (device_specification_of(settings), _dose_of(settings))
        if read_again != (self.specification, self._dose):
            raise StimulationError(
                f'expected the figures of {settings.patient_file or "nobody"} and of the device '
                'specification as they were at the start, got others: start the driver again'
            )


def _dose_of(settings: DriverParameters) -> object:
    """Return whose dose is counted, and what it may be; None for nobody."""
    patient = patient_of(settings)
    return None if patient is None else (patient.identifier, patient.dose)
