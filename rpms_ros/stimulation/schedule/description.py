# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as text: YAML of a file, faults with their place.

name: warm-up
seed: 1
segments:
  - {kind: sinusoid, rate_hz: 20.0, duration_s: 18.0, high: 0.6}
  - {kind: pause, duration_s: 5.0}
  - {kind: repeat, times: 3, segments: [{kind: doublet, interval_s: 0.01}]}

Descriptions in YAML: every fault is a StimulationError with file, line and place.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.schedule.fields import DescriptionError, as_mapping, bounded_names, build
from rpms_ros.stimulation.schedule.schedule import Pause, Repeat, Schedule, Segment
from rpms_ros.stimulation.schedule.segments import (
    Constant,
    Doublet,
    PulseBurst,
    Ramp,
    Single,
    Sinusoid,
    Staircase,
    UniformRandom,
)
from rpms_ros.strict_yaml import LARGEST_DOCUMENT, YamlError, join, read_yaml, shown

Built = TypeVar('Built')


def from_text(text: str, build: Callable[[object], Built]) -> Built:
    """Return what ``build`` makes of the content of a YAML document.

    Raises
    ------
    DescriptionError
        If the text is not YAML as it is accepted here, or ``build`` finds a fault; names the line.
    StimulationError
        If ``build`` finds a fault that has no place.
    """
    try:
        node = read_yaml(text)
        return build(node.content)
    except (YamlError, DescriptionError) as fault:
        line = fault.line if isinstance(fault, YamlError) else node.line_of(fault.place)
        place = f'line {line}, {fault.place}' if fault.place else f'line {line}'
        raise DescriptionError(place, fault.fault) from fault


def from_file(path: Path, what: str, build: Callable[[object], Built]) -> Built:
    """Return what ``build`` makes of a YAML file, as `from_text` does.

    Parameters
    ----------
    path : Path
        A regular file in UTF-8.
    what : str
        What it should be, for messages.
    build : callable
        Makes something of the content.

    Raises
    ------
    StimulationError
        If it cannot be read or holds a fault; names the file.
    """
    try:
        if not path.is_file():
            raise FileNotFoundError('no regular file' if path.exists() else 'no such file')
        with path.open('rb') as file:
            # a character has at most four bytes; more is refused unread
            text = file.read(4 * LARGEST_DOCUMENT + 1).decode('utf-8')
    except UnicodeDecodeError as fault:
        said = f'expected a readable {what}, got {path}: no text in UTF-8 at byte {fault.start}'
        raise StimulationError(said) from fault
    except (OSError, ValueError) as fault:
        raise StimulationError(f'expected a readable {what}, got {path}: {fault}') from fault
    try:
        return from_text(text, build)
    except StimulationError as fault:
        raise StimulationError(f'{path}: {fault}') from fault


DEEPEST_REPEAT = 8

SEGMENT_KINDS: dict[str, type[Segment]] = {
    kind.kind: kind
    for kind in (
        Constant, Ramp, Staircase, Sinusoid, UniformRandom, Single, Doublet, PulseBurst, Pause,
    )
}  # fmt: skip


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
    name = document.get('name', 'schedule')
    segments = _segments(document.get('segments'), 'segments', 0)
    return build(Schedule, document, '', segments, also=('segments',), name=name)


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


def schedule_to_text(schedule: Schedule) -> str:
    """Return the YAML document that describes ``schedule``."""
    segments = [_described(item) for item in schedule.segments]
    mapping = {'seed': schedule.seed, 'width_s': schedule.width_s, 'segments': segments}
    # in quotes: a reader of YAML could take it for something else
    name = json.dumps(schedule.name, ensure_ascii=False)
    return f'name: {name}\n{yaml.safe_dump(mapping, sort_keys=False)}'


def _segments(content: object, place: str, depth: int) -> tuple[Segment | Repeat, ...]:
    if not isinstance(content, list) or not content:
        raise DescriptionError(place, f'expected a list of segments, got {shown(content)}')
    if depth > DEEPEST_REPEAT:
        raise DescriptionError(place, f'expected at most {DEEPEST_REPEAT} repeats in one another')
    return tuple(_segment(item, f'{place}[{i}]', depth) for i, item in enumerate(content))


def _segment(content: object, place: str, depth: int) -> Segment | Repeat:
    mapping = as_mapping(content, place)
    if mapping.get('kind') == 'repeat':
        inner = _segments(mapping.get('segments'), join(place, 'segments'), depth + 1)
        return build(Repeat, mapping, place, inner, also=('kind', 'segments'))
    return segment_from_mapping(mapping, place)


def segment_from_mapping(mapping: Mapping[str, object], place: str) -> Segment:
    """Return the segment, no repetition, that a mapping at `place` describes.

    Raises
    ------
    DescriptionError
        If its kind is not known, or something is missing, unknown or out of its bound.
    """
    if not isinstance(kind := mapping.get('kind'), str) or kind not in SEGMENT_KINDS:
        known = ', '.join(sorted([*SEGMENT_KINDS, 'repeat']))
        raise DescriptionError(join(place, 'kind'), f'expected one of {known}, got {shown(kind)}')
    return build(SEGMENT_KINDS[kind], mapping, place, also=('kind',))


def _described(item: Segment | Repeat) -> dict[str, Any]:
    if isinstance(item, Repeat):
        inner = [_described(segment) for segment in item.segments]
        return {'kind': 'repeat', 'times': item.times, 'segments': inner}
    return segment_to_mapping(item)


def segment_to_mapping(segment: Segment) -> dict[str, Any]:
    """Return the mapping that describes a segment; what is left to its default is not in it."""
    values = {name: getattr(segment, name) for name in bounded_names(type(segment))}
    plain = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
        if value is not None
    }
    return {'kind': segment.kind, **plain}
