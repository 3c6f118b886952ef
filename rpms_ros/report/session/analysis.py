# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Content of a report on one session, computed before anything is drawn.

Fields of the rPMS reporting checklist, filled as far as the recording allows.

The checklist is the outcome of a Delphi study: Schneider, Zangrandi, Sollmann, Bonfert, Beaulieu
and the rPMS Consensus Group, Front. Neurol. 13:852848, 2022 (doi 10.3389/fneur.2022.852848).  It
has 35 items: 8 on the subject, 16 on the method, 11 on the stimulation protocol.  Named here are
those in the abstract and at the beginning of Table 2 of the publication, in our own words:
all 8 on the subject (those of the table on which at least three quarters agreed), 7 on the
method, 2 on the protocol.  For the others see the publication.

First screen of a report: the muscle in a few numbers, and what to do next.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification import Estimator, IdentifiedSession, identify
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.pulses import BoolArray, FloatArray
from rpms_ros.recording import Recording
from rpms_ros.report.course import Change, Course, course_of, steadiness
from rpms_ros.report.known_muscle import KnownMuscle, known_muscle
from rpms_ros.report.recorded import RecordedMessages
from rpms_ros.report.result import IdentificationResult, trains_of
from rpms_ros.report.session.dose import DeviceLoad, Dose, dose_of, load_of
from rpms_ros.report.session.residuals import (
    HELD_OUT_SHARE,
    FrozenFrom,
    HeldOutFit,
    ResidualAnalysis,
    analyse_residuals,
    boundary,
    held_out_fit,
)
from rpms_ros.report.text import RATE_WORDS
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification

SOURCE = (
    'Schneider C, Zangrandi A, Sollmann N, Bonfert MV, Beaulieu LD, rPMS Consensus Group. '
    'Checklist on the Quality of the Repetitive Peripheral Magnetic Stimulation (rPMS) Methods '
    'in Research: An International Delphi Study. Front Neurol 13:852848, 2022. '
    'doi:10.3389/fneur.2022.852848'
)
ITEMS_OF_THE_CONSENSUS = {'subject': 8, 'method': 16, 'protocol': 11}
"""How many items each part of the published checklist has."""


@dataclass(frozen=True)
class ChecklistItem:
    """One item of the checklist with its value.

    Attributes
    ----------
    key : str
        Name of the item in the notes of a recording and in the option of the command.
    part : str
        ``subject``, ``method`` or ``protocol``.
    label : str
        Question of the item.
    value, origin : str or None
        Value and where it comes from; None if it is not known.
    """

    key: str
    part: str
    label: str
    value: str | None
    origin: str | None


_TEXTS = (
    ('age', 'subject', 'Age'),
    ('sex', 'subject', 'Sex, gender'),
    ('handedness', 'subject', 'Handedness or footedness'),
    ('condition', 'subject', 'Condition of this participant, such as affected side'),
    ('medication', 'subject', 'Prescribed medication, drugs acting on the CNS'),
    ('symptoms', 'subject', 'Symptoms of the condition and their intensity'),
    ('comorbidity', 'subject', 'Comorbidity'),
    ('exclusion_criteria', 'subject', 'Exclusion criteria related to rPMS'),
    ('coil_location', 'method', 'Coil location, and how the place was found'),
    ('coil_type', 'method', 'Coil type: size and geometry'),
    ('coil_orientation', 'method', 'Coil orientation'),
    ('current_direction', 'method', 'Direction of the induced current'),
    ('coil_specifics', 'method', 'Technical data of the coil, such as peak field'),
    ('stimulator', 'method', 'Type of stimulator'),
    ('pulse_duration', 'method', 'Pulse duration'),
    ('paradigm', 'protocol', 'Paradigm of stimulation'),
    ('number_of_pulses', 'protocol', 'Number of pulses'),
)
ITEMS = tuple(ChecklistItem(*texts, None, None) for texts in _TEXTS)
KEYS = tuple(item.key for item in ITEMS)


