# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result of an identification as one object: what ``rpms identify --json`` prints.

Its dataclasses are also what the report of a session and `rpms_ros.api` show.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import IdentificationError, ReportError
from rpms_ros.identification import (
    CONVERGED,
    DEFAULT_RATE,
    INFORMED,
    NOT_INFORMED,
    Estimator,
    IdentifiedSession,
    StreamSettings,
    identify,
)
from rpms_ros.identification.analysis import SummationAnalysis, analyze
from rpms_ros.identification.analysis.dynamics import (
    TrainDynamics,
    response_to_one_pulse,
    train_dynamics,
)
from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.identification.estimation.prior import FittedMuscle, warm_start
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.identification.model.settings import PAPER_PRESETS, PEOPLE_PRESET
from rpms_ros.identification.quality.doubts import (
    EXPECTED_FORCE,
    NO_CONSTANT_MUSCLE,
    SLOW_INTENSITIES,
)
from rpms_ros.identification.quality.explained_force import (
    Stated,
    informed_parameters,
    informed_physiology,
    is_no_twitch,
    stated,
    weight_at_own_rate,
)
from rpms_ros.identification.quality.verdict import (
    DOUBTFUL,
    FOLLOWER,
    GOOD,
    Verdict,
    doublings,
    period_of_estimates,
    verdict_of,
)
from rpms_ros.identification.stream.arrivals import of_one_intensity, outside_shares
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, PulseTrain
from rpms_ros.recording import Recording, session_hash
from rpms_ros.recording.rosbag.reading import RecordedSchedule
from rpms_ros.report.course import Change, course_of, steadiness
from rpms_ros.report.text import interval_of, label, recruitment_shown, shown, with_interval
from rpms_ros.schema import documented, internal

FOLLOWED = f'followed by {FOLLOWER}, since no constant muscle explains the whole recording'
"""Reason of estimates that were made in place of those of a fit of everything."""

# So many estimates tell when a muscle changed.
_COURSE = 1000


@dataclass(frozen=True)
class IdentificationOptions:
    """How a recording is identified.

    Attributes
    ----------
    estimator : str
        Name of the algorithm.  With ``batch``, a muscle that changed is followed by ``tracking``
        instead; see `identified`.
    preset : str
        ``people``, or one that reproduces the paper; see `PRESET_NAMES`.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].
    seed : int
        Of the estimator's random start.
    history : TemporalSummation or None
        What pulses do to those after them.
    start_from : Path or None
        JSON of the result of an earlier session.
    """

    estimator: str = 'batch'
    preset: str = PEOPLE_PRESET
    rate_hz: float = DEFAULT_RATE
    seed: int = 0
    history: TemporalSummation | None = None
    start_from: Path | None = None

    def build(self, unit: str = 'N') -> Estimator:
        """Return a new estimator for forces in a unit."""
        estimator = estimator_by_name(
            self.estimator, self.preset, self.seed, self.rate_hz, self.history
        )
        if self.start_from is not None:
            warm_start(estimator, self.start_from, unit)
        return estimator


def identified(
    recording: Recording,
    options: IdentificationOptions,
    progress: Callable[[int], object] | None = None,
    most_estimates: int | None = None,
) -> IdentifiedSession:
    """Return what an estimator makes of a recording, as it would have on line.

    Where no constant muscle explains a recording, a fit of all of it is a mixture.  ``batch`` says
    so, and `tracking` goes over the recording in its place if its predictions are better.

    Parameters
    ----------
    recording : Recording
        Pulses and forces.
    options : IdentificationOptions
        Which estimator, and how.
    progress : callable or None
        Called with the number of samples that were taken since the last call.
    most_estimates : int or None
        So many estimates are enough, evenly spaced, each of them one of those on line, and those
        that the verdict needs in any case; None makes all of them, ten a second.  The last one is
        the same in any case.

    Raises
    ------
    IdentificationError
        If no estimate at all is asked for, or see `build` and `identify`.
    """
    count = isinstance(most_estimates, int | np.integer) and most_estimates >= 1
    if most_estimates is not None and not count:
        fault = f'expected most_estimates as a whole number from 1 on, got {most_estimates!r}'
        raise IdentificationError(fault)
    session = replayed(recording, options.build(recording.unit), progress, most_estimates)
    # a preset of the paper is chosen for its model
    chosen = options.estimator == 'batch' and options.preset not in PAPER_PRESETS
    if chosen and NO_CONSTANT_MUSCLE in session.last.doubts:
        most = None if most_estimates is None else max(most_estimates, _COURSE)
        following = replace(options, estimator=FOLLOWER).build(recording.unit)
        other = replayed(recording, following, None, most)
        if _missed(other) < _missed(session):
            estimates = [replace(o, reasons=(*o.reasons, FOLLOWED)) for o in other.estimates]
            session = replace(other, estimates=estimates)
    if recording.unit == session.last.unit:
        return session
    # as the node does
    return replace(session, estimates=[replace(o, unit=recording.unit) for o in session.estimates])


