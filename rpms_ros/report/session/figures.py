# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of a report, in black and grey with different line styles.

Panels of each figure of a report.

Measured is thick and grey, true thick, grey and dashed, modelled thin and black, limits are
dashed, bands light with an edge: distinguished by shade, width and style, not by hue.

Panels of the quantities over time.

Sudden changes are dotted lines with their kind, spans with a doubt or a fault are hatched, true
values of a simulated muscle dashed.

From which time on a fitted response to one pulse is determined by the data.

Smooth functions cannot be zero until the muscle responds and then rise:
before that they oscillate around zero, and data in which pulses follow one another closely
hardly contradict them.  So the response before its last change of sign ahead of the peak is not
determined.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray
from rpms_ros.report.analysis_figures import draw_trains
from rpms_ros.report.course import Course, TimeCourse
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.dose import Dose
from rpms_ros.report.session.residuals import HeldOutFit, ResidualAnalysis

# Smaller oscillations, as a share of the peak, are not visible in a figure.
_SEEN = 2e-3


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
    swing = float(np.abs(force[: begin + 1]).max(initial=0.0))
    return begin if swing > _SEEN * top else 0


MEASURED, MODELLED, BAND, FAINT = '#a0a0a0', '#000000', '#dcdcdc', '#6e6e6e'
_SHOWN = 4.0
# More bars than this are not distinguishable in print.
_MOST_BARS = 1000
# More points than this in a line are not distinguishable either.
_MOST_POINTS = 2000


def draw_recruitment(
    place: Axes, session: IdentifiedSession, dose: Dose, truth: KnownMuscle | None = None
) -> None:
    """Draw the recruitment curve with its band, the true one and the intensities used."""
    last = session.last
    place.set_title(f'Recruitment at {last.repetition_rate:g} Hz')
    place.set_xlabel('intensity / share of maximum')
    place.set_ylabel(f'steady mean {quantity(last.unit)}')
    place.set_xlim(0.0, 1.0)
    intensity = last.curve_intensity
    if truth is not None and truth.comparable(last):
        draw_true(place, truth.intensity, truth.curve_at(last.stamp_ns))
    if last.curve_known:
        _band(place, intensity, last.curve_lower, last.curve_upper, last.confidence)
        place.plot(intensity, last.curve_force, color=MODELLED, label='identified')
    else:
        place.set_yticks([])
        _note(place, 'no curve: recruitment\nand dynamics\ncannot be told apart')
    if dose.pulses:
        share, edges = np.histogram(dose.intensities, bins=50, range=(0.0, 1.0))
        # behind the curve, which must not be hidden
        below = place.inset_axes((0.0, 0.0, 1.0, 0.14), zorder=0)
        below.bar(edges[:-1], share, width=0.02, align='edge', color='white', ec=FAINT, lw=0.5)
        below.set_xlim(0.0, 1.0)
        below.axis('off')
        place.bar(0.0, 0.0, color='white', ec=FAINT, lw=0.5, label='pulses by intensity')


def draw_response(
    place: Axes, session: IdentifiedSession, force: FloatArray, truth: KnownMuscle | None = None
) -> None:
    """Draw the response to one pulse, `force` (times,) [N], with its band and the true one.

    The response before it is determined (`begin_of_response`) is dotted.
    """
    last = session.last
    time = 1e3 * last.response_time
    full = 'at full intensity' if last.curve_known else 'of the intensity used'
    place.set_title(f'Response to one pulse {full}')
    place.set_xlabel('time after the pulse / ms')
    place.set_ylabel(quantity(last.unit))
    place.set_xlim(0.0, float(time[-1]))
    if truth is not None and truth.comparable(last):
        fine = np.linspace(0.0, float(time[-1]), 500)
        shape = truth.response(1e-3 * fine, last.stamp_ns)
        if shape is not None:
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
    time = _elapsed(session.stamp_ns, session)
    end = min(float(time[-1]), float(dose.onset_s[-1]) + 0.1) if dose.pulses else float(time[-1])
    kept = (time >= end - _SHOWN) & (time <= end)
    shown = float(time[kept][-1] - time[kept][0]) if kept.any() else 0.0
    what = QUANTITIES[session.last.unit].capitalize()
    axes[0].set_title(f'{what}, last {min(_SHOWN, shown):.3g} s of stimulation')
    _force_and_residual(
        axes, time[kept], session.force[kept], session.shown_prediction[kept], session.last.unit
    )


