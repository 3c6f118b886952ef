# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of a session: each of its report, and all of them as one.

Measured is thick and grey, true thick, grey and dashed, modelled thin and black, limits are
dashed, bands light with an edge: distinguished by shade, width and style, not by hue.  Over time
sudden changes are dotted lines with their kind, and spans with a doubt or a fault are hatched.

The panels of the one figure are those of the paper's Figs. 13 (and 15), 14, 16 and 17, and the
force over time.

Smooth functions cannot be zero until the muscle responds and then rise: before that they
oscillate around zero, and data in which pulses follow one another closely hardly contradict them.
So a fitted response to one pulse is not determined before its last change of sign ahead of the
peak.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, PulseTrain
from rpms_ros.report.analysis_figures import draw_trains, save_figure
from rpms_ros.report.course import Course, TimeCourse, course_of
from rpms_ros.report.dose import Dose, dose_of
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.residuals import ResidualAnalysis
from rpms_ros.report.result import impulse_response
from rpms_ros.report.session_report import SessionReport

MEASURED, MODELLED, BAND, FAINT = '#a0a0a0', '#000000', '#dcdcdc', '#6e6e6e'
# Smaller oscillations, as a share of the peak, are not visible in a figure.
_SEEN = 2e-3
# How much of the force is shown [s].
_SHOWN = 4.0
# More marks, or points in a line, than this are not distinguishable in print.
_MOST_MARKS, _MOST_POINTS = 1000, 2000


def begin_of_response(force: FloatArray) -> int:
    """Return from which sample on a response (times,) is determined; 0 if all of it is.

    Parameters
    ----------
    force : ndarray, shape (times,)
        Force after one pulse [N].
    """
    peak = int(np.argmax(force))
    top = float(force[peak])
    if not top > 0.0:
        return 0
    below = np.flatnonzero(force[:peak] <= 0.0)
    begin = int(below[-1]) if len(below) else 0
    return begin if np.abs(force[: begin + 1]).max(initial=0.0) > _SEEN * top else 0


def draw_recruitment(
    axes: list[Axes], session: IdentifiedSession, dose: Dose, truth: KnownMuscle | None = None
) -> None:
    """Draw the recruitment curve with its band, the true one and the intensities used."""
    (place,), last = axes, session.last
    place.set(title=f'Recruitment at {last.repetition_rate:g} Hz', xlim=(0.0, 1.0))
    place.set(xlabel='intensity / share of maximum', ylabel=f'steady mean {quantity(last.unit)}')
    intensity = last.curve_intensity
    if truth is not None and truth.comparable(last):
        draw_true(place, truth.intensity, truth.curve_at(last.stamp_ns))
    if last.curve_known:
        _band(place, intensity, last.curve_lower, last.curve_upper, last.confidence)
        place.plot(intensity, last.curve_force, color=MODELLED, label='identified')
    else:
        place.set_yticks([])
        note(place, 'no curve: recruitment\nand dynamics\ncannot be told apart')
    if dose.pulses:
        share, edges = np.histogram(dose.intensities, bins=50, range=(0.0, 1.0))
        # behind the curve, which must not be hidden
        below = place.inset_axes((0.0, 0.0, 1.0, 0.14), zorder=0)
        below.bar(edges[:-1], share, width=0.02, align='edge', color='white', ec=FAINT, lw=0.5)
        below.set_xlim(0.0, 1.0)
        below.axis('off')
        place.bar(0.0, 0.0, color='white', ec=FAINT, lw=0.5, label='pulses by intensity')


