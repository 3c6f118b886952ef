"""One figure of a session: parameter paths, force, recruitment curve, impulse response.

The panels are those of the paper's Figs. 13 (and 15), 14, 16 and 17.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.muscle import Subject
from rpms_ros.pulses import PulseTrain
from rpms_ros.report.result import impulse_response
from rpms_ros.report.session import panels
from rpms_ros.report.session.dose import dose_of
from rpms_ros.report.session.figures import label
from rpms_ros.report.session.figures import style


def draw_session(
    paths: Sequence[Path],
    session: IdentifiedSession,
    pulses: PulseTrain,
    subject: Subject | None = None,
    title: str = '',
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
    subject : Subject or None
        The true muscle, where it is known.
    title : str
        Line above the panels.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    figure = Figure(figsize=(12.0, 8.4), layout='constrained', dpi=130)
    fill_session_figure(figure, session, pulses, subject, title)
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
    subject: Subject | None = None,
    title: str = '',
) -> None:
    """Draw a session into an empty figure; parameters as of `draw_session`."""
    dose = dose_of(pulses, int(session.stamp_ns[0]))
    with style():
        grid = figure.add_gridspec(4, 2, height_ratios=(1.0, 1.0, 1.4, 0.6))
        columns = []
        for column in (0, 1):
            upper = figure.add_subplot(grid[0, column])
            # One estimate has no path: its panels are parameters of different units.
            paths = column == 1 or len(session.estimates) > 1
            lower = figure.add_subplot(grid[1, column], sharex=upper if paths else None)
            columns.append([upper, lower])
            upper.tick_params(labelbottom=not paths)
        panels.draw_parameters(columns[0], session, subject)
        panels.draw_force(columns[1], session, dose)
        panels.draw_recruitment(figure.add_subplot(grid[2:, 0]), session, dose, subject)
        force = impulse_response(pulses, session.last)
        panels.draw_response(figure.add_subplot(grid[2:, 1]), session, force, subject)
        label(figure)
        figure.suptitle(title, fontsize=12)
