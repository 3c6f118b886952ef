# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as rpms_msgs/Schedule and back: the schema of a schedule file, its checks and bounds.

A field that a kind of segment does not read has to be zero, as a key that nobody reads is refused
in a file.  What a kind reads is taken as it stands: there is no default but for the few fields
that say so in the message.
"""

from array import array
from typing import Any

from rpms_ros.messages import MessageTypes
from rpms_ros.stimulation.description import SEGMENT_KINDS
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.stimulation.fields import bounded_names
from rpms_ros.stimulation.flat_schedule import Entry
from rpms_ros.stimulation.flat_schedule import entries_of
from rpms_ros.stimulation.flat_schedule import schedule_from_entries
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.strict_yaml import MOST_NODES

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
