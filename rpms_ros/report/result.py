# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result of an identification as one object: what ``rpms identify --json`` prints."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.errors import ReportError
from rpms_ros.identification import CONVERGED
from rpms_ros.identification import INFORMED
from rpms_ros.identification import NOT_INFORMED
from rpms_ros.identification import Estimate
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.analysis import MuscleAnalysis
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.identification.analysis import analyze
from rpms_ros.identification.analysis.dynamics import TrainDynamics
from rpms_ros.identification.analysis.dynamics import response_to_one_pulse
from rpms_ros.identification.analysis.dynamics import train_dynamics
from rpms_ros.identification.informed import informed_parameters
from rpms_ros.identification.informed import informed_physiology
from rpms_ros.identification.pulse_checks import of_one_intensity
from rpms_ros.identification.pulse_checks import outside_shares
from rpms_ros.identification.simulated_fit import weight_at_own_rate
from rpms_ros.identification.verdict import Verdict
from rpms_ros.identification.verdict import verdict_of
from rpms_ros.identification.verdict_settings import DOUBTFUL
from rpms_ros.identification.verdict_settings import GOOD
from rpms_ros.identification.verdict_settings import VerdictSettings
from rpms_ros.muscle import RecruitmentParameters
from rpms_ros.muscle import identified_recruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import Recording
from rpms_ros.recording import session_hash
from rpms_ros.recording.schedules import RecordedSchedule
from rpms_ros.report.course import Change
from rpms_ros.report.course import course_of
from rpms_ros.report.identified import FOLLOWED
from rpms_ros.report.steadiness import steadiness
from rpms_ros.schema import documented

ONE_INTENSITY = (
    'all pulses have nearly one intensity: only the product of recruitment and dynamics can be '
    'identified; there is no recruitment curve, and the impulse response is that of a pulse of '
    'this intensity'
)
Value = TypeVar('Value')
IDENTIFIABILITY = {NOT_INFORMED: 'not informed', INFORMED: 'informed', CONVERGED: 'converged'}


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Recruitment curve as steady mean force."""

    intensity: FloatArray = documented('share of the maximum')
    force: FloatArray = documented('[N]')
    lower: FloatArray | None = documented('lower end of the interval [N]', default=None)
    upper: FloatArray | None = documented('upper end of the interval [N]', default=None)


@dataclass(frozen=True, kw_only=True)
class ImpulseResponse:
    """Force after one pulse at full intensity; without a curve, at the intensity of the pulses."""

    time_s: FloatArray = documented('time after the pulse [s]')
    force: FloatArray = documented('[N]')
    lower: FloatArray | None = documented('lower end of the interval [N]', default=None)
    upper: FloatArray | None = documented('upper end of the interval [N]', default=None)


@dataclass(frozen=True)
class Stated:
    """A number with its interval."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class IdentificationResult:
    """Result of a recording; what cannot be determined is null."""

    session_hash: str = documented('hash of pulses and force: the same data, the same hash')
    schedules: list[RecordedSchedule] = documented('schedules that a driver accepted, as recorded')
    estimator: str = documented('name of the algorithm')
    unit: str = documented('of every force: N, or N m where the sensor measured a torque')
    samples: int = documented('force samples that were processed')
    pulses: int = documented('pulses that were used')
    duration_s: float = documented('from the first to the last force sample [s]')
    rate_hz: float = documented('repetition rate for which the curve is stated [Hz]')
    recruitment: dict[str, float] | None = documented(
        'parameters of the recruitment curve; null where the data do not determine one'
    )
    curve: Curve | None
    impulse_response: ImpulseResponse
    confidence: float | None = documented('level of the intervals', default=None)
    identifiability: dict[str, str] | None = documented(
        'whether the data determine each parameter', default=None
    )
    deviation: dict[str, float] | None = documented(
        'standard deviation of each parameter that the data determine', default=None
    )
    physiology: dict[str, Stated] | None = documented(
        'informed numbers of the twitch; the unit is part of the name',
        default=None,
    )
    dynamics: TrainDynamics | None = documented(
        'trains of one intensity at their own rate; null where there is a curve, or no train',
        default=None,
    )
    steadiness: str | None = documented(
        'whether the muscle stayed the same, as a sentence; for an estimator that follows changes',
        default=None,
    )
    changes: list[Change] | None = documented('sudden changes that were found', default=None)
    rates: dict[str, Stated] | None = documented(
        'what changed slowly at the end, per minute: force and time constant in per cent, '
        'thresholds as shares of the maximum',
        default=None,
    )
    output_error_n: float = documented(
        'root mean square of measured minus predicted force, after settling [N]'
    )
    output_error_of_range: float = documented('the same as share of the range of the force')
    faults: dict[str, int] = documented('faults of the data, and how often each')
    notes: list[str] = documented('warnings')
    verdict: Verdict = documented('whether the result may be used, and why')

    @property
    def without_curve(self) -> str:
        """Why there is no curve, in the words of an error."""
        if ONE_INTENSITY in self.notes:
            return 'expected pulses of several intensities, got nearly one intensity'
        return f'expected data that determine a recruitment curve, got {self.verdict.line}'