def replayed(
    recording: Recording,
    estimator: Estimator,
    progress: Callable[[int], object] | None = None,
    most_estimates: int | None = None,
) -> IdentifiedSession:
    """Return what one estimator makes of a recording; parameters as of `identified`."""
    settings = StreamSettings(estimate_period=_period(recording, most_estimates))
    # Only what could have run on line has to leave out the pulses that came too late for it.
    arrival = recording.samples_before_pulse if estimator.on_line else None
    return identify(estimator, recording.pulses, recording.forces, settings, progress, arrival)


def _missed(session: IdentifiedSession) -> float:
    """Return the median square of the prediction errors over the later half [N^2].

    An unheard pulse or a knock says nothing of the muscle, and has the largest ones.
    """
    error = (session.force - session.prediction)[session.usable]
    later = error[len(error) // 2 :]
    return float(np.median(later**2)) if len(later) else 0.0


def _period(recording: Recording, most_estimates: int | None) -> float:
    """Return a whole multiple of the period on line [s]: every estimate is one of those."""
    on_line = StreamSettings().estimate_period
    if most_estimates is None:
        return on_line
    stamps = recording.forces.stamp_ns
    duration = float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND if len(stamps) else 0.0
    enough = on_line * doublings(duration / (on_line * most_estimates))
    return min(enough, period_of_estimates(duration))


NO_CHECKSUMS = 'the recording has no checksums: a change of its numbers would not be noticed'
ONE_INTENSITY = (
    'all pulses have nearly one intensity: only the product of recruitment and dynamics can be '
    'identified; there is no recruitment curve, and the impulse response is that of a pulse of '
    'this intensity'
)
NOT_A_TWITCH = (
    'not the course of a twitch of the model: the twitch stated is the closest to it; rely on '
    'neither peak'
)
_CURVE_SHOWN = (0.25, 0.5, 0.75, 1.0)
IDENTIFIABILITY = {NOT_INFORMED: 'not informed', INFORMED: 'informed', CONVERGED: 'converged'}


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Recruitment curve as steady mean force."""

    intensity: FloatArray = documented('share of the maximum')
    force: FloatArray = documented('[N]')
    lower: FloatArray | None = documented('lower end of the interval [N]', default=None)
    upper: FloatArray | None = documented('upper end of the interval [N]', default=None)

    def at(self, intensity: float) -> Stated:
        """Return the force at an intensity; ends that are not known are NaN [N]."""
        return _read(self, lambda row: float(np.interp(intensity, self.intensity, row)))


@dataclass(frozen=True, kw_only=True)
class ImpulseResponse:
    """Force after one pulse at full intensity; without a curve, at the intensity of the pulses."""

    time_s: FloatArray = documented('time after the pulse [s]')
    force: FloatArray = documented('[N]')
    lower: FloatArray | None = documented('lower end of the interval [N]', default=None)
    upper: FloatArray | None = documented('upper end of the interval [N]', default=None)

    @property
    def peak_time_s(self) -> float:
        """Time of the largest force [s]."""
        return float(self.time_s[np.argmax(self.force)])

    @property
    def peak(self) -> Stated:
        """The largest force; ends that are not known are NaN [N]."""
        return _read(self, lambda row: float(row[np.argmax(self.force)]))


def _read(found: Curve | ImpulseResponse, value: Callable[[FloatArray], float]) -> Stated:
    rows = (found.force, found.lower, found.upper)
    return Stated(*(np.nan if row is None else value(row) for row in rows))


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
        'informed numbers of the twitch; the unit is part of the name', default=None
    )
    dynamics: TrainDynamics | None = documented(
        'trains of one intensity at their own rate; null where there is a curve, or no train',
        default=None,
    )
    # they stand for the curve, in figures too
    trains: SummationAnalysis | None = internal(default=None, repr=False)
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
    muscle: FittedMuscle | None = documented('for a warm start', default=None)
    output_error_n: float = documented(
        'root mean square of measured minus predicted force, after settling [N]'
    )
    output_error_of_range: float = documented('the same as share of the range of the force')
    faults: dict[str, int] = documented('faults of the data, and how often each')
    notes: list[str] = documented('warnings')
    verdict: Verdict = documented('whether the result may be used, and why')

    def interval(self, name: str) -> tuple[float, float] | None:
        """Return the ends of the interval of a parameter of the recruitment curve, if any."""
        value = (self.recruitment or {}).get(name, np.nan)
        return interval_of(name, value, (self.deviation or {}).get(name), self.confidence)

    @property
    def is_no_twitch(self) -> bool:
        """Whether two peaks differ: see `NOT_A_TWITCH`."""
        twitch = (self.physiology or {}).get('twitch_peak_n')
        return is_no_twitch(twitch, self.impulse_response.peak.value)


def result_of(
    recording: Recording, session: IdentifiedSession, expected_force: float = EXPECTED_FORCE
) -> IdentificationResult:
    """Return the result of a session; intervals and physiology if the estimator offers them.

    Parameters
    ----------
    recording, session : Recording, IdentifiedSession
        The recording and its identification.
    expected_force : float
        Largest force that the muscle can have [N], for the verdict.

    Raises
    ------
    ReportError
        If the response to a pulse is not finite.
    """
    last, stamps, pulses = session.last, recording.forces.stamp_ns, recording.pulses
    known, names = last.curve_known, last.nonlinear_names
    trains, dynamics = (None, None) if known else _trains(recording)
    informed = informed_parameters(last)
    course = course_of(session)
    flags = [IDENTIFIABILITY[flag] for flag in last.nonlinear_identifiability.tolist()]
    deviation = np.sqrt(np.maximum(np.diag(last.nonlinear_covariance), 0.0))
    response = impulse_response(pulses, session, dynamics)
    if not (np.isfinite(response).all() and np.isfinite(last.curve_force).all()):
        raise ReportError('expected data that lead to finite forces, got a response without')
    notes = [*recording.facts.remarks]
    notes += [] if recording.facts.checksums else [NO_CHECKSUMS]
    notes += [ONE_INTENSITY] if not known and of_one_intensity(pulses, stamps) else []
    notes += [reason for reason in (SLOW_INTENSITIES, FOLLOWED) if reason in last.reasons]
    verdict = verdict_of(session, pulses, recording.forces, expected_force, dynamics)
    lower, upper = _if_any(last.curve_lower), _if_any(last.curve_upper)
    curve = Curve(intensity=last.curve_intensity, force=last.curve_force, lower=lower, upper=upper)
    band = {'lower': _if_any(last.response_lower), 'upper': _if_any(last.response_upper)}
    band = band if known else {}
    return IdentificationResult(
        session_hash=session_hash(recording),
        schedules=list(recording.facts.schedules),
        estimator=last.estimator,
        unit=last.unit,
        samples=len(session.stamp_ns),
        pulses=last.pulses,
        duration_s=float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND,
        rate_hz=last.repetition_rate,
        recruitment=_informed(names, last.nonlinear, informed) if known else None,
        curve=curve if known else None,
        impulse_response=ImpulseResponse(time_s=last.response_time, force=response, **band),
        confidence=last.confidence or None,
        identifiability=dict(zip(names, flags, strict=True)) if flags else None,
        deviation=_informed(names, deviation, informed) if len(deviation) else None,
        physiology=informed_physiology(last) or None,
        dynamics=dynamics,
        trains=trains,
        steadiness=steadiness(course) if course.follows else None,
        changes=course.changes or None,
        rates=stated(last.rate_names, last.rate, last.rate_lower, last.rate_upper) or None,
        muscle=session.muscle,
        output_error_n=session.output_error.newton,
        output_error_of_range=session.output_error.of_range,
        faults={**recording.facts.faults, **last.faults},
        notes=notes,
        verdict=_of_the_file(verdict, recording),
    )


def _of_the_file(verdict: Verdict, recording: Recording) -> Verdict:
    """Return the verdict, at most doubtful where a part of the recording is lost."""
    if recording.loss is None:
        return verdict
    if verdict.grade == GOOD:
        return Verdict(grade=DOUBTFUL, reasons=(recording.loss,))
    return replace(verdict, reasons=(*verdict.reasons, recording.loss))


def _trains(recording: Recording) -> tuple[SummationAnalysis | None, TrainDynamics | None]:
    """Return the trains of a recording and their dynamics; None if there are none."""
    try:
        analysis = analyze(recording.pulses, recording.forces)
    except IdentificationError:
        return None, None
    return analysis.summation, train_dynamics(analysis)


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
    shares = pulses.intensity[~outside_shares(pulses.intensity)]
    applied = float(np.median(shares)) if len(shares) else 1.0
    share = estimate.relative_recruitment(np.array([applied]))[0]
    kept = np.flatnonzero(session.usable)
    kept = kept[np.argsort(session.stamp_ns[kept], kind='stable')]
    weight = weight_at_own_rate(estimate, pulses, session.stamp_ns[kept], session.force[kept])
    return estimate.response_force * float(share) * weight


def _informed(names: Sequence[str], values: FloatArray, informed: BoolArray) -> dict[str, float]:
    """Return values by name, NaN where a parameter is not informed."""
    return dict(zip(names, np.where(informed, values, np.nan).tolist(), strict=True))


def _if_any(values: FloatArray) -> FloatArray | None:
    return values if len(values) else None


def result_rows(result: IdentificationResult) -> Iterator[tuple[str, str]]:
    """Yield the result for people as labels and texts, the verdict first."""
    first, *others = result.verdict.reasons
    counts = f'{counted(result.samples, "sample")}, {counted(result.pulses, "pulse")}'
    yield 'verdict', f'{result.verdict.grade}: {first}'
    yield from (('', reason) for reason in others)
    yield 'estimator', FOLLOWED if FOLLOWED in result.notes else result.estimator
    yield 'data', f'{counts}, {result.duration_s:.3f} s'
    yield 'session hash', result.session_hash
    yield from (('schedule', f'{one.name}, sha256 {one.sha256}') for one in result.schedules)
    # What must not be used is not there to be copied.
    if result.verdict.grade != 'no':
        yield from _found(result)
        if result.steadiness is not None:
            yield 'the muscle', result.steadiness
    if result.dynamics is None:
        yield 'prediction error', _output_error(result)
    faults = (f'{name} {count}' for name, count in result.faults.items())
    yield 'faults', ', '.join(faults) or 'none'


def _found(result: IdentificationResult) -> list[tuple[str, str]]:
    """Return the rows of what was identified; nothing that the data do not tell."""
    unit, curve, rows = result.unit, result.curve, []
    if curve is None:
        rows.append(('recruitment', 'cannot be told from one intensity'))
    else:
        flags, deviations = result.identifiability or {}, result.deviation or {}
        for name, value in (result.recruitment or {}).items():
            known = (deviations.get(name), result.confidence, flags.get(name))
            rows.append((label(name), recruitment_shown(name, value, *known)))
        what = f'steady {QUANTITIES[unit]} at {result.rate_hz:g} Hz'
        for share in _CURVE_SHOWN:
            force = with_interval(vars(curve.at(share)), unit=f' {unit}')
            rows.append((what, f'{force} at intensity {share:g}'))
            what = ''
    if result.dynamics is not None:
        return [*rows, *train_rows(result.dynamics, unit)]
    for name, one in (result.physiology or {}).items():
        rows.append((label(name), shown(name, vars(one), unit)))
    response = result.impulse_response
    peak = with_interval(vars(response.peak), unit=f' {unit}')
    after = f'{1e3 * response.peak_time_s:.0f} ms'
    rows.append(('response to one pulse', f'peak {peak} after {after}'))
    return [*rows, ('', NOT_A_TWITCH)] if result.is_no_twitch else rows


def train_rows(found: TrainDynamics, unit: str) -> Iterator[tuple[str, str]]:
    """Yield the rows of trains of one intensity."""
    onset, model = found.onset_s, found.model
    trains = f'{found.trains} with {found.pulses} pulses at {found.rate_hz:.4g} Hz'
    fits = {
        model: found.fit_percent,
        'equal pulses': found.fit_equal_percent,
        'a gain a pulse': found.fit_gains_percent,
    }
    fit = ', '.join(f'{name} {percent:.1f} %' for name, percent in fits.items())
    yield 'trains', f'{trains}, peak {found.peak_force:.4g} {unit}'
    yield f'onset of {QUANTITIES[unit]}', _milliseconds(onset) if onset else 'hidden by noise'
    yield f'T_a, {model}', f'{_milliseconds(found.twitch_time_constant_s)}, order {found.order}'
    yield f'delay of the model, {model}', _milliseconds(found.latency_s)
    yield 'fit', f'{fit} (100 (1 - |residual| / |force - mean|))'
    if found.law:
        numbers = (f'{name} {value:.3g}' for name, value in vars(found.law).items())
        yield 'history law', '  '.join(numbers)


def _milliseconds(found: object) -> str:
    return with_interval(vars(found), 1e3, ' ms')


def _output_error(result: IdentificationResult) -> str:
    """Return the output error in words."""
    what, of_range = QUANTITIES[result.unit], result.output_error_of_range
    if not np.isfinite(result.output_error_n):
        return 'unknown: no usable sample was predicted before it was learnt'
    share = f'{100 * of_range:.3g} % of the range of the {what}'
    share = share if np.isfinite(of_range) else f'no {what}'
    how = 'root mean square after settling, each sample predicted before it was learnt'
    return f'{result.output_error_n:.3g} {result.unit}, {share} ({how})'
