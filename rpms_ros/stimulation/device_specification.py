"""Device specifications: the limits of a kind of device as a data file, with their sources."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.stimulation.fields import as_mapping
from rpms_ros.stimulation.fields import bounded_names
from rpms_ros.stimulation.fields import read_bounded
from rpms_ros.stimulation.fields import refuse_unknown
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.thermal import CoilThermal
from rpms_ros.stimulation.yaml_places import load_document
from rpms_ros.stimulation.yaml_places import with_line

_FOLDER = Path(__file__).with_name('device_specifications')
_KEYS = ['name', 'description', 'simulated_only', 'limits', 'thermal', 'sources']


@dataclass(frozen=True)
class DeviceSpecification:
    """What a kind of device can do.

    Attributes
    ----------
    name : str
        As in ``--device``.
    description : str
        What it is, in a sentence.
    limits : Limits
        What no pulse may go beyond.
    thermal : CoilThermal or None
        Thermal figures of its coil, if there are any.
    simulated_only : bool
        Whether it must not be used with a device that can hurt somebody.
    sources : mapping of str to str
        Where each figure comes from.
    """

    name: str
    description: str
    limits: Limits
    thermal: CoilThermal | None
    simulated_only: bool
    sources: Mapping[str, str]


def profile_names() -> list[str]:
    """Return the names of the device specifications that come with the package."""
    return sorted(path.stem for path in _FOLDER.glob('*.yaml'))


def load_device_specification(name: str) -> DeviceSpecification:
    """Return a device specification by its name, or from a YAML file of one's own.

    Raises
    ------
    StimulationError
        If there is none of that name, or the file holds a fault; names the place.
    """
    path = _FOLDER / f'{name}.yaml' if name in profile_names() else Path(name)
    if path.suffix != '.yaml' or not path.is_file():
        known = ', '.join(profile_names())
        raise StimulationError(f'expected a device of {known} or a YAML file, got {name!r}')
    try:
        node, content = load_document(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as fault:
        raise StimulationError(
            f'expected a readable device specification, got {path}: {fault}'
        ) from fault
    except StimulationError as fault:
        raise StimulationError(f'{path}: {fault}') from fault
    try:
        return _read(content)
    except DescriptionError as fault:
        raise StimulationError(f'{path}: {with_line(fault, node)}') from fault
    except StimulationError as fault:
        raise StimulationError(f'{path}: limits: {fault}') from fault


def _read(content: object) -> DeviceSpecification:
    document = as_mapping(content, '')
    refuse_unknown(document, _KEYS, '')
    limits = as_mapping(document.get('limits'), 'limits')
    refuse_unknown(limits, bounded_names(Limits), 'limits')
    sources = as_mapping(document.get('sources'), 'sources')
    thermal = document.get('thermal')
    figures = [*limits, *(as_mapping(thermal, 'thermal') if thermal is not None else [])]
    for figure in figures:
        if not isinstance(sources.get(figure), str):
            raise DescriptionError('sources', f'expected the source of {figure}, got none')
    return DeviceSpecification(
        name=_text(document, 'name'),
        description=_text(document, 'description'),
        limits=Limits(**read_bounded(Limits, limits, 'limits')),
        thermal=_thermal(thermal),
        simulated_only=document.get('simulated_only') is True,
        sources={name: str(source) for name, source in sources.items()},
    )


def _thermal(content: object) -> CoilThermal | None:
    if content is None:
        return None
    mapping = as_mapping(content, 'thermal')
    refuse_unknown(mapping, bounded_names(CoilThermal), 'thermal')
    return CoilThermal(**read_bounded(CoilThermal, mapping, 'thermal'))


def _text(document: Mapping[str, object], key: str) -> str:
    value = document.get(key)
    if not isinstance(value, str) or not value.strip():
        raise DescriptionError(key, f'expected a text, got {value!r}')
    return ' '.join(value.split())
