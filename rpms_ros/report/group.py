# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Several recordings compared: of several people, or of one person over weeks.

Their numbers with intervals, how they differ and how they spread, as one document and a figure.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import PurePath
from statistics import NormalDist
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rpms_ros.axis import QUANTITIES as QUANTITY_OF_UNIT
from rpms_ros.identification.quality.verdict import DOUBTFUL, GRADES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.figures import FAINT, MODELLED, note, style, svg_of

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Quantity:
    """A column of the table of a study that is compared.

    Attributes
    ----------
    column : str
        Its name; the ends of the interval are ``..._lower`` and ``..._upper``.
    label, unit : str
        For people.
    scale : float
        How many of `unit` a one in the column is.
    """

    column: str
    label: str
    unit: str
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


def quantities_of(rows: Iterable[Row]) -> tuple[Quantity, ...]:
    """Return the quantities of a study: torques in N m where torques were measured."""
    unit = next((str(row['unit']) for row in rows if row.get('unit')), 'N')
    if unit == 'N':
        return QUANTITIES
    what = QUANTITY_OF_UNIT.get(unit, 'force').capitalize()
    return tuple(
        replace(one, label=one.label.replace('Force', what), unit=unit) if one.unit == 'N' else one
        for one in QUANTITIES
    )


@dataclass(frozen=True)
class Measured:
    """A number with its interval, whose ends are None if there is none."""

    value: float
    lower: float | None = None
    upper: float | None = None

    @property
    def half_width(self) -> float | None:
        """Half of the interval's width; None without one."""
        if self.lower is None or self.upper is None:
            return None
        return 0.5 * (self.upper - self.lower)


@dataclass(frozen=True)
class Spread:
    """How a number spreads over recordings.

    Attributes
    ----------
    count : int
        Recordings that have it.
    mean, median, lowest, highest : float
        Over them.
    deviation : float or None
        Standard deviation of the numbers; None of fewer than two.
    between : float or None
        The part of it that the intervals of the recordings do not explain; None where fewer than
        two have intervals.
    """

    count: int
    mean: float
    median: float
    lowest: float
    highest: float
    deviation: float | None
    between: float | None


def usable(row: Row) -> bool:
    """Return whether the numbers of a recording may be used."""
    return bool(row['status'] == 'ok' and row['verdict'] != 'no')


def measured(row: Row, quantity: Quantity) -> Measured | None:
    """Return a number of a recording in its unit; None if it has none or must not be used."""
    value = row.get(quantity.column)
    if not usable(row) or value is None:
        return None
    ends = (row.get(f'{quantity.column}_{end}') for end in ('lower', 'upper'))
    scaled = (None if one is None else float(one) * quantity.scale for one in ends)
    return Measured(value * quantity.scale, *scaled)


def change(now: Measured, before: Measured) -> Measured:
    """Return how much more there is now, with the interval of two independent numbers."""
    difference = now.value - before.value
    widths = now.half_width, before.half_width
    if widths[0] is None or widths[1] is None:
        return Measured(difference)
    width = float(np.hypot(widths[0], widths[1]))
    return Measured(difference, difference - width, difference + width)


def spread_of(found: Sequence[Measured], confidence: float = 0.95) -> Spread | None:
    """Return how numbers spread; None without any.

    The spread between recordings is the moment estimate of DerSimonian and Laird (1986),
    Controlled Clinical Trials 7:177, with weights ``1 / s^2`` of the recordings' standard errors.

    Parameters
    ----------
    found : sequence of Measured
        One a recording.
    confidence : float
        Level of their intervals.
    """
    if not found:
        return None
    values = np.array([one.value for one in found])
    known = [one for one in found if one.half_width]
    return Spread(
        len(found),
        float(values.mean()),
        float(np.median(values)),
        float(values.min()),
        float(values.max()),
        float(values.std(ddof=1)) if len(values) > 1 else None,
        _between(known, confidence) if len(known) > 1 else None,
    )


def _between(found: Sequence[Measured], confidence: float) -> float:
    quantile = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    values = np.array([one.value for one in found])
    error = np.array([one.half_width for one in found], dtype=np.float64) / quantile
    weight = 1.0 / error**2
    mean = np.sum(weight * values) / np.sum(weight)
    excess = np.sum(weight * (values - mean) ** 2) - (len(values) - 1)
    scale = np.sum(weight) - np.sum(weight**2) / np.sum(weight)
    return float(np.sqrt(max(excess / scale, 0.0)))


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
        'spread': [
            {'column': one.column, 'found': _plain(spread_of(_all(rows, one), confidence))}
            for one in compared
        ],
        'changes': [_change(shown, one) for one in compared] if one_person else [],
        'remarks': _remarks(rows, one_person),
    }


def _dated(row: Row) -> bool:
    return (row.get('start_ns') or 0) >= _EARLIEST_NS


def _all(rows: Iterable[Row], quantity: Quantity) -> list[Measured]:
    return [one for row in rows if (one := measured(row, quantity)) is not None]


def _plain(found: Measured | Spread | None) -> dict[str, Any] | None:
    return None if found is None else asdict(found)


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
        'measured': {one.column: _plain(measured(row, one)) for one in QUANTITIES},
        'all': {
            name: value
            for name, value in row.items()
            if value not in (None, '') and (usable(row) or not isinstance(value, float))
        },
    }


