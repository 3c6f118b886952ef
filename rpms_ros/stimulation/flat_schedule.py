# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as a flat list of entries, for what cannot nest into itself, as ROS messages.

An entry is what a schedule file has, but for a repetition: ``{kind: repeat, times: 3, length: 2}``
repeats the two entries that follow it.  Entries of a repetition among them count as well.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from rpms_ros.stimulation.description import DEEPEST_REPEAT
from rpms_ros.stimulation.description import built
from rpms_ros.stimulation.description import segment_from_mapping
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.stimulation.fields import as_mapping
from rpms_ros.stimulation.fields import read_bounded
from rpms_ros.stimulation.fields import read_text
from rpms_ros.stimulation.fields import refuse_unknown
from rpms_ros.stimulation.schedule import LONGEST_NAME
from rpms_ros.stimulation.schedule import Repeat
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.segment import Segment
from rpms_ros.strict_yaml import MOST_NODES
from rpms_ros.strict_yaml import join
from rpms_ros.strict_yaml import shown

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
