# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Device specifications: the limits of a kind of device as a data file, with their sources."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.limits.coil_temperature import CoilThermal
from rpms_ros.stimulation.limits.limiter import Limits
from rpms_ros.stimulation.schedule.description import from_file
from rpms_ros.stimulation.schedule.fields import (
    LONGEST_NAME,
    Bound,
    DescriptionError,
    as_mapping,
    bounded_names,
    build,
    read_text,
    refuse_unknown,
)
from rpms_ros.strict_yaml import shown

_FOLDER = Path(__file__).with_name('device_specifications')
LONGEST_TEXT = 500
# What has no limit at its bound in `Limits` has one here.
_OF_REAL_DEVICES = {
    'pulse_energy_j': Bound(0.0, 10_000.0, 'J', above=True),
    'maximum_rate_hz': Bound(0.0, 100.0, 'Hz', above=True),
    'maximum_intensity_rise': Bound(0.0, 0.5),
    # shorter ones would make a train of each pulse
    'minimum_pause_s': Bound(0.5, 86_400.0, 's'),
}
_KEYS = ['name', 'description', 'serial_number', 'simulated_only', 'limits', 'thermal', 'sources']


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
    serial_number : str
        Of the one device that is driven, by which its dose ledger is known; empty for a kind.
    """

    name: str
    description: str
    limits: Limits
    thermal: CoilThermal | None
    simulated_only: bool
    serial_number: str = ''


def load_device_specification(name: str) -> DeviceSpecification:
    """Return a device specification by its name, or from a YAML file of one's own.

    Raises
    ------
    StimulationError
        If there is none of that name, or the file holds a fault; names the place.
    """
    known = sorted(path.stem for path in _FOLDER.glob('*.yaml'))
    path = _FOLDER / f'{name}.yaml' if name in known else Path(name).expanduser()
    if path.suffix != '.yaml' or not path.is_file():
        fault = f'expected a device of {", ".join(known)} or a YAML file, got {name!r}'
        raise StimulationError(fault)
    return from_file(path, 'device specification', _read)


def _read(content: object) -> DeviceSpecification:
    document = as_mapping(content, '')
    refuse_unknown(document, _KEYS, '')
    simulated_only = document.get('simulated_only', False)
    if not isinstance(simulated_only, bool):
        fault = f'expected true or false, got {shown(simulated_only)}'
        raise DescriptionError('simulated_only', fault)
    limits = as_mapping(document.get('limits'), 'limits')
    refuse_unknown(limits, bounded_names(Limits), 'limits')
    thermal = document.get('thermal')
    figures = [*limits, *(as_mapping(thermal, 'thermal') if thermal is not None else [])]
    # every figure has to have a source
    sources = as_mapping(document.get('sources'), 'sources')
    refuse_unknown(sources, figures, 'sources')
    for figure in figures:
        read_text(sources, figure, 'sources', LONGEST_TEXT)
    if not simulated_only:
        _refuse_gaps(limits, thermal)
    serial = ''
    if 'serial_number' in document:
        serial = read_text(document, 'serial_number', '', LONGEST_NAME)
    return DeviceSpecification(
        name=read_text(document, 'name', '', LONGEST_NAME),
        description=read_text(document, 'description', '', LONGEST_TEXT),
        limits=build(Limits, limits, 'limits'),
        thermal=None if thermal is None else build(CoilThermal, thermal, 'thermal'),
        simulated_only=simulated_only,
        serial_number=serial,
    )


def _refuse_gaps(limits: Mapping[str, object], thermal: object) -> None:
    """Refuse the specification of a real device that leaves a limit out: nothing is assumed."""
    for name in bounded_names(Limits):
        if limits.get(name) is None:
            raise DescriptionError(
                f'limits.{name}', 'expected every limit of a real device, got nothing'
            )
    if thermal is None:
        raise DescriptionError('thermal', 'expected thermal figures of a real device, got nothing')
    for name, bound in _OF_REAL_DEVICES.items():
        bound.read(limits[name], f'limits.{name}')