def _change(shown: Sequence[Mapping[str, Any]], quantity: Quantity) -> dict[str, Any]:
    """Return the newest number, and how much more it is than the last and the first one."""
    known = [
        (one, Measured(**one['measured'][quantity.column]))
        for one in shown
        if one['measured'][quantity.column]
    ]
    now = known[-1][1] if known else None
    told: dict[str, Any] = {'column': quantity.column, 'now': _plain(now)}
    for name, place in (('last', -2), ('first', 0)):
        told[name] = None
        if now is not None and len(known) > 1:
            before, number = known[place]
            more = change(now, number)
            width = more.half_width
            # more than the intervals allow for
            beyond = None if width is None else abs(more.value) > width
            session = before['number']
            told[name] = {'session': session, 'change': asdict(more), 'beyond': beyond}
    return told


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


MARKERS = {'good': 'o', 'doubtful': 's'}
"""A full circle, and an open square for what is doubtful."""
# Names of more recordings than this cannot be read beside the points.
_MOST_NAMES = 60
_LONGEST_NAME = 28


def group_figure(document: Mapping[str, Any]) -> bytes:
    """Return the figure as SVG: over the dates of one person, or one line a recording.

    Parameters
    ----------
    document : mapping
        As `group_document` makes it.
    """
    with style():
        draw = _over_dates if document['one_person'] else _by_recording
        return svg_of(draw(document))


def _over_dates(document: Mapping[str, Any]) -> Figure:
    recordings = document['recordings']
    days = [one['day'] for one in recordings]
    dated = None not in days and len(set(days)) == len(days)
    rows = -(-len(document['quantities']) // 2)
    figure = Figure(figsize=(11.0, 2.8 * rows), layout='constrained')
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False)
    at = [one['day'] if dated else one['number'] for one in recordings]
    for place in axes.flat[len(document['quantities']) :]:
        place.axis('off')
    for place, quantity in zip(axes.flat, document['quantities'], strict=False):
        _points(place, recordings, quantity['column'], at, vertical=True)
        place.set(title=quantity['label'], ylabel=quantity['unit'])
        place.tick_params(labelbottom=True)
    for place in axes[-1]:
        place.set_xlabel('days after the first session' if dated else 'session')
        if not dated:
            place.xaxis.set_major_locator(MaxNLocator(integer=True))
    if at:
        margin = 0.05 * max(max(at) - min(at), 1.0)
        axes[0, 0].set_xlim(min(at) - margin, max(at) + margin)
    return figure


def _by_recording(document: Mapping[str, Any]) -> Figure:
    recordings = document['recordings']
    count = len(recordings)
    named = count <= _MOST_NAMES
    figure = Figure(figsize=(11.0, 1.4 + (0.26 if named else 0.06) * count), layout='constrained')
    axes = figure.subplots(1, len(document['quantities']), sharey=True, squeeze=False)[0]
    at = [one['number'] for one in recordings]
    for place, quantity, spread in zip(
        axes, document['quantities'], document['spread'], strict=True
    ):
        _points(place, recordings, quantity['column'], at, vertical=False)
        if spread['found']:
            place.axvline(spread['found']['mean'], color=FAINT, ls='--', lw=1.0)
        place.set(title=quantity['label'], xlabel=quantity['unit'])
    axes[0].set_ylim(count + 0.7, 0.3)
    if named:
        axes[0].set_yticks(at, [_name(one) for one in recordings])
    else:
        axes[0].set_ylabel('number in the table')
    return figure


def _name(one: Mapping[str, Any]) -> str:
    """Return a short name in which matplotlib sees no formula."""
    name = ''.join(letter if letter.isprintable() else '?' for letter in one['name'])
    return f'{one["number"]}  {name[:_LONGEST_NAME]}'.replace('$', r'\$')


def _points(
    place: Axes,
    recordings: Sequence[Mapping[str, Any]],
    column: str,
    at: Sequence[float],
    vertical: bool,
) -> None:
    """Draw numbers with their intervals, those of good recordings full."""
    known = [
        (one['verdict'] == 'good', position, one['measured'][column])
        for one, position in zip(recordings, at, strict=True)
        if one['measured'][column] is not None
    ]
    for good in (True, False):
        chosen = [(position, found) for grade, position, found in known if grade is good]
        if not chosen:
            continue
        points = np.array([(position, found['value']) for position, found in chosen]).T
        widths = np.array([_widths(found) for _, found in chosen]).T
        across, up = points if vertical else points[::-1]
        place.errorbar(
            across,
            up,
            yerr=widths if vertical else None,
            xerr=None if vertical else widths,
            fmt=MARKERS['good' if good else 'doubtful'],
            color=MODELLED,
            mfc=MODELLED if good else 'white',
            ms=4.5,
            capsize=3,
            lw=1.0,
        )
    if vertical and len(known) > 1:
        path = [(position, found['value']) for _, position, found in known]
        place.plot(*zip(*path, strict=True), color=FAINT, lw=0.8, zorder=1)
    if not known:
        note(place, 'in no recording')


def _widths(found: Mapping[str, float | None]) -> tuple[float, float]:
    """Return how far an interval reaches below and above; not a number without one."""
    value, lower, upper = found['value'], found['lower'], found['upper']
    if value is None or lower is None or upper is None:
        return float('nan'), float('nan')
    return max(value - lower, 0.0), max(upper - value, 0.0)
