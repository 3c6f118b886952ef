# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fields of the rPMS reporting checklist, filled as far as the recording allows.

The checklist is the outcome of a Delphi study: Schneider, Zangrandi, Sollmann, Bonfert, Beaulieu
and the rPMS Consensus Group, Front. Neurol. 13:852848, 2022 (doi 10.3389/fneur.2022.852848).  It
has 35 items: 8 on the subject, 16 on the method, 11 on the stimulation protocol.  Named here are
those in the abstract and at the beginning of Table 2 of the publication, in our own words:
all 8 on the subject (those of the table on which at least three quarters agreed), 7 on the
method, 2 on the protocol.  For the others see the publication.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

from rpms_ros.errors import ReportError
from rpms_ros.report.session.dose import Dose

SOURCE = (
    'Schneider C, Zangrandi A, Sollmann N, Bonfert MV, Beaulieu LD, rPMS Consensus Group. '
    'Checklist on the Quality of the Repetitive Peripheral Magnetic Stimulation (rPMS) Methods '
    'in Research: An International Delphi Study. Front Neurol 13:852848, 2022. '
    'doi:10.3389/fneur.2022.852848'
)
ITEMS_OF_THE_CONSENSUS = {'subject': 8, 'method': 16, 'protocol': 11}
"""How many items each part of the published checklist has."""


@dataclass(frozen=True)
class ChecklistItem:
    """One item of the checklist with its value.

    Attributes
    ----------
    key : str
        Name of the item in the notes of a recording and in the option of the command.
    part : str
        ``subject``, ``method`` or ``protocol``.
    label : str
        Question of the item.
    value, origin : str or None
        Value and where it comes from; None if it is not known.
    """

    key: str
    part: str
    label: str
    value: str | None
    origin: str | None


_TEXTS = (
    ('age', 'subject', 'Age'),
    ('sex', 'subject', 'Sex, gender'),
    ('handedness', 'subject', 'Handedness or footedness'),
    ('condition', 'subject', 'Condition of this participant, such as affected side'),
    ('medication', 'subject', 'Prescribed medication, drugs acting on the CNS'),
    ('symptoms', 'subject', 'Symptoms of the condition and their intensity'),
    ('comorbidity', 'subject', 'Comorbidity'),
    ('exclusion_criteria', 'subject', 'Exclusion criteria related to rPMS'),
    ('coil_location', 'method', 'Coil location, and how the place was found'),
    ('coil_type', 'method', 'Coil type: size and geometry'),
    ('coil_orientation', 'method', 'Coil orientation'),
    ('current_direction', 'method', 'Direction of the induced current'),
    ('coil_specifics', 'method', 'Technical data of the coil, such as peak field'),
    ('stimulator', 'method', 'Type of stimulator'),
    ('pulse_duration', 'method', 'Pulse duration'),
    ('paradigm', 'protocol', 'Paradigm of stimulation'),
    ('number_of_pulses', 'protocol', 'Number of pulses'),
)
ITEMS = tuple(ChecklistItem(*texts, None, None) for texts in _TEXTS)
KEYS = tuple(item.key for item in ITEMS)


def checklist_of(
    dose: Dose,
    notes: Mapping[str, str],
    stated: Mapping[str, str] | None = None,
) -> list[ChecklistItem]:
    """Return the items in their order, each with the best that is known.

    Parameters
    ----------
    dose : Dose
        Pulses of the recording.
    notes : mapping of str to str
        Notes of the recording.
    stated : mapping of str to str, optional
        Values given by the user; they have priority.

    Raises
    ------
    ReportError
        If a given item is not in the checklist.
    """
    stated = stated or {}
    if unknown := sorted(set(stated) - set(KEYS)):
        raise ReportError(
            f'expected items of the checklist ({", ".join(KEYS)}), got {", ".join(unknown)}'
        )
    sources = (
        (stated, 'stated for this report'),
        (notes, 'notes in the recording'),
        (_measured(dose), 'pulses of the recording'),
    )
    return [_filled(item, sources) for item in ITEMS]


def _filled(
    item: ChecklistItem, sources: Sequence[tuple[Mapping[str, str], str]]
) -> ChecklistItem:
    for values, origin in sources:
        if value := values.get(item.key, '').strip():
            return replace(item, value=value, origin=origin)
    return item


def _measured(dose: Dose) -> dict[str, str]:
    """Return the items that follow from the pulses."""
    if dose.intensity is None:
        return {}
    paradigm = f'{dose.trains} train{"s" if dose.trains > 1 else ""}'
    if dose.rate_hz:
        paradigm += f' at {dose.rate_hz["median"]:.4g} Hz (median)'
    intensity = _range(dose.intensity['lowest'], dose.intensity['highest'], 100.0, '%')
    known = {
        'number_of_pulses': str(dose.pulses),
        'paradigm': f'{paradigm}, {dose.stimulated_s:.4g} s within trains, intensity {intensity}',
    }
    if dose.pulse_width_s:
        widths = dose.pulse_width_s[0], dose.pulse_width_s[-1]
        known['pulse_duration'] = _range(*widths, 1e6, 'µs')
    return known


def _range(low: float, high: float, scale: float, unit: str) -> str:
    first, last = f'{scale * low:.4g}', f'{scale * high:.4g}'
    return f'{first} {unit}' if first == last else f'{first} to {last} {unit}'
