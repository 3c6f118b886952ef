# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what happens to a simulated muscle and its sensor in a session, as a YAML file.

Times count from the start of the session.  See docs/scenarios.md for the keys.  Efforts are
forces that the stimulation does not cause: voluntary effort, spasm, tremor, a bumped sensor.  Each
depends on time alone, so the result does not depend on how samples are cut into blocks.
"""

import math
import typing
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.muscle.sensor import Disturbances, SensorFault
from rpms_ros.muscle.time_varying import Change, Fatigue, LivingSettings, Potentiation
from rpms_ros.pulses import FloatArray
from rpms_ros.strict_yaml import YamlError, join, read_yaml, shown

T = TypeVar('T')
_FOLDER = Path(__file__).with_name('scenarios')
_KEYS = (
    'name', 'description', 'fatigue', 'potentiation', 'changes', 'efforts', 'disturbances',
    'sensor_faults',
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _HalfSine:
    """Rises and falls as a power of a sine.

    Attributes
    ----------
    at : float
        Beginning [s].
    peak : float
        Largest force [N], of either sign.
    duration : float
        Length [s].
    every : float or None
        Repeats with this period [s]; None for once.
    """

    POWER: ClassVar[int] = 1
    at: float
    peak: float
    duration: float
    every: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, self.duration, self.every)
        check_number(MuscleError, 'peak', self.peak)

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        since = _since(time, self.at, self.every)
        inside = (since >= 0.0) & (since < self.duration)
        wave = np.where(inside, np.sin(math.pi * since / self.duration), 0.0)
        return self.peak * wave**self.POWER


@dataclass(frozen=True, kw_only=True)
class VoluntaryEffort(_HalfSine):
    """A voluntary contraction that rises and falls as a squared sine."""

    kind: ClassVar[str] = 'voluntary'
    POWER: ClassVar[int] = 2


@dataclass(frozen=True, kw_only=True)
class Bump(_HalfSine):
    """A knock on the sensor: half a sine."""

    kind: ClassVar[str] = 'bump'
    duration: float = 0.03


@dataclass(frozen=True)
class Spasm:
    """An involuntary contraction: a fast rise, then an exponential decay.

    Attributes
    ----------
    at : float
        Beginning [s].
    peak : float
        Largest force [N].
    rise : float
        Time to the peak [s].
    decay : float
        Time constant after the peak [s].
    every : float or None
        Repeats with this period [s]; None for once.
    """

    kind: ClassVar[str] = 'spasm'
    at: float
    peak: float
    rise: float = 0.15
    decay: float = 1.0
    every: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, self.rise, self.every, 'rise')
        check_number(MuscleError, 'peak', self.peak)
        check_number(MuscleError, 'decay', self.decay, 0, above=True, unit='s')

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        since = _since(time, self.at, self.every)
        rising = self.peak * np.sin(0.5 * math.pi * np.clip(since / self.rise, 0.0, 1.0)) ** 2
        falling = np.exp(-np.maximum(since - self.rise, 0.0) / self.decay)
        return np.where(since >= 0.0, rising * falling, 0.0)


@dataclass(frozen=True)
class Tremor:
    """A sinusoidal force.

    Attributes
    ----------
    amplitude : float
        Half of the peak-to-peak force [N].
    frequency : float
        [Hz].
    at : float
        Beginning [s].
    duration : float or None
        Length [s]; None: to the end of the session.
    """

    kind: ClassVar[str] = 'tremor'
    amplitude: float
    frequency: float = 8.0
    at: float = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, 1.0 if self.duration is None else self.duration, None)
        check_number(MuscleError, 'amplitude', self.amplitude)
        check_number(MuscleError, 'frequency', self.frequency, 0, 1000, above=True, unit='Hz')

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        since = time - self.at
        wave = self.amplitude * np.sin(2.0 * math.pi * self.frequency * since)
        return np.where((since >= 0.0) & (since < (self.duration or math.inf)), wave, 0.0)


Effort = VoluntaryEffort | Spasm | Tremor | Bump
"""One kind of force that the stimulation does not cause."""

# Kinds of effort by their names in a scenario.
_EFFORTS: dict[str, type[Effort]] = {effort.kind: effort for effort in typing.get_args(Effort)}


def _since(time: FloatArray, at: float, every: float | None) -> FloatArray:
    """Return the time since the newest beginning (samples,) [s]; negative before the first."""
    since = time - at
    return since if every is None else np.where(since >= 0.0, np.mod(since, every), since)


def _require_event(
    at: float, duration: float, every: float | None, name: str = 'duration'
) -> None:
    """Raise `MuscleError` unless an event is possible; `name` is the key of its length."""
    check_number(MuscleError, 'at', at, 0, unit='s')
    check_number(MuscleError, name, duration, 0, above=True, unit='s')
    if every is not None:
        check_number(MuscleError, 'every', every, duration, unit='s')


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
        known = ', '.join(scenario_names())
        said = f'expected a scenario of {known} or a readable file, got {shown(name)}'
        raise MuscleError(said) from fault
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
        return _scenario(node.content)
    except YamlError as fault:
        raise MuscleError(str(fault)) from fault
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
    for name in ('name', 'description'):
        _check(str, keys.get(name, ''), name)
    return Scenario(
        name=keys.get('name', 'scenario'),
        description=keys.get('description', ''),
        living=LivingSettings(
            _built(Fatigue, keys.get('fatigue', {}), 'fatigue'),
            _built(Potentiation, keys.get('potentiation', {}), 'potentiation'),
            _several(keys, 'changes', partial(_built, Change)),
        ),
        efforts=_several(keys, 'efforts', _effort),
        disturbances=_built(Disturbances, keys.get('disturbances', {}), 'disturbances'),
        sensor_faults=_several(keys, 'sensor_faults', partial(_built, SensorFault)),
    )


def _effort(content: object, place: str) -> Effort:
    keys = _mapping(content, place)
    if not isinstance(kind := keys.get('kind'), str) or kind not in _EFFORTS:
        raise _Fault(
            join(place, 'kind') if 'kind' in keys else place,
            f'expected a kind of {", ".join(_EFFORTS)}, got {shown(kind)}',
        )
    rest = {key: value for key, value in keys.items() if key != 'kind'}
    return _built(_EFFORTS[kind], rest, place)


def _built(cls: type[T], content: object, place: str) -> T:
    """Return a dataclass made from the numbers and texts of a mapping."""
    hints = typing.get_type_hints(cls)
    declared = fields(cls)  # type: ignore[arg-type]
    keys = _mapping(content, place, tuple(one.name for one in declared))
    for key, value in keys.items():
        _check(hints[key], value, join(place, key))
    for one in declared:
        if one.default is MISSING and one.name not in keys:
            raise _Fault(place, f'expected the key {one.name}, got {", ".join(keys) or "nothing"}')
    values = {
        key: value if value is None or isinstance(value, str) else float(value)
        for key, value in keys.items()
    }
    try:
        return cls(**values)
    except MuscleError as fault:
        raise _Fault(place, str(fault)) from fault


def _check(hint: Any, value: object, place: str) -> None:
    """Raise a fault unless a value fits a field of type float, float or None, or str."""
    if hint is str:
        what, fits = 'text', isinstance(value, str)
    else:
        what, fits = 'number', isinstance(value, int | float) and not isinstance(value, bool)
        fits = fits or (value is None and type(None) in typing.get_args(hint))
    if not fits:
        raise _Fault(place, f'expected a {what}, got {shown(value)}')


def _mapping(
    content: object, place: str, known: tuple[str, ...] | None = None
) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise _Fault(place, f'expected keys and values, got {shown(content)}')
    for key in content:
        if known is not None and key not in known:
            fault = f'expected a key of {", ".join(known)}, got {shown(key)}'
            raise _Fault(join(place, key), fault)
    return content


def _several(
    keys: Mapping[str, Any], name: str, build: Callable[[object, str], T]
) -> tuple[T, ...]:
    """Return what is built of the items of a list and their places."""
    if not isinstance(found := keys.get(name, []), list):
        raise _Fault(name, f'expected a list, got {shown(found)}')
    return tuple(build(item, f'{name}[{index}]') for index, item in enumerate(found))
