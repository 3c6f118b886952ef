# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of a report, in black and grey with different line styles."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpms_ros.errors import ReportError
from rpms_ros.report.analysis_figures import draw_trains
from rpms_ros.report.session import panels
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.course_panels import course_panels
from rpms_ros.report.session.course_panels import draw_course

Draw = Callable[[list[Axes], SessionAnalysis], None]

# A screen of 390 px shows no wider figure with letters of 8 px.
_WIDTH = 5.6
FIGURES: dict[str, tuple[Draw, float, int]] = {
    'recruitment': (
        lambda axes, one: panels.draw_recruitment(axes[0], one.session, one.dose, one.truth),
        3.6,
        1,
    ),
    'response': (
        lambda axes, one: panels.draw_response(
            axes[0], one.session, one.result.impulse_response.force, one.truth
        ),
        3.6,
        1,
    ),
    'parameters': (lambda axes, one: draw_course(axes, one.course, one.truth), 0.5, 0),
    'force': (lambda axes, one: panels.draw_force(axes, one.session, one.dose), 4.4, 2),
    'residuals': (lambda axes, one: panels.draw_residuals(axes, one.residuals), 4.4, 2),
    'held_out': (
        lambda axes, one: panels.draw_held_out(axes, one.session, one.held_out),
        4.4,
        2,
    ),
    'schedule': (lambda axes, one: panels.draw_schedule(axes, one.dose), 4.4, 2),
}
"""How each figure is drawn, its height [inch] and its panels, by name; a course has its own."""

OF_THE_ESTIMATOR = ('parameters', 'residuals', 'held_out')
"""Those that have no meaning where trains stand for the estimate."""

_STYLE: dict[Any, Any] = {
    'font.size': 10.0,
    'font.family': ['DejaVu Sans'],
    'axes.titlesize': 10.5,
    'axes.titleweight': 'bold',
    'axes.titlelocation': 'left',
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.linewidth': 0.7,
    'grid.color': '#d8d8d8',
    'grid.linewidth': 0.6,
    'axes.grid': True,
    'axes.axisbelow': True,
    'legend.frameon': False,
    'legend.fontsize': 9.5,
    # Text stays text: it can be searched, copied and read aloud.
    'svg.fonttype': 'none',
    'path.simplify': True,
    'path.simplify_threshold': 0.3,
    # ids that do not change from run to run
    'svg.hashsalt': 'rpms_ros',
}


def names_of(analysis: SessionAnalysis) -> tuple[str, ...]:
    """Return the figures that a report has."""
    left_out = set(OF_THE_ESTIMATOR) if analysis.trains is not None else set()
    if not analysis.course.has_course:
        left_out.add('parameters')
    return tuple(name for name in FIGURES if name not in left_out)


def draw(name: str, analysis: SessionAnalysis) -> Figure:
    """Return one of `FIGURES`, drawn."""
    if name == 'force' and analysis.trains is not None:
        return draw_trains(analysis.trains, unit=analysis.result.unit)
    painter, height, rows = FIGURES[name]
    if name == 'parameters':
        rows = len(course_panels(analysis.course))
        height += 1.6 * rows
    figure = Figure(figsize=(_WIDTH, height), layout='constrained', dpi=150)
    # lags and times are no common axis
    axes = figure.subplots(rows, 1, sharex=name != 'residuals', squeeze=False)
    painter(list(axes.flat), analysis)
    label(figure)
    return figure


def label(figure: Figure) -> None:
    """Give each panel that names its lines a legend."""
    for place in figure.axes:
        if place.get_legend_handles_labels()[0]:
            place.legend(loc='best')


def as_svg(name: str, analysis: SessionAnalysis) -> bytes:
    """Return a figure as an SVG file, the same for the same session."""
    file = BytesIO()
    with style():
        draw(name, analysis).savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


def write_figures(folder: Path, analysis: SessionAnalysis) -> list[Path]:
    """Write all figures as PNG and SVG files; return their paths.

    Raises
    ------
    ReportError
        If they cannot be written.
    """
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in names_of(analysis):
            with style():
                figure = draw(name, analysis)
                for ending in ('png', 'svg'):
                    written.append(folder / f'{name}.{ending}')
                    figure.savefig(written[-1])
    except OSError as error:
        raise ReportError(f'expected to write figures into {folder}, got {error}') from error
    return written


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of the report."""
    with mpl.rc_context(_STYLE):
        yield