def checklist_of(
    dose: Dose,
    notes: Mapping[str, str],
    stated: Mapping[str, str] | None = None,
) -> list[ChecklistItem]:
    """Return the items in their order, each with the best that is known.

    Parameters
    ----------
    dose : Dose
        Pulses of the recording.
    notes : mapping of str to str
        Notes of the recording.
    stated : mapping of str to str, optional
        Values given by the user; they have priority.

    Raises
    ------
    ReportError
        If a given item is not in the checklist.
    """
    stated = stated or {}
    if unknown := sorted(set(stated) - set(KEYS)):
        raise ReportError(
            f'expected items of the checklist ({", ".join(KEYS)}), got {", ".join(unknown)}'
        )
    sources = (
        (stated, 'stated for this report'),
        (notes, 'notes in the recording'),
        (_measured(dose), 'pulses of the recording'),
    )
    return [_filled(item, sources) for item in ITEMS]


def _filled(
    item: ChecklistItem, sources: Sequence[tuple[Mapping[str, str], str]]
) -> ChecklistItem:
    for values, origin in sources:
        if value := values.get(item.key, '').strip():
            return replace(item, value=value, origin=origin)
    return item


def _measured(dose: Dose) -> dict[str, str]:
    """Return the items that follow from the pulses."""
    if dose.intensity is None:
        return {}
    paradigm = f'{dose.trains} train{"s" if dose.trains > 1 else ""}'
    if dose.rate_hz:
        paradigm += f' at {dose.rate_hz["median"]:.4g} Hz (median)'
    intensity = _range(dose.intensity['lowest'], dose.intensity['highest'], 100.0, '%')
    known = {
        'number_of_pulses': str(dose.pulses),
        'paradigm': f'{paradigm}, {dose.stimulated_s:.4g} s within trains, intensity {intensity}',
    }
    if dose.pulse_width_s:
        widths = dose.pulse_width_s[0], dose.pulse_width_s[-1]
        known['pulse_duration'] = _range(*widths, 1e6, 'µs')
    return known


def _range(low: float, high: float, scale: float, unit: str) -> str:
    first, last = f'{scale * low:.4g}', f'{scale * high:.4g}'
    return f'{first} {unit}' if first == last else f'{first} to {last} {unit}'


_SHOWN = (0.5, 1.0)
# Change of the force between sessions that is not mentioned, if no interval is known.
_SMALL = 0.1
# Force not caused by the stimulation is mentioned above this share of the range of the force.
_EFFORT = 0.05
_ADVICE = (
    ('sign or axis', 'Record or read the force along another axis, or with the other --sign.'),
    ('another topic', 'Look whether the sensor was on and which topic and axis it published.'),
    ('noise only', 'Look at topic, axis and gain of the sensor, and whether the coil was placed.'),
    ('time in another unit', 'Import the recording again with the right --time-unit.'),
    ('do not overlap', 'Stamp pulses and force by one clock, or set both clocks.'),
    ('outside 0 to 1', 'Record intensities as shares of the maximum: 80 % is 0.8.'),
    ('is the force in kN', 'Import the recording again with the right --force-unit.'),
    ('grams or millinewtons', 'Import the recording again with the right --force-unit.'),
    ('converged', 'Identify again with --estimator batch, which uses all of the recording.'),
    ('a muscle only pulls', 'Identify again with --estimator batch, which uses all data.'),
    ('force_clipped', 'Use a larger range of the sensor, or lower intensities.'),
    (
        'the muscle changed',
        'Identify again with --estimator tracking, which follows a muscle that changes.',
    ),
    ('not white', 'Look at the force below: the patient may have tensed, or the coil moved.'),
    ('held out', 'Look at the time courses: what changed in the last part of the session?'),
    ('baseline drifts', 'Let the sensor warm up and zero it before the session.'),
    ('threshold', 'Use intensities around the threshold too: `rpms protocol` makes schedules.'),
    ('is known only as', 'Stimulate longer, or use random intensities up to the highest.'),
    ('force_unexplained', 'Look where the residual is largest: effort, spasm or a moved coil.'),
    ('explains', 'Identify again with --estimator batch, and look at the force below.'),
)
_NO_CURVE = 'For a recruitment curve, stimulate with several intensities.'
_USE = 'Use the curve. Keep coil and sensor where they are for the next session.'


