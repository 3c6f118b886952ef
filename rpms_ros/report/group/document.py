# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Content of the page of a study, as one document."""

from collections import Counter
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC
from datetime import datetime
from pathlib import PurePath
from typing import Any

from rpms_ros.identification.verdict_settings import DOUBTFUL
from rpms_ros.identification.verdict_settings import GRADES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.group.measured import QUANTITIES
from rpms_ros.report.group.measured import Measured
from rpms_ros.report.group.measured import Quantity
from rpms_ros.report.group.measured import Row
from rpms_ros.report.group.measured import change
from rpms_ros.report.group.measured import measured
from rpms_ros.report.group.measured import quantities_of
from rpms_ros.report.group.measured import spread_of
from rpms_ros.report.group.measured import usable

# The year 2000: stamps before are those of a clock that began with the machine or the trial.
_EARLIEST_NS = 946_684_800 * NANOSECONDS_PER_SECOND
_DAY_NS = 86_400 * NANOSECONDS_PER_SECOND
FAILED = 'failed'


def group_document(rows: Sequence[Row], title: str, one_person: bool) -> dict[str, Any]:
    """Return the content of the page.

    Parameters
    ----------
    rows : sequence of mapping
        Rows of the table of the study.
    title : str
        Headline.
    one_person : bool
        Whether the recordings are sessions of one person: then they are ordered by their dates,
        and changes are stated; else their spread.
    """
    if one_person and all(_dated(row) for row in rows):
        rows = sorted(rows, key=lambda row: int(row['start_ns']))
    first_ns = min((int(row['start_ns']) for row in rows if _dated(row)), default=0)
    quantities = quantities_of(rows)
    compared = [one for one in quantities if any(measured(row, one) for row in rows)]
    compared = compared or list(quantities)
    shown = [_shown(index, row, first_ns) for index, row in enumerate(rows, 1)]
    counts = Counter(one['verdict'] for one in shown)
    confidence = next((row['confidence'] for row in rows if row.get('confidence')), 0.95)
    return {
        'title': title,
        'one_person': one_person,
        'confidence': confidence,
        'doubtful': [one['name'] for one in shown if one['verdict'] == DOUBTFUL],
        'verdicts': {grade: counts[grade] for grade in (*GRADES, FAILED)},
        'quantities': [asdict(one) for one in compared],
        'recordings': shown,
        'spread': [_spread(rows, one, confidence) for one in compared],
        'changes': [_change(shown, one) for one in compared] if one_person else [],
        'remarks': _remarks(rows, one_person),
    }


def _dated(row: Row) -> bool:
    return (row.get('start_ns') or 0) >= _EARLIEST_NS


def _shown(index: int, row: Row, first_ns: int) -> dict[str, Any]:
    """Return a recording as the page shows it, without numbers that must not be used."""
    good = row['status'] == 'ok'
    date = None
    day = None
    if _dated(row):
        day = (int(row['start_ns']) - first_ns) / _DAY_NS
        seconds = int(row['start_ns']) // NANOSECONDS_PER_SECOND
        date = f'{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M}'
    return {
        'number': index,
        'name': PurePath(row['recording']).name or row['recording'],
        'path': row['recording'],
        'report': row.get('report'),
        'date': date,
        'day': day,
        'verdict': row['verdict'] if good else FAILED,
        'reasons': row['reasons'] if good else row['reason'],
        'measured': {one.column: _plain(measured(row, one)) for one in QUANTITIES},
        'all': {
            name: value
            for name, value in row.items()
            if value not in (None, '') and (usable(row) or not isinstance(value, float))
        },
    }


def _plain(found: Measured | None) -> dict[str, float | None] | None:
    return None if found is None else asdict(found)


def _spread(rows: Iterable[Row], quantity: Quantity, confidence: float) -> dict[str, Any]:
    found = [one for row in rows if (one := measured(row, quantity)) is not None]
    spread = spread_of(found, confidence)
    return {'column': quantity.column, 'found': asdict(spread) if spread else None}


def _change(shown: Sequence[Mapping[str, Any]], quantity: Quantity) -> dict[str, Any]:
    """Return the newest number, and how much more it is than the last and the first one."""
    known = [
        (one, Measured(**one['measured'][quantity.column]))
        for one in shown
        if one['measured'][quantity.column]
    ]
    empty: dict[str, Any] = {'column': quantity.column, 'now': None, 'last': None, 'first': None}
    if not known:
        return empty
    _, now = known[-1]
    told = {**empty, 'now': asdict(now)}
    if len(known) > 1:
        told |= {
            name: {
                'session': before['number'],
                'change': asdict(change(now, number)),
                'beyond': _beyond(change(now, number)),
            }
            for name, (before, number) in (('last', known[-2]), ('first', known[0]))
        }
    return told


def _beyond(found: Measured) -> bool | None:
    """Return whether a change is more than the intervals allow for; None without intervals."""
    if found.lower is None or found.upper is None:
        return None
    return found.lower > 0.0 or found.upper < 0.0


def _has_time_constant(row: Row) -> bool:
    return usable(row) and row.get('twitch_time_constant_s') is not None


def _remarks(rows: Sequence[Row], one_person: bool) -> list[str]:
    remarks = []
    names: dict[str, list[str]] = {}
    for row in rows:
        if found := row.get('session_hash'):
            names.setdefault(found, []).append(row['recording'])
    remarks += [
        f'{", ".join(same)} hold the same pulses and forces: they count more than once.'
        for same in names.values()
        if len(same) > 1
    ]
    # None is the twitch of an identified response.
    models = {row.get('train_model') for row in rows if _has_time_constant(row)}
    if len(models) > 1:
        told = ', '.join(sorted(name or 'response to one pulse' for name in models))
        remarks.append(
            f'T_a is that of different models ({told}), which do not measure the same: compare '
            'it within one (column train_model).'
        )
    if one_person and not all(_dated(row) for row in rows):
        remarks.append('Not every session has a date: they stand in the order that was given.')
    return remarks
