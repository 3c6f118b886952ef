"""A recording identified: what `rpms identify` shows, as one document."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING
from typing import Any

import numpy as np

from rpms_ros.identification import CONVERGED
from rpms_ros.identification import DEFAULT_RATE
from rpms_ros.identification import INFORMED
from rpms_ros.identification import NOT_INFORMED
from rpms_ros.identification import Estimate
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification import StreamSettings
from rpms_ros.identification import identify
from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.muscle import RecruitmentParameters
from rpms_ros.muscle import identified_recruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import session_hash

if TYPE_CHECKING:
    from rpms_ros.recording import Recording

ONE_INTENSITY = (
    'all pulses have nearly one intensity: only the product of recruitment and dynamics can be '
    'identified; there is no recruitment curve, and the impulse response is that of a pulse of '
    'this intensity'
)

# Longer than any recording [s].
_NEVER = 1e9

EXCITATION = {NOT_INFORMED: 'not informed', INFORMED: 'informed', CONVERGED: 'converged'}


@dataclass(frozen=True)
class IdentificationOptions:
    """How a recording is identified.

    Attributes
    ----------
    estimator : str
        Name of the algorithm.
    preset : str
        Design parameters by name: ``table_4`` or ``table_5``.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].
    seed : int
        Of the estimator's random start.
    """

    estimator: str = 'recursive'
    preset: str = 'table_4'
    rate_hz: float = DEFAULT_RATE
    seed: int = 0


def identified(
    recording: 'Recording',
    options: IdentificationOptions,
    progress: Callable[[int], object] | None = None,
    most_estimates: int | None = None,
) -> IdentifiedSession:
    """Return what an estimator makes of a recording, as it would have on line.

    Parameters
    ----------
    recording : Recording
        Pulses and forces.
    options : IdentificationOptions
        Which estimator, and how.
    progress : callable or None
        Called with the number of samples that were taken since the last call.
    most_estimates : int or None
        About as many estimates are enough, evenly spaced, each of them one of those on line;
        None makes all of them, ten a second.  The last one is the same in any case.
    """
    estimator = estimator_by_name(options.estimator, options.preset, options.seed, options.rate_hz)
    # The batch fits everything anew for every estimate: one is enough, at the end.
    most = 1 if options.estimator == 'batch' else most_estimates
    settings = StreamSettings(estimate_period=_period(recording, most))
    return identify(estimator, recording.pulses, recording.forces, settings, progress)


def compile_estimator(options: IdentificationOptions) -> None:
    """Run the estimator over two seconds of made-up data: the first run on a machine compiles."""
    pulses = PulseTrain.regular([0.2, 0.5, 0.8, 1.0] * 10, rate_hz=20.0)
    stamp_ns = np.arange(2000, dtype=np.int64) * (NANOSECONDS_PER_SECOND // 1000)
    estimator = estimator_by_name(options.estimator, options.preset, options.seed, options.rate_hz)
    force = 1.0 - np.cos(stamp_ns * 1e-8)
    identify(estimator, pulses, ForceTrace(stamp_ns, force), StreamSettings(estimate_period=1.0))


def _period(recording: 'Recording', most_estimates: int | None) -> float:
    """Return a whole multiple of the period on line [s]: every estimate is one of those."""
    on_line = StreamSettings().estimate_period
    if most_estimates is None:
        return on_line
    if most_estimates == 1:
        return _NEVER
    stamps = recording.forces.stamp_ns
    duration = float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND if len(stamps) else 0.0
    return on_line * max(math.ceil(duration / (on_line * most_estimates)), 1)


def as_document(recording: 'Recording', session: IdentifiedSession) -> dict[str, Any]:
    """Return the result as JSON takes it; what cannot be known is None.

    Forces in N, times in s, rates in Hz, intensities as shares of the maximum.  Intervals,
    excitation and physiology are there if the estimator offers them.
    """
    last = session.last
    stamps = recording.forces.stamp_ns
    known = last.curve_known
    return {
        'session_hash': session_hash(recording),
        'estimator': last.estimator,
        'samples': len(session.stamp_ns),
        'pulses': last.pulses,
        'duration_s': float(stamps.max() - stamps.min()) / NANOSECONDS_PER_SECOND,
        'rate_hz': last.repetition_rate,
        'recruitment': _recruitment(last) if known else None,
        'curve': {
            'intensity': last.curve_intensity.tolist(),
            'force': last.curve_force.tolist(),
            **_interval(last.curve_lower, last.curve_upper),
        }
        if known
        else None,
        'impulse_response': {
            'time_s': last.response_time.tolist(),
            'force': impulse_response(recording, last).tolist(),
            **(_interval(last.response_lower, last.response_upper) if known else {}),
        },
        **_certainty(last),
        'output_error_n': _number(session.output_error.newton),
        'output_error_of_range': _number(session.output_error.of_range),
        'faults': {**recording.facts.faults, **last.faults},
        'notes': [*recording.facts.remarks, *([] if known else [ONE_INTENSITY])],
    }


def impulse_response(recording: 'Recording', estimate: Estimate) -> FloatArray:
    """Return the response to one pulse (times,) [N].

    At full intensity; where the recruitment is not known, at the intensity of the pulses, since
    the response to any other would be made up.
    """
    if estimate.curve_known:
        return estimate.response_force
    parameters = RecruitmentParameters(*estimate.nonlinear.tolist())
    applied = float(np.median(recording.pulses.intensity))
    share = identified_recruitment(parameters, applied) / identified_recruitment(parameters, 1.0)
    return estimate.response_force * float(share)


def _recruitment(estimate: Estimate) -> dict[str, float]:
    return dict(zip(estimate.nonlinear_names, estimate.nonlinear.tolist(), strict=True))


def _interval(lower: FloatArray, upper: FloatArray) -> dict[str, list[float]]:
    return {'lower': lower.tolist(), 'upper': upper.tolist()} if len(lower) else {}


def _certainty(estimate: Estimate) -> dict[str, Any]:
    """Return level of the intervals, flags and physiology, as far as there are any."""
    document: dict[str, Any] = {}
    if estimate.confidence:
        document['confidence'] = estimate.confidence
    if len(estimate.nonlinear_excitation):
        flags = (EXCITATION[flag] for flag in estimate.nonlinear_excitation.tolist())
        document['excitation'] = dict(zip(estimate.nonlinear_names, flags, strict=True))
    if len(estimate.physiology):
        columns = (estimate.physiology, estimate.physiology_lower, estimate.physiology_upper)
        document['physiology'] = {
            name: {'value': value, 'lower': lower, 'upper': upper}
            for name, value, lower, upper in zip(
                estimate.physiology_names, *(column.tolist() for column in columns), strict=True
            )
        }
    return document


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
