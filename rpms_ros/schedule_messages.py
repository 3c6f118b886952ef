# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as rpms_msgs/Schedule and back: the schema of a schedule file, its checks and bounds.

A field that a kind of segment does not read has to be zero, as a key that nobody reads is refused
in a file.  What a kind reads is taken as it stands: there is no default but for the few fields
that say so in the message.

Messages do not nest into themselves, so the list is flat: a repetition stands before the entries
that it repeats and says in ``length`` how many they are, those of repetitions among them included.
"""

from array import array
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

from rpms_ros.messages import MessageTypes
from rpms_ros.stimulation.schedule.description import (
    DEEPEST_REPEAT,
    SEGMENT_KINDS,
    segment_from_mapping,
    segment_to_mapping,
)
from rpms_ros.stimulation.schedule.fields import DescriptionError, bounded_names, build
from rpms_ros.stimulation.schedule.schedule import Repeat, Schedule, Segment
from rpms_ros.strict_yaml import MOST_NODES

Entry = dict[str, Any]
Items = tuple[Segment | Repeat, ...]

SCHEDULE = 'rpms_msgs/msg/Schedule'
SCHEDULE_SEGMENT = 'rpms_msgs/msg/ScheduleSegment'

KINDS = (
    'constant', 'ramp', 'staircase', 'sinusoid', 'uniform_random', 'multilevel_prbs',
    'single', 'doublet', 'n_let', 'pause', 'repeat',
)  # fmt: skip
"""Kinds of segments; the number of the first is 1."""

_READ = {kind: bounded_names(segment) for kind, segment in SEGMENT_KINDS.items()}
_READ['repeat'] = ['times', 'length']
# What only a multilevel_prbs had, which is gone, has to be zero as well.
_FIELDS = dict.fromkeys(chain(*_READ.values(), ('level_count', 'order', 'hold_pulses')))


def schedule_of(message: Any) -> Schedule:
    """Return the schedule in an rpms_msgs/Schedule; bounds are those of a schedule file.

    Raises
    ------
    DescriptionError
        If something is out of its bound, or given where nobody reads it; names the place.
    """
    if not message.segments:
        raise DescriptionError('segments', 'expected at least one segment, got none')
    # more is refused unread
    segments = message.segments[: MOST_NODES + 1]
    entries = [_entry(segment, f'segments[{i}]') for i, segment in enumerate(segments)]
    # what the same schedule has as a document, where keys count too
    size = sum(1 + 2 * len(entry) + len(entry.get('levels', ())) for entry in entries)
    if size > MOST_NODES:
        raise DescriptionError('segments', f'expected at most {MOST_NODES} values, got {size}')
    values = {'seed': message.seed}
    if message.width_s:
        values['width_s'] = message.width_s
    items = tuple(_items(entries, 0, len(entries), 0))
    return build(Schedule, values, '', items, name=message.name or 'schedule')


def schedule_message(schedule: Schedule, types: MessageTypes) -> Any:
    """Return an rpms_msgs/Schedule."""
    return types[SCHEDULE](
        name=str(schedule.name),
        seed=int(schedule.seed),
        width_s=float(schedule.width_s),
        segments=[_segment(entry, types) for entry in _flat(schedule.segments)],
    )


def _items(
    entries: Sequence[Entry], start: int, stop: int, depth: int
) -> Iterator[Segment | Repeat]:
    index = start
    while index < stop:
        entry, place = entries[index], f'segments[{index}]'
        index += 1
        if entry['kind'] != 'repeat':
            yield segment_from_mapping(entry, place)
            continue
        if depth >= DEEPEST_REPEAT:
            fault = f'expected at most {DEEPEST_REPEAT} repeats in one another'
            raise DescriptionError(place, fault)
        end = index + entry['length']
        if not index < end <= stop:
            raise DescriptionError(
                f'{place}.length',
                f'expected a whole number from 1 to the {stop - index} entries that follow here, '
                f'got {entry["length"]}',
            )
        inner = tuple(_items(entries, index, end, depth + 1))
        yield build(Repeat, entry, place, inner, also=('kind', 'length'))
        index = end


def _entry(message: Any, place: str) -> Entry:
    number = int(message.kind)
    kind = KINDS[number - 1] if 1 <= number <= len(KINDS) else ''
    if kind not in _READ:
        fault = f'expected a number from 1 to {len(KINDS)}, got {number} {kind}'
        raise DescriptionError(f'{place}.kind', fault.rstrip())
    read = _READ[kind]
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
    return name in ('final_rate_hz', 'catch_share') and value == 0.0


def _unread(kind: str, name: str, value: object) -> str:
    if name == 'seed' and kind == 'uniform_random':
        return f'expected own_seed with a seed, got {value} without'
    return f'expected nothing here, which a {kind} does not read, got {value}'


def _segment(entry: Entry, types: MessageTypes) -> Any:
    values = dict(entry)
    number = KINDS.index(values.pop('kind')) + 1
    if 'levels' in values:
        values['levels'] = array('d', values['levels'])
    if 'seed' in values:
        values['own_seed'] = True
    # numbers are of Python already: what a segment is made of has passed its bounds
    return types[SCHEDULE_SEGMENT](kind=number, **values)


def _flat(items: Items) -> Iterator[Entry]:
    for item in items:
        if isinstance(item, Repeat):
            inner = list(_flat(item.segments))
            yield {'kind': 'repeat', 'times': item.times, 'length': len(inner)}
            yield from inner
        else:
            yield segment_to_mapping(item)
