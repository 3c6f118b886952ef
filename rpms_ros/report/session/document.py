"""A report as one document that JSON can hold: every number that the page shows."""

import math
from typing import Any

import numpy as np

from rpms_ros.identification import Estimate
from rpms_ros.identification.faults import MEANING
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.checklist import ITEMS_OF_THE_CONSENSUS
from rpms_ros.report.session.checklist import SOURCE
from rpms_ros.report.session.excitation import Excitation
from rpms_ros.report.session.traces import thinned


def as_document(analysis: SessionAnalysis) -> dict[str, Any]:
    """Return the report as JSON takes it; what cannot be known is None.

    Forces in N, times in s, rates in Hz, energies in J, intensities as shares of the maximum.
    """
    return {
        'title': analysis.title,
        'result': analysis.result,
        'intervals': _intervals(analysis.session.last),
        'physiology': _physiology(analysis.session.last),
        'twitch': twitch_figures(analysis),
        'parameter_paths': _paths(analysis),
        'residuals': _residuals(analysis),
        'held_out': _held_out(analysis),
        'faults': [
            {'name': name, 'count': count, 'meaning': MEANING.get(name, 'fault of the recording')}
            for name, count in analysis.result['faults'].items()
        ],
        'schedule': _schedule(analysis.excitation),
        'energy': _energy(analysis),
        'driver': _driver(analysis),
        'session': _facts(analysis),
        'checklist': {
            'source': SOURCE,
            'items_of_the_consensus': ITEMS_OF_THE_CONSENSUS,
            'items': [
                {
                    'key': entry.field.key,
                    'part': entry.field.part,
                    'label': entry.field.label,
                    'value': entry.value or None,
                    'origin': entry.origin or None,
                }
                for entry in analysis.checklist
            ],
        },
        'remarks': [*analysis.result['notes'], *analysis.remarks],
    }


def twitch_figures(analysis: SessionAnalysis) -> dict[str, float | None]:
    """Return what is read off the response to one pulse: peak [N], and two times [s].

    Half relaxation is when the force has fallen to half its peak, None if it does not.
    """
    response = analysis.result['impulse_response']
    time, force = np.array(response['time_s']), np.array(response['force'])
    peak = int(np.argmax(force))
    below = np.flatnonzero(force[peak:] <= 0.5 * force[peak])
    return {
        'peak_force': float(force[peak]),
        'time_to_peak_s': float(time[peak]),
        'half_relaxation_s': float(time[peak + below[0]] - time[peak]) if len(below) else None,
    }


def _intervals(last: Estimate) -> dict[str, Any] | None:
    """Return the intervals of the last estimate, None if it has none."""
    if not last.confidence:
        return None
    return {
        'confidence': last.confidence,
        'curve_lower': last.curve_lower.tolist(),
        'curve_upper': last.curve_upper.tolist(),
        'response_lower': last.response_lower.tolist(),
        'response_upper': last.response_upper.tolist(),
        'nonlinear_covariance': last.nonlinear_covariance.tolist(),
        'nonlinear_excitation': last.nonlinear_excitation.tolist(),
    }


def _physiology(last: Estimate) -> list[dict[str, Any]]:
    lower = _or_nothing(last.physiology_lower, len(last.physiology))
    upper = _or_nothing(last.physiology_upper, len(last.physiology))
    rows = zip(last.physiology_names, last.physiology.tolist(), lower, upper, strict=True)
    return [
        {'name': name, 'value': _number(value), 'lower': below, 'upper': above}
        for name, value, below, above in rows
    ]


def _or_nothing(bounds: FloatArray, count: int) -> list[float | None]:
    return [_number(bound) for bound in bounds.tolist()] if len(bounds) else [None] * count


def _paths(analysis: SessionAnalysis) -> dict[str, Any]:
    """Return the parameters over time, evenly thinned if there are very many estimates."""
    estimates = thinned(analysis.session.estimates)
    start = int(analysis.session.stamp_ns[0])
    values = np.array([estimate.nonlinear for estimate in estimates])
    return {
        'time_s': [(estimate.stamp_ns - start) / NANOSECONDS_PER_SECOND for estimate in estimates],
        **{
            name: values[:, index].tolist()
            for index, name in enumerate(estimates[-1].nonlinear_names)
        },
    }


