# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as text: YAML of a file and of an action goal, one schema, faults with their place.

name: warm-up
seed: 1
segments:
  - {kind: sinusoid, rate_hz: 20.0, duration_s: 18.0, high: 0.6}
  - {kind: pause, duration_s: 5.0}
  - {kind: repeat, times: 3, segments: [{kind: doublet, interval_s: 0.01}]}
"""

import hashlib
import re
from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any
from typing import TypeVar

import yaml

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.bursts import Doublet
from rpms_ros.stimulation.bursts import PulseBurst
from rpms_ros.stimulation.bursts import Single
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.stimulation.fields import as_mapping
from rpms_ros.stimulation.fields import bounded_names
from rpms_ros.stimulation.fields import read_bounded
from rpms_ros.stimulation.fields import read_text
from rpms_ros.stimulation.fields import refuse_unknown
from rpms_ros.stimulation.multilevel_prbs import MultilevelPRBS
from rpms_ros.stimulation.repetitive import Constant
from rpms_ros.stimulation.repetitive import Ramp
from rpms_ros.stimulation.repetitive import Sinusoid
from rpms_ros.stimulation.repetitive import Staircase
from rpms_ros.stimulation.repetitive import UniformRandom
from rpms_ros.stimulation.schedule import LONGEST_NAME
from rpms_ros.stimulation.schedule import Repeat
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.segment import Pause
from rpms_ros.stimulation.segment import Segment
from rpms_ros.stimulation.yaml_places import from_file
from rpms_ros.stimulation.yaml_places import from_text
from rpms_ros.strict_yaml import join
from rpms_ros.strict_yaml import shown

DEEPEST_REPEAT = 8
Built = TypeVar('Built')

SEGMENT_KINDS: dict[str, type[Segment]] = {
    kind.kind: kind
    for kind in (
        Constant, Ramp, Staircase, Sinusoid, UniformRandom, MultilevelPRBS,
        Single, Doublet, PulseBurst, Pause,
    )
}  # fmt: skip

# no digit, so no number or date in any YAML
_PLAIN = re.compile(r'[A-Za-z]+([_-][A-Za-z]+)*')
_WORDS = frozenset({'true', 'false', 'yes', 'no', 'on', 'off', 'y', 'n', 'null'})


def schedule_from_mapping(content: object) -> Schedule:
    """Return the schedule that a mapping describes.

    Parameters
    ----------
    content : mapping
        Keys ``segments`` (required), ``name``, ``seed``, ``width_s``.

    Raises
    ------
    DescriptionError
        If something is missing, unknown or out of its bound; names the place.
    """
    document = as_mapping(content, '')
    refuse_unknown(document, ['name', 'segments', *bounded_names(Schedule)], '')
    named = {'name': 'schedule', **document}
    name = read_text(named, 'name', '', LONGEST_NAME)
    segments = _segments(document.get('segments'), 'segments', 0)
    return built(Schedule, read_bounded(Schedule, document, ''), '', segments, name=name)


def schedule_from_text(text: str) -> Schedule:
    """Return the schedule of a YAML document; a fault is named by its line and place."""
    return from_text(text, schedule_from_mapping)


def load_schedule(path: Path) -> Schedule:
    """Return the schedule in a YAML file; a fault is named by file, line and place.

    Raises
    ------
    StimulationError
        If the file cannot be read or does not describe a schedule.
    """
    return from_file(path, 'schedule file', schedule_from_mapping)


def schedule_to_mapping(schedule: Schedule) -> dict[str, Any]:
    """Return the mapping that describes ``schedule``."""
    return {
        'name': schedule.name,
        'seed': schedule.seed,
        'width_s': schedule.width_s,
        'segments': [_described(item) for item in schedule.segments],
    }


def schedule_to_text(schedule: Schedule) -> str:
    """Return the YAML document that describes ``schedule``."""
    return yaml.dump(schedule_to_mapping(schedule), Dumper=_Dumper, sort_keys=False)


def text_hash(text: str) -> str:
    """Return the SHA-256 of a document as hexadecimal digits, as `sha256sum` of its file does."""
    return hashlib.sha256(text.encode('utf-8', 'replace')).hexdigest()


class _Dumper(yaml.SafeDumper):
    """Puts every text in quotes that a YAML reader could take for something else."""

    def ignore_aliases(self, data: object) -> bool:
        """Write everything out: no reader here accepts an alias."""
        del data
        return True

    def text(self, data: str) -> yaml.Node:
        """Return a text in quotes unless it is a plain name."""
        plain = _PLAIN.fullmatch(data) and data.lower() not in _WORDS
        style = None if plain else '"'
        return self.represent_scalar('tag:yaml.org,2002:str', data, style)


_Dumper.add_representer(str, _Dumper.text)


def _segments(content: object, place: str, depth: int) -> tuple[Segment | Repeat, ...]:
    if not isinstance(content, list) or not content:
        raise DescriptionError(place, f'expected a list of segments, got {shown(content)}')
    if depth > DEEPEST_REPEAT:
        raise DescriptionError(place, f'expected at most {DEEPEST_REPEAT} repeats in one another')
    return tuple(_segment(item, f'{place}[{i}]', depth) for i, item in enumerate(content))


def _segment(content: object, place: str, depth: int) -> Segment | Repeat:
    mapping = as_mapping(content, place)
    kind = mapping.get('kind')
    if kind == 'repeat':
        refuse_unknown(mapping, ['kind', 'segments', 'times'], place)
        inner = _segments(mapping.get('segments'), join(place, 'segments'), depth + 1)
        return built(Repeat, read_bounded(Repeat, mapping, place), place, inner)
    return segment_from_mapping(mapping, place)


def segment_from_mapping(mapping: Mapping[str, object], place: str) -> Segment:
    """Return the segment, no repetition, that a mapping at `place` describes.

    Raises
    ------
    DescriptionError
        If its kind is not known, or something is missing, unknown or out of its bound.
    """
    kind = mapping.get('kind')
    if not isinstance(kind, str) or kind not in SEGMENT_KINDS:
        known = ', '.join(sorted([*SEGMENT_KINDS, 'repeat']))
        raise DescriptionError(join(place, 'kind'), f'expected one of {known}, got {shown(kind)}')
    chosen = SEGMENT_KINDS[kind]
    refuse_unknown(mapping, ['kind', *bounded_names(chosen)], place)
    return built(chosen, read_bounded(chosen, mapping, place), place)


def built(
    build: Callable[..., Built], values: Mapping[str, Any], place: str, *inner: Any, **names: str
) -> Built:
    """Build a dataclass; a fault of several fields together is named by the place of the whole."""
    try:
        return build(*inner, **names, **values)
    except DescriptionError:
        raise
    except StimulationError as fault:
        raise DescriptionError(place, str(fault)) from fault


def _described(item: Segment | Repeat) -> dict[str, Any]:
    if isinstance(item, Repeat):
        inner = [_described(segment) for segment in item.segments]
        return {'kind': 'repeat', 'times': item.times, 'segments': inner}
    values = {entry.name: getattr(item, entry.name) for entry in fields(item)}
    plain = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
        if value is not None
    }
    return {'kind': item.kind, **plain}
