# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A report as one JSON document: every number that the page shows.

Methods of a report: sentence for a paper, command and versions.
"""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from rpms_ros import __version__
from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.stream.faults import MEANING
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray
from rpms_ros.report.course import Course
from rpms_ros.report.session.analysis import ITEMS_OF_THE_CONSENSUS, SOURCE, SessionAnalysis
from rpms_ros.report.text import NOT_A_TWITCH, is_no_twitch
from rpms_ros.schema import plain

_PACKAGES = ('numpy', 'scipy', 'numba', 'matplotlib')


def methods_of(analysis: 'SessionAnalysis') -> dict[str, Any]:
    """Return the sentence for a paper, the command and the versions of the software."""
    return {
        'sentence': _sentence(analysis),
        'command': analysis.settings.command or None,
        'versions': {
            'rpms_ros': __version__,
            'python': platform.python_version(),
            **{name: _version(name) for name in _PACKAGES},
        },
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'not installed'


def _sentence(analysis: 'SessionAnalysis') -> str:
    result, dose = analysis.result, analysis.dose
    what = QUANTITIES[result.unit]
    found = result.dynamics
    identified, by = 'Recruitment and impulse response', f'estimator {result.estimator}'
    if found is not None:
        identified, by = 'Dynamics', found.model
    parts = [
        (
            f'{identified} were identified with rpms_ros {__version__} '
            f'({by}) from {counted(result.pulses, "pulse")} and '
            f'{counted(result.samples, "sample")} of isometric {what} over '
            f'{result.duration_s:.4g} s'
        )
    ]
    if dose.rate_hz and dose.intensity:
        parts.append(
            f'at {dose.rate_hz["median"]:.4g} Hz and intensities of '
            f'{100 * dose.intensity["lowest"]:.3g} to {100 * dose.intensity["highest"]:.3g} % of '
            'the maximum'
        )
    if found is not None:
        return (
            f'{" ".join(parts)}. The {found.model} fits {found.fit_percent:.1f} % '
            f'(100 (1 - |residual| / |force - mean|)) of {counted(found.trains, "train")} at '
            'their own rate.'
        )
    text = ' '.join(parts) + f'; the recruitment curve is stated for {result.rate_hz:g} Hz'
    if result.confidence:
        text += f' with intervals of {100 * result.confidence:g} %'
    if not np.isfinite(result.output_error_n):
        return f'{text}. No sample was predicted before it was learnt.'
    return (
        f'{text}. The root mean square of measured minus predicted {what} was '
        f'{result.output_error_n:.2g} {result.unit} ({100 * result.output_error_of_range:.2g} % '
        f'of the range of the {what}).'
    )


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
