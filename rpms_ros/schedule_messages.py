# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as rpms_msgs/Schedule and back: the schema of a schedule file, its checks and bounds.

A field that a kind of segment does not read has to be zero, as a key that nobody reads is refused
in a file.  What a kind reads is taken as it stands: there is no default but for the few fields
that say so in the message.

Schedules as a flat list of entries, for what cannot nest into itself, as ROS messages.

An entry is what a schedule file has, but for a repetition: ``{kind: repeat, times: 3, length: 2}``
repeats the two entries that follow it.  Entries of a repetition among them count as well.
"""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from rpms_ros.messages import MessageTypes
from rpms_ros.stimulation.schedule.description import (
    DEEPEST_REPEAT,
    SEGMENT_KINDS,
    built,
    segment_from_mapping,
)
from rpms_ros.stimulation.schedule.fields import (
    DescriptionError,
    as_mapping,
    bounded_names,
    read_bounded,
    read_text,
    refuse_unknown,
)
from rpms_ros.stimulation.schedule.schedule import LONGEST_NAME, Repeat, Schedule, Segment
from rpms_ros.strict_yaml import MOST_NODES, join, shown

Entry = dict[str, Any]
Items = tuple[Segment | Repeat, ...]


def schedule_from_entries(
    entries: Sequence[Mapping[str, object]], values: Mapping[str, object]
) -> Schedule:
    """Return the schedule that a flat list describes; bounds are those of a schedule file.

    Parameters
    ----------
    entries : sequence of mapping
        Segments and repetitions.
    values : mapping
        ``name``, and ``seed`` and ``width_s`` if they are not the defaults.

    Raises
    ------
    DescriptionError
        If something is missing, unknown or out of its bound; names the place.
    """
    if not entries:
        raise DescriptionError('segments', 'expected at least one segment, got none')
    # what the same schedule has as a document, where keys count too
    size = sum(1 + 2 * len(entry) + _length(entry.get('levels')) for entry in entries)
    if size > MOST_NODES:
        raise DescriptionError('segments', f'expected at most {MOST_NODES} values, got {size}')
    name = read_text(values, 'name', '', LONGEST_NAME)
    items = _items(entries, 0, len(entries), 0)
    return built(Schedule, read_bounded(Schedule, values, ''), '', items, name=name)


def entries_of(schedule: Schedule) -> list[Entry]:
    """Return the flat list that describes the segments of a schedule."""
    return _flat(schedule.segments)


def _items(entries: Sequence[Mapping[str, object]], start: int, stop: int, depth: int) -> Items:
    items: list[Segment | Repeat] = []
    index = start
    while index < stop:
        place = f'segments[{index}]'
        entry = as_mapping(entries[index], place)
        index += 1
        if entry.get('kind') == 'repeat':
            end = index + _repeated(entry, place, stop - index, depth)
            inner = _items(entries, index, end, depth + 1)
            items.append(built(Repeat, read_bounded(Repeat, entry, place), place, inner))
            index = end
        else:
            items.append(segment_from_mapping(entry, place))
    return tuple(items)


def _repeated(entry: Mapping[str, object], place: str, most: int, depth: int) -> int:
    """Return how many of the `most` entries that follow a repetition repeats."""
    refuse_unknown(entry, ['kind', 'length', 'times'], place)
    if depth >= DEEPEST_REPEAT:
        raise DescriptionError(place, f'expected at most {DEEPEST_REPEAT} repeats in one another')
    length = entry.get('length')
    if not isinstance(length, int) or isinstance(length, bool) or not 1 <= length <= most:
        raise DescriptionError(
            join(place, 'length'),
            f'expected a whole number from 1 to the {most} entries that follow here, '
            f'got {shown(length)}',
        )
    return length


def _length(value: object) -> int:
    return len(value) if isinstance(value, list | tuple) else 0


def _flat(items: Items) -> list[Entry]:
    entries: list[Entry] = []
    for item in items:
        if isinstance(item, Repeat):
            inner = _flat(item.segments)
            entries += [{'kind': 'repeat', 'times': item.times, 'length': len(inner)}, *inner]
        else:
            values = {entry.name: getattr(item, entry.name) for entry in fields(item)}
            given = {name: value for name, value in values.items() if value is not None}
            entries.append({'kind': item.kind, **given})
    return entries


SCHEDULE = 'rpms_msgs/msg/Schedule'
SCHEDULE_SEGMENT = 'rpms_msgs/msg/ScheduleSegment'

KINDS = (
    'constant', 'ramp', 'staircase', 'sinusoid', 'uniform_random', 'multilevel_prbs',
    'single', 'doublet', 'n_let', 'pause', 'repeat',
)  # fmt: skip
"""Kinds of segments; the number of the first is 1."""

_REPEAT = ('times', 'length')
_FIELDS = tuple(
    dict.fromkeys(
        [name for kind in SEGMENT_KINDS.values() for name in bounded_names(kind)] + [*_REPEAT]
    )
)


def is_given(message: Any) -> bool:
    """Return whether an rpms_msgs/Schedule holds anything at all."""
    return bool(message.name or message.seed or message.width_s or len(message.segments))


def schedule_of(message: Any) -> Schedule:
    """Return the schedule in an rpms_msgs/Schedule.

    Raises
    ------
    DescriptionError
        If something is out of its bound, or given where nobody reads it; names the place.
    """
    values = {'name': message.name or 'schedule', 'seed': message.seed}
    if message.width_s:
        values['width_s'] = message.width_s
    # More is refused unread.
    segments = message.segments[: MOST_NODES + 1]
    entries = [_entry(segment, f'segments[{i}]') for i, segment in enumerate(segments)]
    return schedule_from_entries(entries, values)


def schedule_message(schedule: Schedule, types: MessageTypes) -> Any:
    """Return an rpms_msgs/Schedule."""
    return types[SCHEDULE](
        name=str(schedule.name),
        seed=int(schedule.seed),
        width_s=float(schedule.width_s),
        segments=[_segment(entry, types) for entry in entries_of(schedule)],
    )


def _entry(message: Any, place: str) -> Entry:
    number = int(message.kind)
    if not 1 <= number <= len(KINDS):
        raise DescriptionError(
            f'{place}.kind', f'expected a number from 1 to {len(KINDS)}, got {number}'
        )
    kind = KINDS[number - 1]
    read = _REPEAT if kind == 'repeat' else tuple(bounded_names(SEGMENT_KINDS[kind]))
    entry: Entry = {'kind': kind}
    for name in _FIELDS:
        value = getattr(message, name)
        if name == 'levels':
            value = list(value[: MOST_NODES + 1])
        if name in read and not _left_out(name, value, message):
            entry[name] = value
        elif value:
            raise DescriptionError(f'{place}.{name}', _unread(kind, name, value))
    if message.own_seed and 'seed' not in read:
        raise DescriptionError(f'{place}.own_seed', _unread(kind, 'own_seed', True))
    return entry


def _left_out(name: str, value: Any, message: Any) -> bool:
    """Return whether a field stands for a key that a file would not have."""
    if name == 'seed':
        return not message.own_seed
    return bool(name == 'final_rate_hz' and value == 0.0)


def _unread(kind: str, name: str, value: object) -> str:
    if name == 'seed' and kind in ('uniform_random', 'multilevel_prbs'):
        return f'expected own_seed with a seed, got {value} without'
    return f'expected nothing here, which a {kind} does not read, got {value}'


def _segment(entry: Entry, types: MessageTypes) -> Any:
    values = dict(entry)
    number = KINDS.index(values.pop('kind')) + 1
    if 'levels' in values:
        values['levels'] = array('d', values['levels'])
    if 'seed' in values:
        values['own_seed'] = True
    whole = {'count', 'level_count', 'order', 'hold_pulses', 'seed', 'times', 'length'}
    apart = {'levels', 'own_seed', *whole}
    plain = {name: value if name in apart else float(value) for name, value in values.items()}
    return types[SCHEDULE_SEGMENT](kind=number, **plain)