def _residuals(analysis: SessionAnalysis) -> dict[str, Any] | None:
    found = analysis.residuals
    if found is None:
        return None
    return {
        'share_of_session': analysis.settings.residual_share,
        'samples': found.samples,
        'sample_period_s': found.sample_period,
        'root_mean_square': found.root_mean_square,
        'mean': found.mean,
        'ljung_box': found.ljung_box,
        'ljung_box_lags': found.ljung_box_lags,
        'ljung_box_p': found.ljung_box_p,
        'autocorrelation_band': found.autocorrelation_band,
        'autocorrelation_outside': found.outside,
        'lag_s': found.lag.tolist(),
        'autocorrelation': found.autocorrelation.tolist(),
        'cross_correlation_band': found.cross_band,
        'cross_correlation_outside': found.cross_outside,
        'cross_lag_s': found.cross_lag.tolist(),
        'cross_correlation': found.cross_correlation.tolist(),
    }


def _held_out(analysis: SessionAnalysis) -> dict[str, Any] | None:
    fit = analysis.held_out
    if fit is None:
        return None
    return {
        'learnt_s': fit.learnt_s,
        'held_out_s': fit.held_out_s,
        'samples': len(fit.force),
        'relative_error': _number(fit.relative_error),
        'explained_variance': _number(fit.explained_variance),
        'fit_percent': _number(fit.fit_percent),
    }


def _schedule(excitation: Excitation) -> dict[str, Any]:
    known = excitation.pulses > 0
    rates = excitation.rates_hz
    return {
        'pulses': excitation.pulses,
        'trains': excitation.trains,
        'stimulated_s': excitation.stimulated_s,
        'rate_hz': {'lowest': rates[0], 'median': rates[1], 'highest': rates[2]}
        if rates
        else None,
        'intensity': {
            'lowest': float(excitation.intensity.min()),
            'mean': float(excitation.intensity.mean()),
            'highest': float(excitation.intensity.max()),
        }
        if known
        else None,
        'pulse_width_s': list(excitation.widths),
    }


def _energy(analysis: SessionAnalysis) -> dict[str, Any]:
    load = analysis.load
    return {
        'full_intensity_pulses': analysis.excitation.full_intensity_pulses,
        'device': None
        if load is None
        else {
            'name': load.device,
            'energy_j': load.energy_j,
            'highest_power_w': load.highest_power_w,
            'window_s': load.window_s,
            'highest_temperature_celsius': load.highest_temperature,
        },
    }


def _driver(analysis: SessionAnalysis) -> dict[str, Any] | None:
    word = analysis.words.driver
    if word is None:
        return None
    return {
        'pulses_delivered': word.delivered,
        'pulses_dropped': word.dropped,
        'coil_energy_j': _number(word.coil_energy),
        'highest_temperature_celsius': _number(word.highest_temperature),
        'lateness_max_s': _number(word.lateness_max),
        'schedule': word.schedule or None,
        'faults': word.faults,
    }


def _facts(analysis: SessionAnalysis) -> dict[str, Any]:
    facts, forces = analysis.recording.facts, analysis.recording.forces
    steps = np.diff(np.sort(forces.stamp_ns)) / NANOSECONDS_PER_SECOND
    period = float(np.median(steps)) if len(steps) else 0.0
    return {
        'recording': facts.path.name,
        'storage': facts.storage,
        'start_ns': int(analysis.session.stamp_ns[0]),
        'duration_s': analysis.result['duration_s'],
        'samples': analysis.result['samples'],
        'sampling_rate_hz': 1.0 / period if period > 0 else None,
        'frame_ids': {name: list(frames) for name, frames in facts.frame_ids.items()},
        'topics': [
            {'name': topic.name, 'type': topic.type_name, 'messages': topic.count}
            for topic in facts.topics
        ],
        'recorded_estimates': len(analysis.words.estimates),
        'notes': dict(facts.custom),
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
