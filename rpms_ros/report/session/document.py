# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A report as one JSON document: every number that the page shows."""

from typing import Any

import numpy as np

from rpms_ros.identification.faults import MEANING
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.report.course import Course
from rpms_ros.report.named import NOT_A_TWITCH
from rpms_ros.report.named import is_no_twitch
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.checklist import ITEMS_OF_THE_CONSENSUS
from rpms_ros.report.session.checklist import SOURCE
from rpms_ros.report.session.methods import methods_of
from rpms_ros.schema import plain


def as_document(analysis: SessionAnalysis) -> dict[str, Any]:
    """Return the report as plain values; what cannot be determined is None.

    Forces in N, times in s, rates in Hz, energies in J, intensities as shares of the maximum.
    """
    residuals, dose = plain(analysis.residuals), plain(analysis.dose)
    if residuals is not None:
        residuals = {'share_of_session': analysis.settings.residual_share, **residuals}
    document: dict[str, Any] = plain(
        {
            'title': analysis.title,
            'headline': analysis.headline,
            'result': analysis.result,
            'twitch': twitch_figures(analysis),
            'time_courses': _courses(analysis.course),
            'flags': analysis.course.flags,
            'truth': _truth(analysis),
            'residuals': residuals,
            'held_out': analysis.held_out,
            'faults': [
                {'name': name, 'count': n, 'meaning': MEANING.get(name, 'fault of the recording')}
                for name, n in analysis.result.faults.items()
            ],
            'energy': {
                'full_intensity_pulses': dose.pop('full_intensity_pulses'),
                'device': analysis.load,
            },
            'schedule': dose,
            'driver': analysis.recorded.driver,
            'session': _facts(analysis),
            'checklist': {
                'source': SOURCE,
                'items_of_the_consensus': ITEMS_OF_THE_CONSENSUS,
                'items': analysis.checklist,
            },
            'methods': methods_of(analysis),
            'remarks': [*analysis.result.notes, *analysis.remarks],
        }
    )
    document['twitch']['remark'] = NOT_A_TWITCH if is_no_twitch(document['result']) else None
    return document


def _truth(analysis: SessionAnalysis) -> dict[str, Any] | None:
    """Return the errors of the result, None if the muscle was not simulated."""
    judgement = analysis.truth and analysis.truth.judged(analysis.course)
    if not judgement:
        return None
    return {'sentence': judgement.sentence, **plain(judgement)}


def twitch_figures(analysis: SessionAnalysis) -> dict[str, float | None]:
    """Return peak [N], time to peak and half relaxation [s] of the response to one pulse.

    Half relaxation is when the force has fallen to half its peak, None if it does not.
    """
    time, force = analysis.result.impulse_response.time_s, analysis.result.impulse_response.force
    peak = int(np.argmax(force))
    below = np.flatnonzero(force[peak:] <= 0.5 * force[peak])
    return {
        'peak_force': float(force[peak]),
        'time_to_peak_s': float(time[peak]),
        'half_relaxation_s': float(time[peak + below[0]] - time[peak]) if len(below) else None,
    }


def _courses(course: Course) -> dict[str, Any]:
    """Return the quantities over time, evenly thinned if there are very many.

    Each quantity has lists of values and, where there are intervals, of their ends.
    """
    names = course.estimates[-1].nonlinear_names
    paths = {
        'steady_force': course.force,
        **{name: course.parameter(name) for name in names},
        'twitch_time_constant_s': course.physiology('twitch_time_constant_s'),
        'latency_s': course.physiology('latency_s'),
        'disturbance': course.disturbance,
    }
    shown = course.shown
    return {
        'time_s': _short(course.time_s[shown]),
        **{
            name: {
                'value': _short(path.value[shown]),
                'lower': _short(path.lower[shown]) if path.has_interval else None,
                'upper': _short(path.upper[shown]) if path.has_interval else None,
            }
            for name, path in paths.items()
            if path.known.any()
        },
    }


def _short(values: FloatArray) -> list[float]:
    """Return numbers with six digits, enough for a figure."""
    return [float(f'{value:.6g}') for value in values]


def _facts(analysis: SessionAnalysis) -> dict[str, Any]:
    facts, forces = analysis.recording.facts, analysis.recording.forces
    steps = np.diff(np.sort(forces.stamp_ns)) / NANOSECONDS_PER_SECOND
    period = float(np.median(steps)) if len(steps) else 0.0
    return {
        'recording': facts.path.name,
        'storage': facts.storage,
        'start_ns': int(analysis.session.stamp_ns[0]),
        'duration_s': analysis.result.duration_s,
        'samples': analysis.result.samples,
        'sampling_rate_hz': 1.0 / period if period > 0 else None,
        'frame_ids': facts.frame_ids,
        'topics': [
            {'name': topic.name, 'type': topic.type_name, 'messages': topic.count}
            for topic in facts.topics
        ],
        'recorded_estimates': len(analysis.recorded.estimates),
        'notes': facts.custom,
    }
