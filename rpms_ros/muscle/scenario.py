# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what happens to a simulated muscle and its sensor in a session, as a YAML file.

Times count from the start of the session.  See docs/scenarios.md for the keys.
"""

import typing
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from rpms_ros.errors import MuscleError
from rpms_ros.muscle.effort import EFFORTS, Effort
from rpms_ros.muscle.sensor import Disturbances, SensorFault
from rpms_ros.muscle.time_varying import Change, Fatigue, LivingSettings, Potentiation
from rpms_ros.strict_yaml import YamlError, join, read_yaml, shown

T = TypeVar('T')
_FOLDER = Path(__file__).with_name('scenarios')
_KEYS = (
    'name', 'description', 'fatigue', 'potentiation', 'changes', 'efforts', 'disturbances',
    'sensor_faults',
)  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """What happens in a session.

    Attributes
    ----------
    name, description : str
        Its name, and a sentence that says what happens.
    living : LivingSettings
        Changes of the muscle.
    efforts : tuple of Effort
        Force that the stimulation does not cause.
    disturbances : Disturbances
        What the sensor adds.
    sensor_faults : tuple of SensorFault
        Faults of the sensor.
    """

    name: str = 'steady'
    description: str = ''
    living: LivingSettings = field(default_factory=LivingSettings)
    efforts: tuple[Effort, ...] = ()
    disturbances: Disturbances = field(default_factory=Disturbances)
    sensor_faults: tuple[SensorFault, ...] = ()


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package."""
    return tuple(sorted(path.stem for path in _FOLDER.glob('*.yaml')))


def load_scenario(name: str) -> Scenario:
    """Return a scenario by its name, or from a YAML file.

    Raises
    ------
    MuscleError
        If there is none, or it is not valid; the message names file, line and key.
    """
    path = _FOLDER / f'{name}.yaml' if name in scenario_names() else Path(name).expanduser()
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, ValueError) as fault:
        raise MuscleError(
            f'expected a scenario of {", ".join(scenario_names())} or a readable file, '
            f'got {shown(name)}'
        ) from fault
    try:
        return scenario_from_text(text)
    except MuscleError as fault:
        raise MuscleError(f'{path}: {fault}') from fault


def scenario_from_text(text: str) -> Scenario:
    """Return the scenario that a YAML document describes.

    Raises
    ------
    MuscleError
        If it is not valid; the message names line and key.
    """
    try:
        node = read_yaml(text)
    except YamlError as fault:
        raise MuscleError(str(fault)) from fault
    try:
        return _scenario(node.content)
    except _Fault as fault:
        line = node.line_of(fault.place)
        raise MuscleError(f'line {line}, {fault.place or "scenario"}: {fault}') from fault


class _Fault(MuscleError):
    """A fault at a place of the document."""

    def __init__(self, place: str, fault: str) -> None:
        super().__init__(fault)
        self.place = place


def _scenario(content: object) -> Scenario:
    keys = _mapping(content, '', _KEYS)
    efforts = tuple(
        _effort(item, f'efforts[{index}]') for index, item in enumerate(_several(keys, 'efforts'))
    )
    return Scenario(
        name=_text(keys, 'name', 'scenario'),
        description=_text(keys, 'description', ''),
        living=LivingSettings(
            _built(Fatigue, keys.get('fatigue', {}), 'fatigue'),
            _built(Potentiation, keys.get('potentiation', {}), 'potentiation'),
            _all_built(Change, keys, 'changes'),
        ),
        efforts=efforts,
        disturbances=_built(Disturbances, keys.get('disturbances', {}), 'disturbances'),
        sensor_faults=_all_built(SensorFault, keys, 'sensor_faults'),
    )


def _effort(content: object, place: str) -> Effort:
    if not isinstance(content, Mapping):
        raise _Fault(place, f'expected keys and values, got {shown(content)}')
    kind = content.get('kind')
    if not isinstance(kind, str) or kind not in EFFORTS:
        raise _Fault(
            join(place, 'kind') if 'kind' in content else place,
            f'expected a kind of {", ".join(EFFORTS)}, got {shown(kind)}',
        )
    rest = {key: value for key, value in content.items() if key != 'kind'}
    return _built(EFFORTS[kind], rest, place)


def _all_built(cls: type[T], keys: Mapping[str, Any], name: str) -> tuple[T, ...]:
    return tuple(
        _built(cls, item, f'{name}[{index}]') for index, item in enumerate(_several(keys, name))
    )


def _built(cls: type[T], content: object, place: str) -> T:
    """Return a dataclass made from the numbers and texts of a mapping."""
    declared = _declared(cls)
    keys = _mapping(content, place, tuple(declared))
    for key, value in keys.items():
        _check(declared[key][1], value, join(place, key))
    for name, (one, _) in declared.items():
        if one.default is MISSING and one.default_factory is MISSING and name not in keys:
            raise _Fault(place, f'expected the key {name}, got {", ".join(keys) or "nothing"}')
    values = {
        key: value if value is None or isinstance(value, str) else float(value)
        for key, value in keys.items()
    }
    try:
        return cls(**values)
    except MuscleError as fault:
        raise _Fault(place, str(fault)) from fault


def _declared(cls: type) -> dict[str, tuple[Field[Any], Any]]:
    """Return the fields of a dataclass with their types."""
    hints = typing.get_type_hints(cls)
    return {one.name: (one, hints[one.name]) for one in fields(cls)}


def _check(hint: Any, value: object, place: str) -> None:
    """Raise a fault unless a value fits a field of type float, float or None, or str."""
    if hint is str:
        if not isinstance(value, str):
            raise _Fault(place, f'expected a text, got {shown(value)}')
        return
    if value is None and type(None) in typing.get_args(hint):
        return
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _Fault(place, f'expected a number, got {shown(value)}')


def _mapping(content: object, place: str, known: tuple[str, ...]) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise _Fault(place, f'expected keys and values, got {shown(content)}')
    for key in content:
        if key not in known:
            raise _Fault(
                join(place, key), f'expected a key of {", ".join(known)}, got {shown(key)}'
            )
    return content


def _several(keys: Mapping[str, Any], name: str) -> list[Any]:
    found = keys.get(name, [])
    if not isinstance(found, list):
        raise _Fault(name, f'expected a list, got {shown(found)}')
    return found


def _text(keys: Mapping[str, Any], name: str, default: str) -> str:
    found = keys.get(name, default)
    if not isinstance(found, str):
        raise _Fault(name, f'expected a text, got {shown(found)}')
    return found