def draw_held_out(axes: list[Axes], session: IdentifiedSession, fit: HeldOutFit | None) -> None:
    """Draw measured and modelled force over the part that was held out."""
    if fit is None:
        _note(axes[0], 'nothing could be held out')
        return
    time = _elapsed(fit.stamp_ns, session)
    kept = time <= time[0] + _SHOWN
    shown = float(time[kept][-1] - time[0])
    axes[0].set_title(f'Held out: the first {shown:.3g} s after learning stopped')
    _force_and_residual(axes, time[kept], fit.force[kept], fit.prediction[kept], session.last.unit)


def draw_residuals(axes: list[Axes], found: ResidualAnalysis | None) -> None:
    """Draw the correlations of the residual with itself and with the pulses."""
    whiteness, cross = axes
    whiteness.set_title('Residual with itself')
    cross.set_title('Pulses with residual')
    if found is None:
        for place in axes:
            _note(place, 'too few residuals')
        return
    whiteness.plot(1e3 * found.lag_s[1:], found.autocorrelation[1:], color=MODELLED, lw=0.9)
    _limits(whiteness, found.autocorrelation_band, '95 % if white')
    whiteness.set_xlabel('lag / ms')
    whiteness.set_ylabel('correlation')
    if len(found.cross_correlation):
        cross.plot(1e3 * found.cross_lag_s, found.cross_correlation, color=MODELLED, lw=0.9)
        _limits(cross, found.cross_correlation_band, '95 % if independent')
    else:
        _note(cross, 'no pulses in this part')
    cross.set_xlabel('time after the pulse / ms')


