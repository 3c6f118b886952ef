# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The analysis of a muscle as one JSON object: SI units, rates in Hz; missing numbers are null."""

from typing import Any

from rpms_ros.identification.analysis import FieldAnalysis
from rpms_ros.identification.analysis import MuscleAnalysis
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.identification.analysis import TwitchAnalysis
from rpms_ros.identification.analysis.dynamics import train_dynamics
from rpms_ros.identification.analysis.summation import TrainAnalysis
from rpms_ros.schema import plain

Document = dict[str, Any]
_SPREADS = 'latency latency_spread time_constant time_constant_spread'
_MODELS = ('equal', 'gains', 'law')


def analysis_document(analysis: MuscleAnalysis) -> Document:
    """Return all results without the traces."""
    clocks = analysis.artifacts
    document: Document = plain(
        {
            **_fields(analysis, 'contents pulses samples sample_rate_hz noise unit'),
            'clocks': clocks
            and {
                'artifacts_found': clocks.found,
                'artifacts': clocks.count,
                'artifact_after_stamp': clocks.median_offset,
                'spread': clocks.spread,
                'clock_offset': clocks.clock_offset,
            },
            'twitches': analysis.twitches and _twitches(analysis.twitches),
            'dynamics': train_dynamics(analysis),
            'summation': analysis.summation and _summation(analysis.summation),
            'steady': analysis.steady,
            'recruitment': analysis.recruitment and _field(analysis.recruitment),
            'findings': analysis.findings,
        }
    )
    return document


def _fields(value: object, names: str) -> Document:
    return {name: getattr(value, name) for name in names.split()}


def _twitches(found: TwitchAnalysis) -> Document:
    names = 'rejected shared time_constant time_constant_spread latency crossing_latency'
    return {'count': len(found.fits), 'order': found.choice, **_fields(found, names)}


def _summation(found: SummationAnalysis) -> Document:
    return {
        'count': len(found.trains),
        **_fields(found, f'order rejected {_SPREADS} onsets law'),
        'mean_fit': {model: found.mean_fit(model) for model in _MODELS},
        'mean_fit_held_out': {model: found.mean_fit(model, held_out=True) for model in _MODELS},
        'trains': [_train(train) for train in found.trains],
    }


def _train(train: TrainAnalysis) -> Document:
    return {
        'rate_hz': train.rate_hz,
        'pulses': len(train.response.onset),
        'intensity': train.response.intensity,
        'held_out': train.held_out,
        'fit': {model: getattr(getattr(train, model), 'fit', None) for model in _MODELS},
        **_fields(train.equal, 'latency time_constant'),
        'gain': train.equal.gains[0],
        'gains': train.gains.gains,
    }


def _field(found: FieldAnalysis) -> Document:
    names = 'maximum_force rates_fitted residual worst_interval shape_difference'
    return {
        **_fields(found, f'{names} monotone_intensity monotone_share'),
        'parameters': dict(found.parameters),
        'by_intensity': found.recruitment.by_intensity,
        'by_rate': found.recruitment.by_rate,
        'levels': len(found.points),
    }
