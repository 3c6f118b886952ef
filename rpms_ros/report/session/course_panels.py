# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Panels of the quantities over time.

Sudden changes are dotted lines with their kind, spans with a doubt or a fault are hatched, true
values of a simulated muscle dashed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from rpms_ros.axis import QUANTITIES
from rpms_ros.pulses import FloatArray
from rpms_ros.report.course import Course
from rpms_ros.report.course import Path
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.session.panels import BAND
from rpms_ros.report.session.panels import FAINT
from rpms_ros.report.session.panels import MODELLED
from rpms_ros.report.session.panels import draw_true

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
Draw = Callable[[Axes, Course, Truth], None]


@dataclass(frozen=True)
class _Line:
    name: str
    path: Path
    true: FloatArray | None


def course_panels(course: Course) -> list[Draw]:
    """Return what draws each panel of a course, from above; none without a course."""
    if not course.has_course:
        return []
    panels: list[Draw] = [_draw_force, _draw_thresholds, _draw_sharpness]
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
    scaled = Path(value=1e3 * path.value, lower=1e3 * path.lower, upper=1e3 * path.upper)
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