def draw_schedule(axes: list[Axes], dose: Dose) -> None:
    """Draw intensity of the pulses and their energy over time."""
    time, intensity = dose.onset_s, dose.intensities
    axes[0].set_title('Pulses and their energy')
    axes[0].set_ylabel('intensity / share')
    axes[0].set_ylim(0.0, 1.05)
    axes[1].set_xlabel('time / s')
    axes[1].set_ylabel('energy / pulses\nat full intensity')
    if not len(time):
        _note(axes[0], 'no pulses')
        return
    if len(time) <= _MOST_BARS:
        # one line with gaps, which is shorter in SVG than a line for each pulse
        bars = np.stack([np.zeros_like(time), intensity, np.full_like(time, np.nan)], axis=1)
        axes[0].plot(np.repeat(time, 3), bars.ravel(), color=MEASURED, lw=0.6)
        axes[0].plot(time, intensity, '.', color=MODELLED, ms=2.5)
    else:
        starts = np.linspace(0, len(time), _MOST_BARS // 2, endpoint=False).astype(int)
        low = np.minimum.reduceat(intensity, starts)
        high = np.maximum.reduceat(intensity, starts)
        axes[0].fill_between(time[starts], low, high, color=MEASURED, lw=0.4, ec=MODELLED)
    axes[1].plot(time, np.cumsum(intensity**2), color=MODELLED, lw=1.2, drawstyle='steps-post')


def _force_and_residual(
    axes: list[Axes], time: FloatArray, force: FloatArray, prediction: FloatArray, unit: str
) -> None:
    upper, lower = axes
    step = max(1, len(time) // _MOST_POINTS)
    time, force, prediction = time[::step], force[::step], prediction[::step]
    upper.plot(time, force, color=MEASURED, lw=3.0, label='measured')
    upper.plot(time, prediction, color=MODELLED, lw=0.9, label='modelled, predicted')
    upper.set_ylabel(quantity(unit))
    lower.plot(time, force - prediction, color=MODELLED, lw=0.7)
    lower.axhline(0.0, color=FAINT, lw=0.6)
    lower.set_ylabel(f'residual / {unit}')
    lower.set_xlabel('time / s')


def _elapsed(stamp_ns: IntArray, session: IdentifiedSession) -> FloatArray:
    elapsed: FloatArray = (stamp_ns - session.stamp_ns[0]) / NANOSECONDS_PER_SECOND
    return elapsed


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


def _limits(axes: Axes, band: float, label: str) -> None:
    axes.axhline(0.0, color=FAINT, lw=0.6)
    axes.axhline(band, color=FAINT, ls='--', lw=1.0, label=label)
    axes.axhline(-band, color=FAINT, ls='--', lw=1.0)


def _note(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha='center', va='center', transform=axes.transAxes)


# True values are dashed.
_LINE_STYLES = ('-', ':', '-.')
_TIME_CONSTANT = 'twitch_time_constant_s'
# Smallest height of an axis: of force and time constant as a share of the value, of intensities
# and sharpness absolute.  Without it the noise of a steady muscle fills the panel.
_FORCE_SPAN, _TIME_SPAN, _INTENSITY_SPAN, _SHARPNESS_SPAN = 0.2, 0.2, 0.05, 1.0
_MARGIN = 0.08
_HATCHED = '#c8c8c8'
_OUTSIDE = 1.0

Truth = KnownMuscle | None
DrawCourse = Callable[[Axes, Course, Truth], None]


@dataclass(frozen=True)
class _Line:
    name: str
    path: TimeCourse
    true: FloatArray | None


def course_panels(course: Course) -> list[DrawCourse]:
    """Return what draws each panel of a course, from above; none without a course."""
    if not course.has_course:
        return []
    panels: list[DrawCourse] = [_draw_force, _draw_thresholds, _draw_sharpness]
    if np.count_nonzero(course.physiology(_TIME_CONSTANT).known) > 1:
        panels.append(_draw_time_constant)
    if np.count_nonzero(course.disturbance.known) > 1:
        panels.append(_draw_disturbance)
    return panels


def draw_course(axes: list[Axes], course: Course, truth: Truth = None) -> None:
    """Draw the panels of `course_panels`, one an axes, that share their axis of time."""
    for place, draw in zip(axes, course_panels(course), strict=True):
        draw(place, course, truth)
        for index, flag in enumerate(course.flags):
            named = 'doubt or fault' if place is axes[0] and not index else None
            span = place.axvspan(flag.start_s, flag.end_s, zorder=0.5, label=named)
            span.set(facecolor='none', edgecolor=_HATCHED, hatch='///', linewidth=0.0)
        for change in course.changes:
            place.axvline(change.time_s, color=FAINT, ls=':', lw=1.4)
    top = axes[0]
    top.set_title('Estimates during the session')
    for change in course.changes:
        top.annotate(
            change.kind,
            (change.time_s, 1.0),
            xycoords=('data', 'axes fraction'),
            xytext=(3, -10),
            textcoords='offset points',
            fontsize=9.0,
        )
    axes[-1].set_xlabel('time / s')
    axes[-1].set_xlim(0.0, course.end_s)


def _draw_force(place: Axes, course: Course, truth: Truth) -> None:
    last = course.estimates[-1]
    true = None
    if truth is not None and truth.comparable(last):
        true = truth.full_force(course.stamp_ns)
    what = QUANTITIES[last.unit]
    _draw_lines(
        place, course, [_Line(f'steady {what}, full intensity', course.force, true)], _FORCE_SPAN
    )
    place.set_ylabel(f'{what} / {last.unit}')


def _draw_thresholds(place: Axes, course: Course, truth: Truth) -> None:
    _draw_lines(place, course, _parameters(course, truth, 'u_'), 0.0, _INTENSITY_SPAN)
    place.set_ylabel('intensity / share')


def _draw_sharpness(place: Axes, course: Course, truth: Truth) -> None:
    _draw_lines(place, course, _parameters(course, truth, 'alpha_'), 0.0, _SHARPNESS_SPAN)
    place.set_ylabel('sharpness')


def _draw_time_constant(place: Axes, course: Course, truth: Truth) -> None:
    path = course.physiology(_TIME_CONSTANT)
    true = None if truth is None else 1e3 * truth.at('time_constant', course.stamp_ns)
    scaled = TimeCourse(value=1e3 * path.value, lower=1e3 * path.lower, upper=1e3 * path.upper)
    _draw_lines(place, course, [_Line('T_a', scaled, true)], _TIME_SPAN)
    place.set_ylabel('T_a / ms')


def _draw_disturbance(place: Axes, course: Course, truth: Truth) -> None:
    true = None if truth is None else truth.at('effort', course.stamp_ns)
    force = course.force.value[course.force.known]
    span = _FORCE_SPAN * float(np.median(np.abs(force))) if len(force) else 0.0
    what = QUANTITIES[course.estimates[-1].unit]
    line = _Line(f'{what} not caused by the stimulation', course.disturbance, true)
    # a burst may be short: all of it is shown
    _draw_lines(place, course, [line], 0.0, span, 0.0)
    place.set_ylabel(f'{what} / {course.estimates[-1].unit}')


def _parameters(course: Course, truth: Truth, prefix: str) -> list[_Line]:
    names = course.estimates[-1].nonlinear_names
    return [
        _Line(
            name,
            course.parameter(name),
            None if truth is None else truth.parameter(name, course.stamp_ns),
        )
        for name in names
        if name.startswith(prefix)
    ]


def _draw_lines(
    place: Axes,
    course: Course,
    lines: list[_Line],
    relative: float,
    absolute: float = 0.0,
    outside: float = _OUTSIDE,
) -> None:
    """Draw quantities with their bands.

    The axis is at least as high as `relative` to the values and as `absolute`, and leaves out
    `outside` per cent of the settled values at either end; what came before does not count.
    """
    shown, inside = course.shown, course.settled
    time = course.time_s[shown]
    true_name: str | None = 'true'
    seen = []
    for line, style in zip(lines, _LINE_STYLES, strict=False):
        path = line.path
        if path.has_interval:
            place.fill_between(
                time, path.lower[shown], path.upper[shown], facecolor=BAND, edgecolor=FAINT, lw=0.4
            )
        if line.true is not None:
            draw_true(place, time, line.true[shown], true_name)
            true_name = None
            seen.append(line.true[inside])
        place.plot(time, path.value[shown], color=MODELLED, ls=style, lw=1.2, label=line.name)
        seen += [values[inside] for values in (path.value, path.lower, path.upper)]
    found = [values[np.isfinite(values)] for values in seen]
    ends = [np.percentile(values, (outside, 100.0 - outside)) for values in found if len(values)]
    if not ends:
        return
    low, high = float(np.min(ends)), float(np.max(ends))
    height = max(high - low, relative * max(abs(low), abs(high)), absolute) * (1 + 2 * _MARGIN)
    middle = 0.5 * (low + high)
    if height > 0.0:
        place.set_ylim(middle - 0.5 * height, middle + 0.5 * height)


Draw = Callable[[list[Axes], SessionAnalysis], None]

# A screen of 390 px shows no wider figure with letters of 8 px.
_WIDTH = 5.6
FIGURES: dict[str, tuple[Draw, float, int]] = {
    'recruitment': (
        lambda axes, one: draw_recruitment(axes[0], one.session, one.dose, one.truth),
        3.6,
        1,
    ),
    'response': (
        lambda axes, one: draw_response(
            axes[0], one.session, one.result.impulse_response.force, one.truth
        ),
        3.6,
        1,
    ),
    'parameters': (lambda axes, one: draw_course(axes, one.course, one.truth), 0.5, 0),
    'force': (lambda axes, one: draw_force(axes, one.session, one.dose), 4.4, 2),
    'residuals': (lambda axes, one: draw_residuals(axes, one.residuals), 4.4, 2),
    'held_out': (
        lambda axes, one: draw_held_out(axes, one.session, one.held_out),
        4.4,
        2,
    ),
    'schedule': (lambda axes, one: draw_schedule(axes, one.dose), 4.4, 2),
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
