"""The analysis of a muscle as one JSON object: SI units, rates in Hz, no number is null."""

from collections.abc import Mapping
from dataclasses import asdict
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from rpms_ros.identification.analysis import FieldAnalysis
from rpms_ros.identification.analysis import MuscleAnalysis
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.identification.analysis import TwitchAnalysis
from rpms_ros.identification.analysis.summation import TrainAnalysis

Document = dict[str, Any]


def analysis_document(analysis: MuscleAnalysis) -> Document:
    """Return everything that was found, the traces apart."""
    artifacts = analysis.artifacts
    document = {
        'contents': dict(analysis.contents),
        'pulses': analysis.pulses,
        'samples': analysis.samples,
        'sample_rate_hz': analysis.sample_rate_hz,
        'noise': analysis.noise,
        'clocks': None
        if artifacts is None
        else {
            'artifacts_found': artifacts.found,
            'artifacts': artifacts.count,
            'artifact_after_stamp': artifacts.median_offset,
            'spread': artifacts.spread,
            'clock_offset': artifacts.clock_offset,
        },
        'twitches': _twitches(analysis.twitches) if analysis.twitches else None,
        'summation': _summation(analysis.summation) if analysis.summation else None,
        'steady': [asdict(point) for point in analysis.steady],
        'recruitment': _field(analysis.recruitment) if analysis.recruitment else None,
        'findings': list(analysis.findings),
    }
    plain: Document = as_plain(document)
    return plain


def as_plain(value: Any) -> Any:
    """Return what JSON can hold: NaN and infinity become null, arrays lists."""
    if is_dataclass(value) and not isinstance(value, type):
        return as_plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return as_plain(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _twitches(found: TwitchAnalysis) -> Document:
    return {
        'count': len(found.fits),
        'rejected': dict(found.rejected),
        'order': found.choice,
        'shared': found.shared,
        'time_constant': found.time_constant,
        'time_constant_spread': found.time_constant_spread,
        'latency': found.latency,
        'crossing_latency': found.crossing_latency,
    }


def _summation(found: SummationAnalysis) -> Document:
    models = ('equal', 'gains', 'law')
    return {
        'order': found.order,
        'count': len(found.trains),
        'rejected': dict(found.rejected),
        'latency': found.latency,
        'latency_spread': found.latency_spread,
        'time_constant': found.time_constant,
        'time_constant_spread': found.time_constant_spread,
        'law': found.law,
        'mean_fit': {model: found.mean_fit(model) for model in models},
        'mean_fit_held_out': {model: found.mean_fit(model, held_out=True) for model in models},
        'trains': [_train(train) for train in found.trains],
    }


def _train(train: TrainAnalysis) -> Document:
    return {
        'rate_hz': train.rate_hz,
        'pulses': len(train.response.onset),
        'intensity': train.response.intensity,
        'held_out': train.held_out,
        'fit': {
            'equal': train.equal.fit,
            'gains': train.gains.fit,
            'law': train.law.fit if train.law else None,
        },
        'latency': train.equal.latency,
        'time_constant': train.equal.time_constant,
        'gain': train.equal.gains[0],
        'gains': train.gains.gains,
    }


def _field(found: FieldAnalysis) -> Document:
    return {
        'maximum_force': found.maximum_force,
        'parameters': dict(found.parameters),
        'rates_fitted': found.rates_fitted,
        'by_intensity': found.recruitment.by_intensity,
        'by_rate': found.recruitment.by_rate,
        'levels': len(found.points),
        'residual': found.residual,
        'worst_interval': found.worst_interval,
        'shape_difference': found.shape_difference,
        'monotone_intensity': found.monotone_intensity,
        'monotone_share': found.monotone_share,
    }
