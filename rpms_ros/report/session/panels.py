# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Panels of each figure of a report.

Measured is thick and grey, true thick, grey and dashed, modelled thin and black, limits are
dashed, bands light with an edge: distinguished by shade, width and style, not by hue.
"""

import numpy as np
from matplotlib.axes import Axes

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import IdentifiedSession
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.response_begin import begin_of_response
from rpms_ros.report.session.dose import Dose
from rpms_ros.report.session.held_out import HeldOutFit
from rpms_ros.report.session.residuals import ResidualAnalysis

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