def draw_response(
    axes: list[Axes],
    session: IdentifiedSession,
    force: FloatArray,
    truth: KnownMuscle | None = None,
) -> None:
    """Draw the response to one pulse, `force` (times,) [N], with its band and the true one.

    The response before it is determined (`begin_of_response`) is dotted.
    """
    (place,), last = axes, session.last
    time = 1e3 * last.response_time
    full = 'at full intensity' if last.curve_known else 'of the intensity used'
    place.set(title=f'Response to one pulse {full}', xlabel='time after the pulse / ms')
    place.set(ylabel=quantity(last.unit), xlim=(0.0, float(time[-1])))
    if truth is not None and truth.comparable(last):
        fine = np.linspace(0.0, float(time[-1]), 500)
        if (shape := truth.response(1e-3 * fine, last.stamp_ns)) is not None:
            draw_true(place, fine, shape)
    begin = begin_of_response(force)
    if last.curve_known:
        ends = last.response_lower[begin:], last.response_upper[begin:]
        _band(place, time[begin:], *ends, last.confidence)
    place.plot(time[begin:], force[begin:], color=MODELLED, label='identified')
    if begin:
        name = 'before the muscle answers: not determined'
        before = slice(0, begin + 1)
        place.plot(time[before], force[before], color=FAINT, ls=':', lw=1.2, label=name)


def draw_force(axes: list[Axes], session: IdentifiedSession, dose: Dose) -> None:
    """Draw measured and modelled force over the last seconds of stimulation."""
    time = _elapsed(session)
    end = min(float(time[-1]), float(dose.onset_s[-1]) + 0.1) if dose.pulses else float(time[-1])
    kept = (time >= end - _SHOWN) & (time <= end)
    shown = min(_SHOWN, float(np.ptp(time[kept]))) if kept.any() else 0.0
    _force_of(axes, session, kept, f'last {shown:.3g} s of stimulation')


def draw_worst(axes: list[Axes], session: IdentifiedSession) -> None:
    """Draw measured and modelled force around the largest residual."""
    time = _elapsed(session)
    error = np.where(session.usable, np.abs(session.force - session.prediction), 0.0)
    # before an estimator has settled, residuals are as large as the force
    begin = len(error) // 5
    at = time[begin + int(np.argmax(error[begin:]))]
    kept = np.abs(time - at) <= 0.5 * _SHOWN
    _force_of(axes, session, kept, f'around the largest residual, at {at:.1f} s')


