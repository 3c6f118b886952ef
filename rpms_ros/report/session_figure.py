"""One figure of a session: parameter paths, force, recruitment curve, impulse response.

The panels are those of the paper's Figs. 13 (and 15), 14, 16 and 17.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rpms_ros.errors import ReportError
from rpms_ros.identification import Estimate
from rpms_ros.identification import IdentifiedSession
from rpms_ros.muscle import Subject
from rpms_ros.muscle import twitch
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import PulseTrain

MEASURED = '#7f7f7f'
IDENTIFIED = '#0b6fa4'
TRUE = '#d1495b'
RESIDUAL = '#5a8f29'
_COLOURS = ('#0b6fa4', '#d18f00', '#7b4fa3', '#5a8f29')
# How much of the end of a session is shown of the force [s].
_FORCE_SPAN = 4.0
# Symbols in the paper's letters.
_SYMBOLS = {
    'u_thr': r'$u_\mathrm{thr}$',
    'u_sat': r'$u_\mathrm{sat}$',
    'alpha_sat': r'$\alpha_\mathrm{sat}$',
    'alpha_thr': r'$\alpha_\mathrm{thr}$',
}


def draw_session(
    path: Path,
    session: IdentifiedSession,
    pulses: PulseTrain,
    subject: Subject | None = None,
    title: str = '',
) -> None:
    """Write the figure of a session; the ending of `path` names the format.

    Parameters
    ----------
    path : Path
        File to write.
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
        If the file cannot be written.
    """
    figure = Figure(figsize=(12.0, 8.4), layout='constrained', dpi=130)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(4, 2, height_ratios=(1.0, 1.0, 1.4, 0.6))
    _draw_paths(figure, (grid[0, 0], grid[1, 0]), session, subject)
    _draw_force(figure, grid[0:2, 1], session, pulses)
    _draw_curve(figure.add_subplot(grid[2:, 0]), session.last, subject, pulses)
    _draw_response(figure.add_subplot(grid[2:, 1]), session.last, subject)
    if title:
        figure.suptitle(title, fontsize=12)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise ReportError(f'expected to write a figure to {path}, got {error}') from error


def _time(stamp_ns: Any, session: IdentifiedSession) -> FloatArray:
    """Return times after the first sample [s]."""
    elapsed = np.asarray(stamp_ns, dtype=np.int64) - session.stamp_ns[0]
    return np.asarray(elapsed / NANOSECONDS_PER_SECOND)


def _draw_paths(
    figure: Figure, places: Sequence[Any], session: IdentifiedSession, subject: Subject | None
) -> None:
    """Draw intensities above and slopes below: they differ by an order of magnitude."""
    estimates = session.estimates
    names = estimates[-1].nonlinear_names
    time = _time([estimate.stamp_ns for estimate in estimates], session)
    values = np.array([estimate.nonlinear for estimate in estimates])
    truth = _true_parameters(subject)
    axes: Axes | None = None
    for place, prefix, quantity in zip(
        places, ('u_', 'alpha_'), ('share of maximum', 'slope'), strict=True
    ):
        axes = figure.add_subplot(place, sharex=axes)
        for index, name in enumerate(names):
            if not name.startswith(prefix):
                continue
            colour = _COLOURS[index % len(_COLOURS)]
            still = ' (fixed)' if np.ptp(values[:, index]) == 0.0 else ''
            label = _SYMBOLS.get(name, name) + still
            axes.plot(time, values[:, index], color=colour, label=label)
            if name in truth:
                axes.axhline(truth[name], color=colour, ls='--', lw=1.0)
        axes.set_ylabel(quantity)
        _finish(axes)
    figure.axes[0].set_title('Parameter paths' + (' (dashed: true)' if truth else ''))
    figure.axes[0].tick_params(labelbottom=False)
    figure.axes[1].set_xlabel('time / s')


def _true_parameters(subject: Subject | None) -> dict[str, float]:
    if subject is None:
        return {}
    curve = subject.recruitment
    return {
        'u_thr': curve.threshold,
        'u_sat': curve.saturation,
        'alpha_sat': curve.saturation_slope,
        'alpha_thr': curve.threshold_slope,
    }


def _draw_force(
    figure: Figure, place: Any, session: IdentifiedSession, pulses: PulseTrain
) -> None:
    """Draw measured and modelled force at the end of the session, and their difference."""
    inner = place.subgridspec(2, 1, height_ratios=(3.0, 1.0))
    force, residual = (figure.add_subplot(inner[0]), figure.add_subplot(inner[1]))
    residual.sharex(force)
    end = _last_stimulated(session, pulses)
    time = _time(session.stamp_ns, session)
    shown = (time >= end - _FORCE_SPAN) & (time <= end)
    time = time[shown]
    force.plot(time, session.force[shown], color=MEASURED, lw=2.5, label='measured')
    force.plot(time, session.prediction[shown], color=IDENTIFIED, lw=1.0, label='modelled')
    residual.plot(time, (session.force - session.prediction)[shown], color=RESIDUAL, lw=0.8)
    residual.axhline(0.0, color='black', lw=0.5)
    force.set_title(f'Force, the last {_FORCE_SPAN:.0f} s (a priori)')
    force.set_ylabel('force / N')
    force.tick_params(labelbottom=False)
    residual.set_ylabel('error / N')
    residual.set_xlabel('time / s')
    _finish(force)
    residual.grid(alpha=0.25)


def _last_stimulated(session: IdentifiedSession, pulses: PulseTrain) -> float:
    """Return when the last pulse has had its effect, at most the end of the session [s]."""
    last = float(_time(session.stamp_ns[-1], session))
    if not len(pulses):
        return last
    return min(last, float(_time(pulses.onset_ns.max(), session)) + 0.1)


def _draw_curve(
    axes: Axes, estimate: Estimate, subject: Subject | None, pulses: PulseTrain
) -> None:
    axes.set_title(f'Recruitment curve at {estimate.repetition_rate:g} Hz')
    axes.set_xlabel('intensity / share of maximum')
    axes.set_ylabel('steady mean force / N')
    if subject is not None:
        true = subject.steady_force(estimate.curve_intensity, estimate.repetition_rate)
        axes.plot(estimate.curve_intensity, true, color=TRUE, lw=2.5, alpha=0.6, label='true')
    if estimate.curve_known:
        axes.plot(
            estimate.curve_intensity, estimate.curve_force, color=IDENTIFIED, label='identified'
        )
        _band(axes, estimate.curve_intensity, estimate.curve_lower, estimate.curve_upper)
    else:
        axes.text(
            0.5,
            0.5,
            'one intensity only:\nonly the product of recruitment\nand dynamics can be identified',
            ha='center',
            va='center',
            transform=axes.transAxes,
        )
    axes.set_xlim(0.0, 1.0)
    if len(pulses):
        axes.plot(
            pulses.intensity,
            np.zeros(len(pulses)),
            '|',
            color=MEASURED,
            alpha=0.25,
            ms=8,
            label='pulses',
            transform=axes.get_xaxis_transform(),
            clip_on=False,
        )
    _finish(axes)


def _draw_response(axes: Axes, estimate: Estimate, subject: Subject | None) -> None:
    axes.set_title('Response to one pulse at full intensity')
    axes.set_xlabel('time after the pulse / ms')
    axes.set_ylabel('force / N')
    time = estimate.response_time
    if subject is not None:
        peak = float(subject.pulse_weight(1.0, estimate.repetition_rate))
        fine = np.linspace(0.0, float(time[-1]), 500)
        true = peak * twitch(fine - subject.latency, subject.time_constant, subject.order)
        axes.plot(1e3 * fine, true, color=TRUE, lw=2.5, alpha=0.6, label='true')
    axes.plot(1e3 * time, estimate.response_force, color=IDENTIFIED, label='identified')
    _band(axes, 1e3 * time, estimate.response_lower, estimate.response_upper)
    axes.set_xlim(0.0, 1e3 * float(time[-1]))
    _finish(axes)


def _band(axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
    if len(lower) and len(upper):
        axes.fill_between(x, lower, upper, color=IDENTIFIED, alpha=0.15, lw=0.0)


def _finish(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=9, loc='best')