def result_of(
    recording: Recording,
    session: IdentifiedSession,
    settings: VerdictSettings | None = None,
) -> IdentificationResult:
    """Return the result of a session; intervals and physiology if the estimator offers them.

    Parameters
    ----------
    recording, session : Recording, IdentifiedSession
        The recording and its identification.
    settings : VerdictSettings, optional
        Thresholds of the verdict.

    Raises
    ------
    ReportError
        If the response to a pulse is not finite.
    """
    last, stamps = session.last, recording.forces.stamp_ns
    dynamics = None if last.curve_known else _dynamics(recording)
    known, names = last.curve_known, last.nonlinear_names
    informed = informed_parameters(last)
    course = course_of(session)
    flags = [IDENTIFIABILITY[flag] for flag in last.nonlinear_identifiability.tolist()]
    variance = np.maximum(np.diag(last.nonlinear_covariance), 0.0)
    response = impulse_response(recording.pulses, session, dynamics)
    if not (np.isfinite(response).all() and np.isfinite(last.curve_force).all()):
        raise ReportError('expected data that lead to finite forces, got a response without')
    return IdentificationResult(
        session_hash=session_hash(recording),
        schedules=list(recording.facts.schedules),
        estimator=last.estimator,
        unit=last.unit,
        samples=len(session.stamp_ns),
        pulses=last.pulses,
        duration_s=float(stamps.max() - stamps.min()) / NANOSECONDS_PER_SECOND,
        rate_hz=last.repetition_rate,
        recruitment=_by_name(names, np.where(informed, last.nonlinear, np.nan).tolist())
        if known
        else None,
        curve=Curve(
            intensity=last.curve_intensity,
            force=last.curve_force,
            lower=_if_any(last.curve_lower),
            upper=_if_any(last.curve_upper),
        )
        if known
        else None,
        impulse_response=ImpulseResponse(
            time_s=last.response_time,
            force=response,
            lower=_if_any(last.response_lower) if known else None,
            upper=_if_any(last.response_upper) if known else None,
        ),
        confidence=last.confidence or None,
        identifiability=_by_name(names, flags),
        deviation=_by_name(names[: len(variance)], _deviations(variance, informed)),
        physiology=_physiology(last) or None,
        dynamics=dynamics,
        steadiness=steadiness(course) if course.follows else None,
        changes=course.changes or None,
        rates=_rates(last) or None,
        output_error_n=session.output_error.newton,
        output_error_of_range=session.output_error.of_range,
        faults={**recording.facts.faults, **last.faults},
        notes=[
            *recording.facts.remarks,
            *([ONE_INTENSITY] if not known and of_one_intensity(recording.pulses, stamps) else []),
            *([FOLLOWED] if FOLLOWED in last.reasons else []),
        ],
        verdict=_of_the_file(
            verdict_of(session, recording.pulses, recording.forces, settings, dynamics), recording
        ),
    )


