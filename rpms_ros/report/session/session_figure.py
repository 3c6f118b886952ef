# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One figure of a session: time courses, force, recruitment curve, impulse response.

The panels are those of the paper's Figs. 13 (and 15), 14, 16 and 17, and the force over time.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.pulses import PulseTrain
from rpms_ros.report.analysis_figures import fill_train_figure
from rpms_ros.report.course import course_of
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.result import impulse_response
from rpms_ros.report.session import figures
from rpms_ros.report.session.dose import dose_of
from rpms_ros.report.session.figures import course_panels, draw_course, label, style


def draw_session(
    paths: Sequence[Path],
    session: IdentifiedSession,
    pulses: PulseTrain,
    truth: KnownMuscle | None = None,
    title: str = '',
    trains: SummationAnalysis | None = None,
) -> None:
    """Write the figure of a session; the ending of each path names a format.

    Parameters
    ----------
    paths : sequence of Path
        Files to write.
    session : IdentifiedSession
        Estimates and traces.
    pulses : PulseTrain
        Pulses of the session.
    truth : KnownMuscle or None
        The true muscle, where it is known; dashed.
    title : str
        Line above the panels.
    trains : SummationAnalysis or None
        Trains of one intensity, which are drawn instead: the estimator takes their pulses for
        equal and tells neither parameters nor a curve.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    figure = Figure(figsize=(12.0, 8.4), layout='constrained', dpi=130)
    fill_session_figure(figure, session, pulses, truth, title, trains)
    with style():
        for path in paths:
            try:
                figure.savefig(path)
            except (OSError, ValueError) as error:
                raise ReportError(f'expected to write a figure to {path}, got {error}') from error


def fill_session_figure(
    figure: Figure,
    session: IdentifiedSession,
    pulses: PulseTrain,
    truth: KnownMuscle | None = None,
    title: str = '',
    trains: SummationAnalysis | None = None,
) -> None:
    """Draw a session into an empty figure; parameters as of `draw_session`."""
    if trains is not None:
        fill_train_figure(figure, trains, title, session.last.unit)
        return
    dose = dose_of(pulses, int(session.stamp_ns[0]))
    course = course_of(session)
    rows = len(course_panels(course)) or 2
    figure.set_size_inches(12.0, 6.2 + 1.1 * rows)
    with style():
        grid = figure.add_gridspec(2, 2, height_ratios=(1.1 * rows, 4.4))
        # one estimate of everything has no course: the force takes its place
        if course.has_course:
            draw_course(_column(figure, grid[0, 0], [1.0] * rows), course, truth)
        beside = grid[0, 1] if course.has_course else grid[0, :]
        figures.draw_force(_column(figure, beside, [1.4, 1.0]), session, dose)
        figures.draw_recruitment(figure.add_subplot(grid[1, 0]), session, dose, truth)
        force = impulse_response(pulses, session)
        figures.draw_response(figure.add_subplot(grid[1, 1]), session, force, truth)
        label(figure)
        figure.suptitle(title, fontsize=12)


def _column(figure: Figure, place: SubplotSpec, heights: list[float]) -> list[Axes]:
    """Return axes one below the other, from above, that share their axis of time."""
    rows = place.subgridspec(len(heights), 1, height_ratios=heights)
    axes: list[Axes] = []
    for index in range(len(heights)):
        axes.append(figure.add_subplot(rows[index], sharex=axes[0] if axes else None))
        axes[-1].tick_params(labelbottom=index == len(heights) - 1)
    return axes
