# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Patient files: what one patient may get from one kind of device, who said so, and until when.

identifier: P01
device: rapid2-240v
motor_threshold: 0.32
largest_comfortable: 0.55
dose: {pulses: 4000, energy_j: 200.0e+3, window_h: 24.0}
rest: {train_pulses: 1800, pause_s: 30.0}
set_by: A. Physician
set_on: 2026-11-02
expires: 2026-12-31
"""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.limiter import DoseLimits, Rest
from rpms_ros.stimulation.schedule.description import from_file
from rpms_ros.stimulation.schedule.fields import (
    LONGEST_NAME,
    Bound,
    Bounded,
    DescriptionError,
    as_mapping,
    bounded,
    build,
    read_text,
)
from rpms_ros.strict_yaml import shown

LONGEST_VALIDITY_DAYS = 366
_SHARE = Bound(0.0, 1.0, above=True)
_IDENTIFIER = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]*')


@dataclass(frozen=True)
class Patient(Bounded):
    """What one patient may get from one kind of device.

    Attributes
    ----------
    identifier : str
        A pseudonym, never a name: letters, digits, dot, dash and underscore.
    device : str
        Name of the device specification that the shares below were found with.
    motor_threshold : float
        Least intensity at which the muscle answers (share of the device's maximum).
    largest_comfortable : float
        Strongest intensity that the patient puts up with (share of the device's maximum).
    dose : DoseLimits
        Pulses and energy within a window.
    rest : Rest
        After how many pulses a silence is due, and how long.
    set_by : str
        Who is answerable for these figures.
    set_on, expires : date
        First and last day on which they hold (UTC).
    """

    identifier: str
    device: str
    motor_threshold: float = bounded(_SHARE)
    largest_comfortable: float = bounded(_SHARE)
    dose: DoseLimits = dataclasses.field(kw_only=True)
    rest: Rest = dataclasses.field(kw_only=True)
    set_by: str = dataclasses.field(kw_only=True)
    set_on: date = dataclasses.field(kw_only=True)
    expires: date = dataclasses.field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _IDENTIFIER.fullmatch(self.identifier) or len(self.identifier) > LONGEST_NAME:
            raise DescriptionError(
                'identifier',
                f'expected a pseudonym of at most {LONGEST_NAME} letters, digits, dots, dashes '
                f'and underscores, got {shown(self.identifier)}',
            )
        if not self.motor_threshold <= self.largest_comfortable:
            raise DescriptionError(
                'largest_comfortable',
                f'expected at least the motor threshold {self.motor_threshold:g}, '
                f'got {self.largest_comfortable:g}',
            )
        if not 0 <= (self.expires - self.set_on).days <= LONGEST_VALIDITY_DAYS:
            raise DescriptionError(
                'expires',
                f'expected a day within {LONGEST_VALIDITY_DAYS} days after {self.set_on}, '
                f'got {self.expires}',
            )


def load_patient(path: Path) -> Patient:
    """Return the patient of a YAML file.

    Raises
    ------
    StimulationError
        If the file cannot be read or holds a fault; names file, line and place.
    """
    return from_file(path, 'patient file', patient_from_mapping)


def patient_from_mapping(content: object) -> Patient:
    """Return the patient that a mapping describes; nothing in it may be left out.

    Raises
    ------
    DescriptionError
        If something is missing, unknown or out of its bound; names the place.
    """
    document = as_mapping(content, '')
    named: dict[str, Any] = {
        name: read_text(document, name, '', LONGEST_NAME)
        for name in ('identifier', 'device', 'set_by')
    }
    named |= {name: _day(document, name) for name in ('set_on', 'expires')}
    dose = build(DoseLimits, document.get('dose'), 'dose')
    rest = build(Rest, document.get('rest'), 'rest')
    return build(Patient, document, '', dose=dose, rest=rest, **named)


def for_session(
    specification: DeviceSpecification, patient: Patient | None, today: date | None = None
) -> DeviceSpecification:
    """Return a device specification for one patient: of two limits the tighter one counts.

    The dose is not among them, because it counts what other devices gave as well: the dose ledger
    holds it.

    Parameters
    ----------
    specification : DeviceSpecification
        Of the device.
    patient : Patient or None
        Who is stimulated; None is for a simulated device only.
    today : date, optional
        In UTC; today, if it is missing.

    Raises
    ------
    StimulationError
        If a real device has no patient, the figures were found with another kind of device, or
        today is not a day on which they hold.
    """
    if patient is None:
        if not specification.simulated_only:
            raise StimulationError(
                f'expected a patient file for the real device {specification.name!r}, got none'
            )
        return specification
    if patient.device != specification.name:
        raise StimulationError(
            f'patient {patient.identifier}: expected figures found with {specification.name!r}, '
            f'got those of {patient.device!r}'
        )
    today = today or datetime.now(UTC).date()
    if not patient.set_on <= today <= patient.expires:
        raise StimulationError(
            f'patient {patient.identifier}: expected a day from {patient.set_on} to '
            f'{patient.expires}, got {today}'
        )
    limits = specification.limits
    tighter = dataclasses.replace(
        limits,
        maximum_intensity=min(limits.maximum_intensity, patient.largest_comfortable),
        # shorter than between two trains, a pause might be the interval of two pulses
        rest=Rest(patient.rest.train_pulses, max(limits.minimum_pause_s, patient.rest.pause_s)),
    )
    return dataclasses.replace(specification, limits=tighter)


def _day(document: Mapping[str, object], key: str) -> date:
    """Return a day written as 2026-11-02."""
    value = document.get(key)
    try:
        if isinstance(value, str) and re.fullmatch(r'\d{4}-\d\d-\d\d', value, re.ASCII):
            return date.fromisoformat(value)
    except ValueError:
        pass
    raise DescriptionError(key, f'expected a day such as 2026-11-02, got {shown(value)}')