def _force_of(axes: list[Axes], session: IdentifiedSession, kept: BoolArray, where: str) -> None:
    (upper, lower), unit = axes, session.last.unit
    chosen = np.flatnonzero(kept)
    chosen = chosen[:: max(1, len(chosen) // _MOST_POINTS)]
    time = _elapsed(session)[chosen]
    force, prediction = session.force[chosen], session.shown_prediction[chosen]
    upper.set(title=f'{QUANTITIES[unit].capitalize()}, {where}', ylabel=quantity(unit))
    upper.plot(time, force, color=MEASURED, lw=3.0, label='measured')
    upper.plot(time, prediction, color=MODELLED, lw=0.9, label='modelled, predicted')
    lower.plot(time, force - prediction, color=MODELLED, lw=0.7)
    lower.axhline(0.0, color=FAINT, lw=0.6)
    lower.set(ylabel=f'residual / {unit}', xlabel='time / s')


def draw_residuals(axes: list[Axes], found: ResidualAnalysis | None) -> None:
    """Draw the correlations of the residual with itself and with the pulses."""
    itself, pulses = axes
    itself.set_title('Residual with itself')
    pulses.set_title('Pulses with residual')
    if found is None:
        for place in axes:
            note(place, 'too few residuals')
        return
    auto, cross = found.autocorrelation[1:], found.cross_correlation
    _correlation(itself, found.lag_s[1:], auto, found.autocorrelation_band, 'white')
    itself.set(xlabel='lag / ms', ylabel='correlation')
    if len(cross):
        _correlation(pulses, found.cross_lag_s, cross, found.cross_correlation_band, 'independent')
    else:
        note(pulses, 'no pulses in this part')
    pulses.set_xlabel('time after the pulse / ms')


def _correlation(
    place: Axes, lag_s: FloatArray, values: FloatArray, band: float, condition: str
) -> None:
    place.plot(1e3 * lag_s, values, color=MODELLED, lw=0.9)
    place.axhline(0.0, color=FAINT, lw=0.6)
    place.axhline(band, color=FAINT, ls='--', lw=1.0, label=f'95 % if {condition}')
    place.axhline(-band, color=FAINT, ls='--', lw=1.0)


def draw_schedule(axes: list[Axes], dose: Dose) -> None:
    """Draw intensity of the pulses and their energy over time."""
    time, intensity = dose.onset_s, dose.intensities
    axes[0].set(title='Pulses and their energy', ylabel='intensity / share', ylim=(0.0, 1.05))
    axes[1].set(xlabel='time / s', ylabel='energy / pulses\nat full intensity')
    if not len(time):
        note(axes[0], 'no pulses')
        return
    # many are one picture, which is shorter in SVG than a mark for each pulse
    axes[0].plot(time, intensity, '.', color=MODELLED, ms=2.5, rasterized=len(time) > _MOST_MARKS)
    axes[1].plot(time, np.cumsum(intensity**2), color=MODELLED, lw=1.2, drawstyle='steps-post')


def _elapsed(session: IdentifiedSession) -> FloatArray:
    return (session.stamp_ns - int(session.stamp_ns[0])) / NANOSECONDS_PER_SECOND


def quantity(unit: str) -> str:
    """Return the label of an axis of force or torque by its unit."""
    return f'{QUANTITIES[unit]} / {unit}'


def draw_true(axes: Axes, x: FloatArray, y: FloatArray, name: str | None = 'true') -> None:
    """Draw true values of a simulated muscle: dashed, behind the estimate."""
    axes.plot(x, y, color=MEASURED, ls='--', lw=2.4, label=name, zorder=1.5)


def _band(
    axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, confidence: float
) -> None:
    if len(lower) and len(upper):
        label = f'{100 * confidence:g} % band'
        axes.fill_between(x, lower, upper, facecolor=BAND, edgecolor=FAINT, lw=0.6, label=label)


def note(axes: Axes, text: str) -> None:
    """Write a text in the middle of an empty panel."""
    axes.text(0.5, 0.5, text, ha='center', va='center', transform=axes.transAxes)


# True values are dashed.
_LINE_STYLES = ('-', ':', '-.')
# Smallest height of an axis: of force and time constant as a share of the value, of intensities
# and sharpness absolute.  Without it the noise of a steady muscle fills the panel.
_FORCE_SPAN, _TIME_SPAN, _INTENSITY_SPAN, _SHARPNESS_SPAN = 0.2, 0.2, 0.05, 1.0
_MARGIN = 0.08


class _Line(NamedTuple):
    name: str
    path: TimeCourse
    true: FloatArray | None


class _Panel(NamedTuple):
    """Lines over time; the axis is at least as high as `relative` to the values and `absolute`.

    It leaves out `outside` per cent of the settled values at either end.
    """

    label: str
    lines: list[_Line]
    relative: float = 0.0
    absolute: float = 0.0
    outside: float = 1.0


def course_panels(course: Course, truth: KnownMuscle | None = None) -> list[_Panel]:
    """Return the panels of a course, from above; none without a course."""
    if not course.has_course:
        return []
    last, stamps = course.estimates[-1], course.stamp_ns
    what, force = QUANTITIES[last.unit], course.force
    full = truth.curve_at(stamps)[-1] if truth is not None and truth.comparable(last) else None

    def true(name: str) -> FloatArray | None:
        return None if truth is None else truth.parameter(name, stamps)

    steady = _Line(f'steady {what}, full intensity', force, full)
    parameters = [_Line(name, course.parameter(name), true(name)) for name in last.nonlinear_names]
    thresholds = [line for line in parameters if line.name.startswith('u_')]
    sharpness = [line for line in parameters if line.name.startswith('alpha_')]
    panels = [
        _Panel(quantity(last.unit), [steady], _FORCE_SPAN),
        _Panel('intensity / share', thresholds, absolute=_INTENSITY_SPAN),
        _Panel('sharpness', sharpness, absolute=_SHARPNESS_SPAN),
    ]
    constant = course.physiology('twitch_time_constant_s')
    if np.count_nonzero(constant.known) > 1:
        known = None if truth is None else 1e3 * truth.at('time_constant', stamps)
        scaled = TimeCourse(*(1e3 * values for values in vars(constant).values()))
        panels.append(_Panel('T_a / ms', [_Line('T_a', scaled, known)], _TIME_SPAN))
    if np.count_nonzero(course.disturbance.known) > 1:
        forces = np.abs(force.value[force.known])
        span = _FORCE_SPAN * float(np.median(forces)) if len(forces) else 0.0
        effort = None if truth is None else truth.at('effort', stamps)
        line = _Line(f'{what} not caused by the stimulation', course.disturbance, effort)
        # a burst may be short: all of it is shown
        panels.append(_Panel(quantity(last.unit), [line], 0.0, span, 0.0))
    return panels


def draw_course(axes: list[Axes], course: Course, truth: KnownMuscle | None = None) -> None:
    """Draw the panels of `course_panels`, one an axes, that share their axis of time."""
    for place, panel in zip(axes, course_panels(course, truth), strict=True):
        _draw_panel(place, course, panel)
        for index, flag in enumerate(course.flags):
            named = 'doubt or fault' if place is axes[0] and not index else None
            span = place.axvspan(flag.start_s, flag.end_s, zorder=0.5, label=named)
            span.set(facecolor='none', edgecolor='#c8c8c8', hatch='///', linewidth=0.0)
        for change in course.changes:
            place.axvline(change.time_s, color=FAINT, ls=':', lw=1.4)
    top, above = axes[0], axes[0].get_xaxis_transform()
    top.set_title('Estimates during the session')
    for change in course.changes:
        top.text(change.time_s, 0.99, change.kind, transform=above, va='top', fontsize=9.0)
    axes[-1].set(xlabel='time / s', xlim=(0.0, course.end_s))


def _draw_panel(place: Axes, course: Course, panel: _Panel) -> None:
    """Draw quantities with their bands; values before the first are settled set no axis."""
    place.set_ylabel(panel.label)
    shown, inside = course.shown, course.settled
    time = course.time_s[shown]
    true_name: str | None = 'true'
    seen = []
    for line, style in zip(panel.lines, _LINE_STYLES, strict=False):
        path = line.path
        if np.isfinite(path.lower).any():
            band = path.lower[shown], path.upper[shown]
            place.fill_between(time, *band, facecolor=BAND, edgecolor=FAINT, lw=0.4)
        if line.true is not None:
            draw_true(place, time, line.true[shown], true_name)
            true_name = None
            seen.append(line.true[inside])
        place.plot(time, path.value[shown], color=MODELLED, ls=style, lw=1.2, label=line.name)
        seen += [values[inside] for values in (path.value, path.lower, path.upper)]
    found = (values[np.isfinite(values)] for values in seen)
    outside = panel.outside, 100.0 - panel.outside
    if not (ends := [np.percentile(values, outside) for values in found if len(values)]):
        return
    low, high = float(np.min(ends)), float(np.max(ends))
    least = max(panel.relative * max(abs(low), abs(high)), panel.absolute)
    height = (1 + 2 * _MARGIN) * max(high - low, least)
    middle = 0.5 * (low + high)
    if height > 0.0:
        place.set_ylim(middle - 0.5 * height, middle + 0.5 * height)


# A screen of 390 px shows no wider figure with letters of 8 px.
_WIDTH = 5.6
_RESPONSE = 'result.impulse_response.force'
FIGURES: dict[str, tuple[Callable[..., None], tuple[str, ...], float, int]] = {
    'recruitment': (draw_recruitment, ('identified', 'schedule', 'true_muscle'), 3.6, 1),
    'response': (draw_response, ('identified', _RESPONSE, 'true_muscle'), 3.6, 1),
    'parameters': (draw_course, ('course', 'true_muscle'), 0.5, 0),
    'force': (draw_force, ('identified', 'schedule'), 4.4, 2),
    'worst': (draw_worst, ('identified',), 4.4, 2),
    'residuals': (draw_residuals, ('residuals',), 4.4, 2),
    'schedule': (draw_schedule, ('schedule',), 4.4, 2),
}
"""What draws each figure, from what of a report, its height [inch] and its panels, by name."""

OF_THE_ESTIMATOR = ('parameters', 'worst', 'residuals')
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
    'legend.edgecolor': 'none',
    'legend.fontsize': 9.5,
    # Text stays text: it can be searched, copied and read aloud.
    'svg.fonttype': 'none',
    'path.simplify_threshold': 0.3,
    # ids that do not change from run to run
    'svg.hashsalt': 'rpms_ros',
}


def names_of(report: SessionReport) -> tuple[str, ...]:
    """Return the figures that a report has."""
    left_out = set(OF_THE_ESTIMATOR) if report.result.trains is not None else set()
    if not report.course.has_course:
        left_out.add('parameters')
    return tuple(name for name in FIGURES if name not in left_out)


def draw(name: str, report: SessionReport) -> Figure:
    """Return one of `FIGURES`, drawn."""
    if name == 'force' and report.result.trains is not None:
        return draw_trains(report.result.trains, unit=report.result.unit)
    painter, parts, height, rows = FIGURES[name]
    if name == 'parameters':
        rows = len(course_panels(report.course))
        height += 1.6 * rows
    figure = Figure(figsize=(_WIDTH, height), layout='constrained', dpi=150)
    # lags and times are no common axis
    axes = figure.subplots(rows, 1, sharex=name != 'residuals', squeeze=False)
    painter(list(axes.flat), *(attrgetter(part)(report) for part in parts))
    label(figure)
    return figure


def label(figure: Figure) -> None:
    """Give each panel that names its lines a legend."""
    for place in figure.axes:
        if place.get_legend_handles_labels()[0]:
            place.legend(loc='best')


def as_svg(name: str, report: SessionReport) -> bytes:
    """Return a figure as an SVG file, the same for the same session."""
    file = BytesIO()
    with style():
        # neither when nor by what it was made
        draw(name, report).savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


def write_figures(folder: Path, report: SessionReport) -> None:
    """Write all figures as PNG and SVG files.

    Raises
    ------
    ReportError
        If they cannot be written.
    """
    for name in names_of(report):
        with style():
            save_figure(draw(name, report), folder / f'{name}.png', folder / f'{name}.svg')


def style() -> AbstractContextManager[None]:
    """Draw in the style of the report."""
    return mpl.rc_context(_STYLE)


def draw_session(
    session: IdentifiedSession,
    pulses: PulseTrain,
    truth: KnownMuscle | None = None,
    title: str = '',
    trains: SummationAnalysis | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Return the figure of a session.

    Parameters
    ----------
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
    figure : Figure or None
        An empty figure to draw into; else it is a new one.
    """
    figure = figure or Figure(layout='constrained', dpi=130)
    if trains is not None:
        return draw_trains(trains, title, session.last.unit, figure)
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
        draw_force(_column(figure, beside, [1.4, 1.0]), session, dose)
        draw_recruitment([figure.add_subplot(grid[1, 0])], session, dose, truth)
        force = impulse_response(pulses, session)
        draw_response([figure.add_subplot(grid[1, 1])], session, force, truth)
        label(figure)
        figure.suptitle(title, fontsize=12)
    return figure


def _column(figure: Figure, place: SubplotSpec, heights: list[float]) -> list[Axes]:
    """Return axes one below the other, from above, that share their axis of time."""
    rows = place.subgridspec(len(heights), 1, height_ratios=heights)
    axes: list[Axes] = []
    for index in range(len(heights)):
        axes.append(figure.add_subplot(rows[index], sharex=axes[0] if axes else None))
        axes[-1].tick_params(labelbottom=index == len(heights) - 1)
    return axes
