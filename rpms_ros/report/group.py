# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings compared: of several people, or of one person over weeks.

Their numbers with intervals, how they differ and how they spread, as one document and a figure.
A number with its interval is a mapping of ``value``, ``lower`` and ``upper``, whose ends are None
if there is no interval.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rpms_ros.axis import QUANTITIES as QUANTITY_OF_UNIT
from rpms_ros.identification.quality.verdict import DOUBTFUL, GRADES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.figures import FAINT, MODELLED, note, style, svg_of

Row = Mapping[str, Any]
Measured = dict[str, float | None]


class Quantity(NamedTuple):
    """A column of the table of a study that is compared, with its name and unit for people."""

    column: str
    label: str
    unit: str
    # how many of the unit a one in the column is
    scale: float = 1.0


_TIME_CONSTANT = Quantity('twitch_time_constant_s', 'T_a', 'ms', 1e3)
QUANTITIES = (
    Quantity('u_thr', 'Threshold', '%', 100.0),
    Quantity('steady_force_50', 'Force at 50 %', 'N'),
    Quantity('steady_force_100', 'Force at 100 %', 'N'),
    _TIME_CONSTANT,
    Quantity('train_peak_force', 'Peak of trains', 'N'),
)
"""Those that no recording has are left out of a page."""
# The year 2000: stamps before are those of a clock that began with the machine or the trial.
_EARLIEST_NS = 946_684_800 * NANOSECONDS_PER_SECOND
_DAY_NS = 86_400 * NANOSECONDS_PER_SECOND
FAILED = 'failed'


def _in_unit(quantity: Quantity, unit: str) -> Quantity:
    """Return a quantity as it is called where a torque was measured."""
    if unit == 'N' or quantity.unit != 'N':
        return quantity
    what = QUANTITY_OF_UNIT.get(unit, 'force').capitalize()
    return quantity._replace(label=quantity.label.replace('Force', what), unit=unit)


def usable(row: Row) -> bool:
    """Return whether the numbers of a recording may be used."""
    return bool(row['status'] == 'ok' and row['verdict'] != 'no')


def measured(row: Row, quantity: Quantity) -> Measured | None:
    """Return a number of a recording in its unit; None if it has none or must not be used."""
    if not usable(row) or row.get(quantity.column) is None:
        return None
    found = {end: row.get(f'{quantity.column}{end}') for end in ('', '_lower', '_upper')}
    return {
        end[1:] or 'value': None if one is None else one * quantity.scale
        for end, one in found.items()
    }


def half_width(one: Measured) -> float:
    """Return half of the width of an interval, NaN without one."""
    ends = [one['upper'], one['lower']]
    upper, lower = (float('nan') if end is None else end for end in ends)
    return 0.5 * (upper - lower)


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
    unit = next((str(row['unit']) for row in rows if row.get('unit')), 'N')
    known = [one for one in QUANTITIES if any(measured(row, one) for row in rows)] or QUANTITIES
    compared = [_in_unit(one, unit) for one in known]
    shown = [_shown(index, row, first_ns) for index, row in enumerate(rows, 1)]
    counts = Counter(one['verdict'] for one in shown)
    return {
        'title': title,
        'one_person': one_person,
        'confidence': next((row['confidence'] for row in rows if row.get('confidence')), 0.95),
        'doubtful': [one['name'] for one in shown if one['verdict'] == DOUBTFUL],
        'verdicts': {grade: counts[grade] for grade in (*GRADES, FAILED)},
        'quantities': [one._asdict() for one in compared],
        'recordings': shown,
        'spread': [_spread(rows, one) for one in compared],
        'changes': [_change(shown, one.column) for one in compared] if one_person else [],
        'remarks': _remarks(rows, one_person),
    }


def _dated(row: Row) -> bool:
    return (row.get('start_ns') or 0) >= _EARLIEST_NS


def _spread(rows: Iterable[Row], quantity: Quantity) -> dict[str, Any] | None:
    """Return how a number spreads over recordings, None where none has it."""
    values = np.array([one['value'] for row in rows if (one := measured(row, quantity))])
    if not len(values):
        return None
    return {
        'count': len(values),
        'mean': float(values.mean()),
        'median': float(np.median(values)),
        'lowest': float(values.min()),
        'highest': float(values.max()),
        'deviation': float(values.std(ddof=1)) if len(values) > 1 else None,
    }


