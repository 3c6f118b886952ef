# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of a study: one HTML file that needs nothing else.

The figure of a study: each number of each recording with its interval.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rpms_ros.printable import counted
from rpms_ros.report.session.figures import style
from rpms_ros.report.session.page import UNKNOWN, image_url, number, page_template, shipped
from rpms_ros.report.text import with_interval

MARKERS = {'good': 'o', 'doubtful': 's'}
"""A full circle, and an open square for what is doubtful."""
_INK, _FAINT = '#000000', '#6e6e6e'
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
    file = BytesIO()
    with style():
        figure = _over_dates(document) if document['one_person'] else _by_recording(document)
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


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
        place.set_title(quantity['label'])
        place.set_ylabel(quantity['unit'])
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
            place.axvline(spread['found']['mean'], color=_FAINT, ls='--', lw=1.0)
        place.set_title(quantity['label'])
        place.set_xlabel(quantity['unit'])
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
        positions = np.array([position for position, _ in chosen])
        values = np.array([found['value'] for _, found in chosen])
        widths = np.array([_widths(found) for _, found in chosen]).T
        place.errorbar(
            positions if vertical else values,
            values if vertical else positions,
            yerr=widths if vertical else None,
            xerr=None if vertical else widths,
            fmt=MARKERS['good' if good else 'doubtful'],
            color=_INK,
            mfc=_INK if good else 'white',
            ms=4.5,
            capsize=3,
            lw=1.0,
        )
    if vertical and len(known) > 1:
        path = [(position, found['value']) for _, position, found in known]
        place.plot(*zip(*path, strict=True), color=_FAINT, lw=0.8, zorder=1)
    if not known:
        place.text(
            0.5, 0.5, 'in no recording', ha='center', va='center', transform=place.transAxes
        )


def _widths(found: Mapping[str, float | None]) -> tuple[float, float]:
    """Return how far an interval reaches below and above; not a number without one."""
    value, lower, upper = found['value'], found['lower'], found['upper']
    if value is None or lower is None or upper is None:
        return float('nan'), float('nan')
    return max(value - lower, 0.0), max(upper - value, 0.0)


_HERE = Path(__file__).parent


def as_group_page(document: Mapping[str, Any], folder: Path) -> str:
    """Return the page.

    Parameters
    ----------
    document : mapping
        As `group_document` makes it.
    folder : Path
        Where the page goes: links are relative to it.
    """
    template = page_template(_HERE, number=number, stated=stated, counted=counted)
    return template.render(
        document,
        # all numbers stand in the details and in results.csv already
        compact={
            **document,
            'recordings': [
                {name: value for name, value in one.items() if name != 'all'}
                for one in document['recordings']
            ],
        },
        unknown=UNKNOWN,
        file=lambda name: shipped(_HERE.parent / name),
        image=image_url(group_figure(document)),
        link=lambda path: link(path, folder),
    )


def link(path: str, folder: Path) -> str:
    """Return a link from the page in a folder to a path; never another scheme."""
    return f'./{quote(relpath(Path(path).resolve(), folder.resolve()))}'


def stated(found: Mapping[str, float | None] | None, sign: bool = False) -> str:
    """Return a number with its interval as text."""
    if found is None:
        return UNKNOWN
    if not sign:
        return with_interval(found)
    text = format(found['value'], '+.3g')
    if found['lower'] is None or found['upper'] is None:
        return text
    return f'{text} ({found["lower"]:+.3g} to {found["upper"]:+.3g})'
