"""Fields of the rPMS reporting checklist, filled as far as a recording knows.

The checklist is the outcome of a Delphi study: Schneider, Zangrandi, Sollmann, Bonfert, Beaulieu
and the rPMS Consensus Group, Front. Neurol. 13:852848, 2022 (doi 10.3389/fneur.2022.852848).  It
has 35 items: 8 on the subject, 16 on the method, 11 on the stimulation protocol.  Named here are
those that the publication's abstract and the beginning of its Table 2 name, in words of our own:
all 8 on the subject (those of the table on which at least three quarters agreed), 7 on the
method, 2 on the protocol.  The others have to be looked up there.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from rpms_ros.errors import ReportError
from rpms_ros.report.session.excitation import Excitation

SOURCE = (
    'Schneider C, Zangrandi A, Sollmann N, Bonfert MV, Beaulieu LD, rPMS Consensus Group. '
    'Checklist on the Quality of the Repetitive Peripheral Magnetic Stimulation (rPMS) Methods '
    'in Research: An International Delphi Study. Front Neurol 13:852848, 2022. '
    'doi:10.3389/fneur.2022.852848'
)
ITEMS_OF_THE_CONSENSUS = {'subject': 8, 'method': 16, 'protocol': 11}
"""How many items each part of the published checklist has."""


@dataclass(frozen=True)
class ChecklistField:
    """One item of the checklist.

    Attributes
    ----------
    key : str
        Name under which a recording's notes or an option of the command state it.
    part : str
        ``subject``, ``method`` or ``protocol``.
    label : str
        What is asked for.
    """

    key: str
    part: str
    label: str


FIELDS = (
    ChecklistField('age', 'subject', 'Age'),
    ChecklistField('sex', 'subject', 'Sex, gender'),
    ChecklistField('handedness', 'subject', 'Handedness or footedness'),
    ChecklistField('condition', 'subject', 'Condition of this participant, such as affected side'),
    ChecklistField('medication', 'subject', 'Prescribed medication, drugs acting on the CNS'),
    ChecklistField('symptoms', 'subject', 'Symptoms of the condition and their intensity'),
    ChecklistField('comorbidity', 'subject', 'Comorbidity'),
    ChecklistField('exclusion_criteria', 'subject', 'Exclusion criteria related to rPMS'),
    ChecklistField('coil_location', 'method', 'Coil location, and how the place was found'),
    ChecklistField('coil_type', 'method', 'Coil type: size and geometry'),
    ChecklistField('coil_orientation', 'method', 'Coil orientation'),
    ChecklistField('current_direction', 'method', 'Direction of the induced current'),
    ChecklistField('coil_specifics', 'method', 'Technical data of the coil, such as peak field'),
    ChecklistField('stimulator', 'method', 'Type of stimulator'),
    ChecklistField('pulse_duration', 'method', 'Pulse duration'),
    ChecklistField('paradigm', 'protocol', 'Paradigm of stimulation'),
    ChecklistField('number_of_pulses', 'protocol', 'Number of pulses'),
)
KEYS = tuple(field.key for field in FIELDS)


@dataclass(frozen=True)
class ChecklistEntry:
    """An item with what is known of it.

    Attributes
    ----------
    field : ChecklistField
        The item.
    value : str
        Empty if it is not known.
    origin : str
        Where the value comes from; empty if it is not known.
    """

    field: ChecklistField
    value: str
    origin: str


def checklist_of(
    excitation: Excitation,
    notes: Mapping[str, str],
    stated: Mapping[str, str] | None = None,
) -> list[ChecklistEntry]:
    """Return the items in their order, each with the best that is known.

    Parameters
    ----------
    excitation : Excitation
        Pulses of the recording.
    notes : mapping of str to str
        What the recording notes for people.
    stated : mapping of str to str, optional
        What the person who makes the report states; goes before everything else.

    Raises
    ------
    ReportError
        If something is stated that is no item.
    """
    stated = stated or {}
    if unknown := sorted(set(stated) - set(KEYS)):
        raise ReportError(
            f'expected items of the checklist ({", ".join(KEYS)}), got {", ".join(unknown)}'
        )
    measured = _measured(excitation)
    sources = (
        (stated, 'stated for this report'),
        (notes, 'notes in the recording'),
        (measured, 'pulses of the recording'),
    )
    return [_entry(field, sources) for field in FIELDS]


def _entry(
    field: ChecklistField, sources: tuple[tuple[Mapping[str, str], str], ...]
) -> ChecklistEntry:
    for values, origin in sources:
        if values.get(field.key, '').strip():
            return ChecklistEntry(field, values[field.key].strip(), origin)
    return ChecklistEntry(field, '', '')


def _measured(excitation: Excitation) -> dict[str, str]:
    """Return what the pulses themselves tell."""
    if not excitation.pulses:
        return {}
    known = {'number_of_pulses': str(excitation.pulses), 'paradigm': _paradigm(excitation)}
    if excitation.widths:
        known['pulse_duration'] = _range(excitation.widths[0], excitation.widths[-1], 1e6, 'µs')
    return known


def _paradigm(excitation: Excitation) -> str:
    plural = 's' if excitation.trains > 1 else ''
    text = f'{excitation.trains} train{plural}'
    if excitation.rates_hz:
        text += f' at {excitation.rates_hz[1]:.4g} Hz (median)'
    low, high = float(excitation.intensity.min()), float(excitation.intensity.max())
    intensity = _range(low, high, 100.0, '%')
    return f'{text}, {excitation.stimulated_s:.4g} s within trains, intensity {intensity}'


def _range(low: float, high: float, scale: float, unit: str) -> str:
    first, last = f'{scale * low:.4g}', f'{scale * high:.4g}'
    return f'{first} {unit}' if first == last else f'{first} to {last} {unit}'