def _shown(index: int, row: Row, first_ns: int) -> dict[str, Any]:
    """Return a recording as the page shows it, without numbers that must not be used."""
    good, dated = row['status'] == 'ok', _dated(row)
    start_ns = int(row['start_ns']) if dated else first_ns
    begun = datetime.fromtimestamp(start_ns // NANOSECONDS_PER_SECOND, UTC)
    return {
        'number': index,
        'name': PurePath(row['recording']).name or row['recording'],
        'path': row['recording'],
        'report': row.get('report'),
        'date': f'{begun:%Y-%m-%d %H:%M}' if dated else None,
        'day': (start_ns - first_ns) / _DAY_NS if dated else None,
        'verdict': row['verdict'] if good else FAILED,
        'reasons': row['reasons'] if good else row['reason'],
        'measured': {one.column: measured(row, one) for one in QUANTITIES},
        'all': {
            name: value
            for name, value in row.items()
            if value not in (None, '') and (usable(row) or not isinstance(value, float))
        },
    }


def _change(shown: Sequence[Mapping[str, Any]], column: str) -> dict[str, Any]:
    """Return the newest number, and how much more it is than the last and the first one."""
    known = [one for one in shown if one['measured'][column]]
    told: dict[str, Any] = dict.fromkeys(('now', 'last', 'first'))
    if not known:
        return told
    told['now'] = now = known[-1]['measured'][column]
    for name, before in zip(('last', 'first'), (known[-2:-1], known[:-1][:1]), strict=True):
        for one in before:
            earlier = one['measured'][column]
            more = now['value'] - earlier['value']
            # of two independent numbers
            width = float(np.hypot(half_width(now), half_width(earlier)))
            ends = {'lower': more - width, 'upper': more + width}
            told[name] = {
                'session': one['number'],
                'change': {'value': more, **(ends if width >= 0 else dict.fromkeys(ends))},
                # more than the intervals allow for
                'beyond': abs(more) > width if width >= 0 else None,
            }
    return told


def _remarks(rows: Sequence[Row], one_person: bool) -> list[str]:
    names: dict[str, list[str]] = {}
    for row in rows:
        if found := row.get('session_hash'):
            names.setdefault(found, []).append(row['recording'])
    remarks = [
        f'{", ".join(same)} hold the same pulses and forces: they count more than once.'
        for same in names.values()
        if len(same) > 1
    ]
    # None is the twitch of an identified response.
    models = {row.get('train_model') for row in rows if measured(row, _TIME_CONSTANT)}
    if len(models) > 1:
        told = ', '.join(sorted(name or 'response to one pulse' for name in models))
        remarks.append(
            f'T_a is that of different models ({told}), which do not measure the same: compare '
            'it within one (column train_model).'
        )
    if one_person and not all(_dated(row) for row in rows):
        remarks.append('Not every session has a date: they stand in the order that was given.')
    return remarks


def group_figure(document: Mapping[str, Any]) -> bytes:
    """Return each number with its interval as SVG: over the dates of one person, or side by side.

    Parameters
    ----------
    document : mapping
        As `group_document` makes it.
    """
    recordings, quantities = document['recordings'], document['quantities']
    days = [one['day'] for one in recordings]
    dated = document['one_person'] and None not in days and len(set(days)) == len(days)
    at = [one['day'] if dated else one['number'] for one in recordings]
    rows = -(-len(quantities) // 2)
    with style():
        figure = Figure(figsize=(11.0, 2.8 * rows), layout='constrained')
        axes = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for place in axes.flat[len(quantities) :]:
            place.axis('off')
        panels = zip(axes.flat, quantities, document['spread'], strict=False)
        for place, quantity, spread in panels:
            _points(place, recordings, quantity['column'], at, document['one_person'])
            if spread and not document['one_person']:
                place.axhline(spread['mean'], color=FAINT, ls='--', lw=1.0)
            place.set(title=quantity['label'], ylabel=quantity['unit'])
            place.tick_params(labelbottom=True)
        for place in axes[-1]:
            place.set_xlabel('days after the first session' if dated else 'number in the table')
            if not dated:
                place.xaxis.set_major_locator(MaxNLocator(integer=True))
        if at:
            margin = 0.05 * max(max(at) - min(at), 1.0)
            axes[0, 0].set_xlim(min(at) - margin, max(at) + margin)
        return svg_of(figure)


def _points(
    place: Axes,
    recordings: Sequence[Mapping[str, Any]],
    column: str,
    at: Sequence[float],
    joined: bool,
) -> None:
    """Draw numbers with their intervals: full circles, or open squares for what is doubtful."""
    known = [
        (position, one['measured'][column], one['verdict'] == 'good')
        for one, position in zip(recordings, at, strict=True)
        if one['measured'][column]
    ]
    for good, marker, fill in ((True, 'o', MODELLED), (False, 's', 'white')):
        chosen = [(position, one) for position, one, grade in known if grade is good]
        if chosen:
            place.errorbar(
                [position for position, _ in chosen],
                [one['value'] for _, one in chosen],
                np.abs([_reach(one) for _, one in chosen]).T,
                fmt=marker,
                color=MODELLED,
                mfc=fill,
                ms=4.5,
                capsize=3,
                lw=1.0,
            )
    if joined and len(known) > 1:
        path = [(position, one['value']) for position, one, _ in known]
        place.plot(*zip(*path, strict=True), color=FAINT, lw=0.8, zorder=1)
    if not known:
        note(place, 'in no recording')


def _reach(one: Measured) -> tuple[float, float]:
    """Return how far an interval reaches below and above; not a number without one."""
    value, lower, upper = one['value'], one['lower'], one['upper']
    if value is None or lower is None or upper is None:
        return float('nan'), float('nan')
    return value - lower, upper - value