def _of_the_file(verdict: Verdict, recording: Recording) -> Verdict:
    """Return the verdict, at most doubtful where a part of the recording is lost."""
    if recording.loss is None:
        return verdict
    if verdict.grade == GOOD:
        return Verdict(grade=DOUBTFUL, reasons=(recording.loss,))
    return replace(verdict, reasons=(*verdict.reasons, recording.loss))


def _dynamics(recording: Recording) -> TrainDynamics | None:
    analysis = analysis_of(recording)
    return None if analysis is None else train_dynamics(analysis)


def trains_of(recording: Recording, result: IdentificationResult) -> SummationAnalysis | None:
    """Return the trains that stand for a result without a curve; None for any other result."""
    analysis = None if result.dynamics is None else analysis_of(recording)
    return None if analysis is None else analysis.summation


def analysis_of(recording: Recording) -> MuscleAnalysis | None:
    """Return twitches and trains of a recording; None if they cannot be analysed."""
    try:
        return analyze(recording.pulses, recording.forces)
    except IdentificationError:
        return None


def impulse_response(
    pulses: PulseTrain, session: IdentifiedSession, dynamics: TrainDynamics | None = None
) -> FloatArray:
    """Return the response to one pulse (times,) [N].

    At full intensity; where the recruitment is not known, at intensity and rate of the pulses,
    since the response to any other is not determined.  Without a pulse whose intensity is a share
    of the maximum it is at full intensity, too.  With `dynamics` it is that of the model of the
    trains: the estimator takes their pulses for equal.
    """
    estimate = session.last
    if estimate.curve_known:
        return estimate.response_force
    if dynamics is not None:
        return response_to_one_pulse(dynamics, estimate.response_time)
    parameters = RecruitmentParameters(*estimate.nonlinear.tolist())
    shares = pulses.intensity[~outside_shares(pulses.intensity)]
    applied = float(np.median(shares)) if len(shares) else 1.0
    share = identified_recruitment(parameters, applied) / identified_recruitment(parameters, 1.0)
    kept = np.flatnonzero(session.usable)
    kept = kept[np.argsort(session.stamp_ns[kept], kind='stable')]
    weight = weight_at_own_rate(estimate, pulses, session.stamp_ns[kept], session.force[kept])
    return estimate.response_force * float(share) * weight


def _physiology(estimate: Estimate) -> dict[str, Stated]:
    """Return the informed numbers, by name."""
    columns = (estimate.physiology, estimate.physiology_lower, estimate.physiology_upper)
    rows = np.stack(columns, axis=1)
    return {
        estimate.physiology_names[index]: Stated(*rows[index].tolist())
        for index in informed_physiology(estimate)
    }


def _rates(estimate: Estimate) -> dict[str, Stated]:
    """Return slow changes per minute, by name."""
    rows = np.stack((estimate.rate, estimate.rate_lower, estimate.rate_upper), axis=1)
    return {
        name: Stated(*row) for name, row in zip(estimate.rate_names, rows.tolist(), strict=True)
    }


def _deviations(variance: FloatArray, informed: BoolArray) -> list[float]:
    """Return standard deviations, NaN where a parameter is not informed."""
    if not len(variance):
        return []
    deviations: list[float] = np.where(informed, np.sqrt(variance), np.nan).tolist()
    return deviations


def _by_name(names: Sequence[str], values: Sequence[Value]) -> dict[str, Value] | None:
    """Return values by their names, None if there are none."""
    return dict(zip(names, values, strict=True)) if len(values) else None


def _if_any(values: FloatArray) -> FloatArray | None:
    return values if len(values) else None