@dataclass(frozen=True, kw_only=True)
class StatedForce:
    """Force at an intensity, with its interval where the estimator has one."""

    intensity: float
    force: float
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Rate of change of a quantity at the end of the session, per minute."""

    name: str
    label: str
    rate: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class Headline:
    """The first screen of a report."""

    steadiness: str
    next_steps: list[str]
    forces: list[StatedForce]
    threshold: float | None
    threshold_deviation: float | None
    changes: list[Change] = field(default_factory=list)
    rates: list[Rate] = field(default_factory=list)
    effort: str | None = None
    previous: list[str] = field(default_factory=list)


def headline_of(
    result: IdentificationResult,
    session: IdentifiedSession,
    previous: Mapping[str, Any] | None = None,
) -> Headline:
    """Return the first screen.

    Parameters
    ----------
    result, session : IdentificationResult, IdentifiedSession
        What was identified.
    previous : mapping, optional
        Output of `rpms identify --json` or `rpms report --json` of an earlier session.

    Raises
    ------
    ReportError
        If `previous` is no such document.
    """
    course = course_of(session)
    forces = stated_forces(result)
    return Headline(
        steadiness=steadiness(course),
        next_steps=_next_steps(result, course.changes),
        forces=forces,
        threshold=(result.recruitment or {}).get('u_thr'),
        threshold_deviation=(result.deviation or {}).get('u_thr') if result.recruitment else None,
        changes=course.changes,
        rates=rates_of(session),
        effort=_effort(course, session.force[session.usable], session.last.unit),
        previous=[] if previous is None else _compared(forces, result, previous),
    )


def stated_forces(result: IdentificationResult) -> list[StatedForce]:
    """Return the steady force at half and at full intensity; none without a curve."""
    curve = result.curve
    if curve is None:
        return []
    return [
        StatedForce(
            intensity=share,
            force=at_intensity(share, curve.intensity, curve.force),
            lower=None
            if curve.lower is None
            else at_intensity(share, curve.intensity, curve.lower),
            upper=None
            if curve.upper is None
            else at_intensity(share, curve.intensity, curve.upper),
        )
        for share in _SHOWN
    ]


def at_intensity(share: float, intensity: FloatArray, values: FloatArray) -> float:
    """Return the value of a curve (points,) at an intensity."""
    return float(np.interp(share, intensity, values))


def rates_of(session: IdentifiedSession) -> list[Rate]:
    """Return the rates of force, twitch and thresholds at the end; none if not determined."""
    last = session.last
    rows = zip(last.rate_names, last.rate, last.rate_lower, last.rate_upper, strict=True)
    return [
        Rate(
            name=name,
            label=RATE_WORDS.get(name, f'{name} a minute'),
            rate=float(rate),
            lower=float(lower),
            upper=float(upper),
        )
        for name, rate, lower, upper in rows
    ]


def _effort(course: Course, force: FloatArray, unit: str) -> str | None:
    """Return a sentence on force that the stimulation did not cause, None if there was none."""
    path = course.disturbance
    with np.errstate(invalid='ignore'):
        sure = course.settled & path.known & (path.lower > _EFFORT * float(np.ptp(force)))
    if not sure.any():
        return None
    largest = int(np.argmax(np.where(sure, path.value, -np.inf)))
    return (
        f'Up to {path.value[largest]:.3g} {unit} came from something else than the stimulation '
        f'(voluntary effort, spasm or a knock), most at {course.time_s[largest]:.0f} s.'
    )


def _next_steps(result: IdentificationResult, changes: list[Change]) -> list[str]:
    verdict = result.verdict
    moved = [change.time_s for change in changes if change.kind == 'thresholds']
    steps = [
        f'The curve is that of the coil after {at:.0f} s: fix it better.' for at in moved[-1:]
    ]
    if verdict.grade == 'good':
        if result.curve is not None:
            return steps or [_USE]
        known = 'T_a' if result.dynamics is None else 'onset, T_a'
        return steps or [f'Use {known} and latency. {_NO_CURVE}']
    steps += [step for reason in verdict.reasons for sign, step in _ADVICE if sign in reason]
    return list(dict.fromkeys(steps)) or ['Look at the reasons above, and record again.']


def _compared(
    forces: list[StatedForce], result: IdentificationResult, previous: Mapping[str, Any]
) -> list[str]:
    """Return sentences on the differences from an earlier session."""
    before = previous.get('result', previous)
    try:
        curve, rate = before['curve'], float(before['rate_hz'])
        if curve is None or not forces:
            return ['There is no curve in both sessions to compare.']
        told = [_difference(force, curve, result.unit) for force in forces]
    except (KeyError, TypeError, ValueError) as error:
        raise ReportError(
            f'expected what `rpms identify --json` or `rpms report --json` prints, got {error!r}'
        ) from error
    if before.get('unit', 'N') != result.unit:
        return ['One session measured a force, the other a torque: they cannot be compared.']
    if rate != result.rate_hz:
        told.append(f'The earlier curve is stated for {rate:g} Hz, this one for another rate.')
    return told


def _difference(now: StatedForce, curve: Mapping[str, Any], unit: str) -> str:
    what = QUANTITIES[unit].capitalize()
    intensity = np.asarray(curve['intensity'], dtype=np.float64)
    before = at_intensity(now.intensity, intensity, np.asarray(curve['force'], dtype=np.float64))
    text = (
        f'{what} at {100 * now.intensity:g} % intensity: {now.force:.3g} {unit}, {before:.3g} '
        f'{unit} last time ({100 * (now.force / before - 1.0):+.3g} %)'
        if before
        else f'{what} at {100 * now.intensity:g} % intensity: {now.force:.3g} {unit}, none before'
    )
    if 'lower' in curve and now.lower is not None and now.upper is not None:
        low, high = (
            at_intensity(now.intensity, intensity, np.asarray(curve[end], dtype=np.float64))
            for end in ('lower', 'upper')
        )
        apart = now.lower > high or now.upper < low
        return f'{text}: {"more than the intervals allow for" if apart else "no difference"}.'
    return f'{text}{": hardly a difference" if abs(now.force - before) < _SMALL * before else ""}.'


@dataclass(frozen=True)
class ReportSettings:
    """Settings of a report.

    Attributes
    ----------
    held_out_share : float
        Share of the time at the end that is predicted and not learnt from.
    residual_share : float
        Share of the time at the end whose a-priori residuals are analysed.
    device : DeviceSpecification or None
        Device for the energy; None leaves it in units of a pulse at full intensity.
    stated : mapping of str to str or None
        Items of the checklist given by the user.
    command : str
        The command line that makes the report; empty if there is none.
    previous : mapping or None
        JSON of an earlier session of the same person, to compare with.
    """

    held_out_share: float = HELD_OUT_SHARE
    residual_share: float = 0.2
    device: DeviceSpecification | None = None
    stated: Mapping[str, str] | None = None
    command: str = ''
    previous: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class SessionAnalysis:
    """Content of a report.

    Attributes
    ----------
    title : str
        Name of the session.
    recording : Recording
        Where it comes from.
    result : IdentificationResult
        As `rpms identify --json` prints it.
    session : IdentifiedSession
        Estimates and traces.
    dose : Dose
        Schedule and dose.
    load : DeviceLoad or None
        Energy on a device, if one was named.
    recorded : RecordedMessages
        Messages of the nodes in the recording.
    residuals : ResidualAnalysis or None
        None where they cannot be analysed.
    held_out : HeldOutFit or None
        None where nothing could be held out.
    checklist : list of ChecklistItem
        Items of the reporting checklist.
    settings : ReportSettings
        Settings.
    remarks : tuple of str
        Why something is missing.
    headline : Headline
        The first screen.
    truth : KnownMuscle or None
        The true muscle, where the recording was simulated.
    """

    title: str
    recording: Recording
    result: IdentificationResult
    session: IdentifiedSession
    dose: Dose
    load: DeviceLoad | None
    recorded: RecordedMessages
    residuals: ResidualAnalysis | None
    held_out: HeldOutFit | None
    checklist: list[ChecklistItem]
    settings: ReportSettings
    remarks: tuple[str, ...]
    headline: Headline
    truth: KnownMuscle | None = None

    @cached_property
    def trains(self) -> SummationAnalysis | None:
        """Trains of one intensity, if they stand for a recruitment curve."""
        return trains_of(self.recording, self.result)

    @cached_property
    def course(self) -> Course:
        """Quantities of the session over time."""
        return course_of(self.session)


def analyse(
    title: str,
    recording: Recording,
    recorded: RecordedMessages,
    session: IdentifiedSession,
    result: IdentificationResult,
    build_estimator: Callable[[], Estimator],
    settings: ReportSettings | None = None,
    progress: Callable[[int], object] | None = None,
) -> SessionAnalysis:
    """Return the content of a report.

    Parameters
    ----------
    title : str
        Name of the session.
    recording, recorded : Recording, RecordedMessages
        What was recorded.
    session, result : IdentifiedSession, IdentificationResult
        What was identified, and its result.
    build_estimator : callable
        Makes a fresh estimator for the held-out fit, like that of the session.
    settings : ReportSettings, optional
        Settings.
    progress : callable, optional
        Called with the number of samples of the held-out fit processed since the last call.

    Raises
    ------
    ReportError
        If a share is not between 0 and 1, or a given item is not in the checklist.
    """
    settings = settings or ReportSettings()
    dose = dose_of(recording.pulses, int(session.stamp_ns[0]))
    checklist = checklist_of(dose, recording.facts.custom, settings.stated)
    remarks: list[str] = []
    try:
        residuals = _residuals(session, recording, settings)
    except ReportError as error:
        residuals = None
        remarks.append(f'no residual analysis: {error}')
    first_ns = boundary(session.stamp_ns, settings.held_out_share)
    held_out = _held_out(recording, build_estimator, first_ns, progress)
    if held_out is None:
        remarks.append('no held-out fit: expected a force that changes in the held-out part')
    if recorded.unreadable:
        remarks.append(f'{recorded.unreadable} messages of nodes could not be decoded')
    return SessionAnalysis(
        title,
        recording,
        result,
        session,
        dose,
        load_of(dose, settings.device) if settings.device else None,
        recorded,
        residuals,
        held_out,
        checklist,
        settings,
        tuple(remarks),
        headline_of(result, session, settings.previous),
        known_muscle(recorded.truths, recording.facts.custom, session.last.repetition_rate),
    )


def last_part(session: IdentifiedSession, share: float) -> BoolArray:
    """Return which samples (samples,) were learnt from in the last `share` of the time."""
    span = int(session.stamp_ns[-1] - session.stamp_ns[0])
    chosen: BoolArray = session.usable & (
        session.stamp_ns >= session.stamp_ns[-1] - round(share * span)
    )
    return chosen


def _residuals(
    session: IdentifiedSession, recording: Recording, settings: ReportSettings
) -> ResidualAnalysis:
    if not 0.0 < settings.residual_share <= 1.0:
        raise ReportError(
            f'expected a share of residuals above 0 and up to 1, got {settings.residual_share}'
        )
    kept = last_part(session, settings.residual_share)
    residual = (session.force - session.prediction)[kept]
    return analyse_residuals(session.stamp_ns[kept], residual, recording.pulses)


def _held_out(
    recording: Recording,
    build_estimator: Callable[[], Estimator],
    first_ns: int,
    progress: Callable[[int], object] | None,
) -> HeldOutFit | None:
    frozen = FrozenFrom(build_estimator(), first_ns)
    arrival = recording.samples_before_pulse if frozen.on_line else None
    session = identify(
        frozen,
        recording.pulses,
        recording.forces,
        progress=progress,
        samples_before_pulse=arrival,
    )
    if not np.any(session.stamp_ns < first_ns):
        return None
    return held_out_fit(session, first_ns)
