"""What is drawn into the axes of each figure of a report.

Measured is thick and grey, modelled thin and black, limits are dashed, bands light with an edge:
told apart by shade, width and style, never by hue.
"""

import numpy as np
from matplotlib.axes import Axes

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.traces import ENVELOPE_BINS
from rpms_ros.report.session.traces import thinned

MEASURED, MODELLED, BAND, FAINT = '#a0a0a0', '#000000', '#dcdcdc', '#6e6e6e'
LINE_STYLES = ('-', '--', ':', '-.')
_SHOWN = 4.0
# More bars than this cannot be told apart in print.
_MOST_BARS = 4000


def draw_recruitment(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw the recruitment curve with its band and the intensities that were used."""
    (place,) = axes
    last = analysis.session.last
    place.set_title(f'Recruitment at {last.repetition_rate:g} Hz')
    place.set_xlabel('intensity / share of maximum')
    place.set_ylabel('steady mean force / N')
    place.set_xlim(0.0, 1.0)
    if last.curve_known:
        _band(place, last.curve_intensity, last.curve_lower, last.curve_upper, last.confidence)
        place.plot(last.curve_intensity, last.curve_force, color=MODELLED, label='identified')
    else:
        _say(place, 'one intensity only:\nrecruitment and dynamics\ncannot be told apart')
    used = analysis.excitation.intensity
    if len(used):
        share, edges = np.histogram(used, bins=50, range=(0.0, 1.0))
        # behind the curve, which must not be hidden
        below = place.inset_axes((0.0, 0.0, 1.0, 0.14), zorder=0)
        below.bar(edges[:-1], share, width=0.02, align='edge', color='white', ec=FAINT, lw=0.5)
        below.set_xlim(0.0, 1.0)
        below.axis('off')
        place.bar(0.0, 0.0, color='white', ec=FAINT, lw=0.5, label='pulses by intensity')


def draw_response(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw the response to one pulse with its band."""
    (place,) = axes
    last = analysis.session.last
    response = analysis.result['impulse_response']
    time = 1e3 * np.array(response['time_s'])
    full = 'at full intensity' if last.curve_known else 'of the intensity used'
    place.set_title(f'Response to one pulse {full}')
    place.set_xlabel('time after the pulse / ms')
    place.set_ylabel('force / N')
    place.set_xlim(0.0, float(time[-1]))
    if last.curve_known:
        _band(place, time, last.response_lower, last.response_upper, last.confidence)
    place.plot(time, response['force'], color=MODELLED, label='identified')


def draw_parameters(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw the paths of the parameters: intensities above, slopes below."""
    estimates = thinned(analysis.session.estimates)
    time = _elapsed(np.array([estimate.stamp_ns for estimate in estimates]), analysis)
    values = np.array([estimate.nonlinear for estimate in estimates])
    spread = np.array([_deviation(estimate.nonlinear_covariance) for estimate in estimates[-1:]])
    axes[0].set_title('Parameters while the session went on')
    for place, prefix, quantity in zip(
        axes, ('u_', 'alpha_'), ('share of maximum', 'slope'), strict=True
    ):
        chosen = [
            (index, name)
            for index, name in enumerate(estimates[-1].nonlinear_names)
            if name.startswith(prefix)
        ]
        for (index, name), line, point in zip(chosen, LINE_STYLES, 'osD^', strict=False):
            path = values[:, index]
            fixed = ' (fixed)' if len(path) > 1 and np.ptp(path) == 0.0 else ''
            # one estimate is a point, which a line would not show
            marker = point if len(path) == 1 else 'None'
            place.plot(
                time, path, color=MODELLED, ls=line, lw=1.2, marker=marker, label=name + fixed
            )
            if spread.size:
                place.errorbar(
                    time[-1], path[-1], spread[0, index], color=FAINT, capsize=3, lw=1.0
                )
        place.set_ylabel(quantity)
    axes[-1].set_xlabel('time / s')


def draw_force(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw measured and modelled force over the last seconds of stimulation."""
    session = analysis.session
    time = _elapsed(session.stamp_ns, analysis)
    onset = analysis.excitation.onset_s
    end = min(float(time[-1]), float(onset[-1]) + 0.1) if len(onset) else float(time[-1])
    kept = (time >= end - _SHOWN) & (time <= end)
    axes[0].set_title(f'Force, last {_SHOWN:g} s of stimulation, predicted before it was measured')
    _force_and_residual(axes, time[kept], session.force[kept], session.prediction[kept])


def draw_held_out(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw measured and modelled force over the part that was held out."""
    fit = analysis.held_out
    if fit is None:
        _say(axes[0], 'nothing could be held out')
        return
    time = _elapsed(fit.stamp_ns, analysis)
    kept = time <= time[0] + _SHOWN
    axes[0].set_title(f'Held out: the first {_SHOWN:g} s after learning stopped')
    _force_and_residual(axes, time[kept], fit.force[kept], fit.prediction[kept])


def draw_residuals(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw the correlations of the residual with itself and with the pulses."""
    found = analysis.residuals
    whiteness, cross = axes
    whiteness.set_title('Residual with itself')
    cross.set_title('Pulses with residual')
    if found is None:
        for place in axes:
            _say(place, 'too few residuals')
        return
    band = found.autocorrelation_band
    whiteness.plot(1e3 * found.lag[1:], found.autocorrelation[1:], color=MODELLED, lw=0.9)
    _limits(whiteness, band, '95 % if white')
    whiteness.set_xlabel('lag / ms')
    whiteness.set_ylabel('correlation')
    if len(found.cross_correlation):
        cross.plot(1e3 * found.cross_lag, found.cross_correlation, color=MODELLED, lw=0.9)
        _limits(cross, found.cross_band, '95 % if independent')
    else:
        _say(cross, 'no pulses in this part')
    cross.set_xlabel('time after the pulse / ms')


def draw_schedule(axes: list[Axes], analysis: SessionAnalysis) -> None:
    """Draw intensity of the pulses and their energy over time."""
    excitation = analysis.excitation
    time, intensity = excitation.onset_s, excitation.intensity
    energy = np.cumsum(intensity**2)
    axes[0].set_title('Pulses and their energy')
    axes[0].set_ylabel('intensity / share')
    axes[0].set_ylim(0.0, 1.05)
    axes[1].set_xlabel('time / s')
    axes[1].set_ylabel('energy / pulses\nat full intensity')
    if not len(time):
        _say(axes[0], 'no pulses')
        return
    if len(time) <= _MOST_BARS:
        axes[0].vlines(time, 0.0, intensity, color=MEASURED, lw=0.6)
        axes[0].plot(time, intensity, '.', color=MODELLED, ms=2.5)
    else:
        starts = np.linspace(0, len(time), _MOST_BARS // 4, endpoint=False).astype(int)
        low, high = (
            np.minimum.reduceat(intensity, starts),
            np.maximum.reduceat(intensity, starts),
        )
        axes[0].fill_between(time[starts], low, high, color=MEASURED, lw=0.4, ec=MODELLED)
    axes[1].plot(time, energy, color=MODELLED, lw=1.2, drawstyle='steps-post')


def _force_and_residual(
    axes: list[Axes], time: FloatArray, force: FloatArray, prediction: FloatArray
) -> None:
    upper, lower = axes
    step = max(1, len(time) // (4 * ENVELOPE_BINS))
    time, force, prediction = time[::step], force[::step], prediction[::step]
    upper.plot(time, force, color=MEASURED, lw=3.0, label='measured')
    upper.plot(time, prediction, color=MODELLED, lw=0.9, label='modelled')
    upper.set_ylabel('force / N')
    lower.plot(time, force - prediction, color=MODELLED, lw=0.7)
    lower.axhline(0.0, color=FAINT, lw=0.6)
    lower.set_ylabel('residual / N')
    lower.set_xlabel('time / s')


def _elapsed(stamp_ns: IntArray, analysis: SessionAnalysis) -> FloatArray:
    start = analysis.session.stamp_ns[0]
    elapsed: FloatArray = (stamp_ns - start) / NANOSECONDS_PER_SECOND
    return elapsed


def _deviation(covariance: FloatArray) -> FloatArray:
    """Return standard deviations (p,), nothing if the covariance is not known."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0)) if covariance.size else np.empty(0)


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


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha='center', va='center', transform=axes.transAxes)
