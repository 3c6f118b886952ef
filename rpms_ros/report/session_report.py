# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report of one session, computed before anything is drawn; its fields are its JSON document.

It is the result of the identification with its course over time, residuals, dose, facts of the
recording and a sentence for a paper.
"""

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from rpms_ros import __version__
from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.quality.doubts import MEANING
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray
from rpms_ros.recording import Recording
from rpms_ros.report.course import Course, Flag, course_of, steadiness
from rpms_ros.report.dose import Dose, dose_of
from rpms_ros.report.known_muscle import KnownMuscle, known_muscle
from rpms_ros.report.recorded import DriverTotals, RecordedMessages
from rpms_ros.report.residuals import ResidualAnalysis, analyse_residuals
from rpms_ros.report.result import NOT_A_TWITCH, IdentificationResult
from rpms_ros.schema import internal, plain

# Share of the time at the end whose a-priori residuals are analysed.
_RESIDUAL_SHARE = 0.2

SHARES_SHOWN = (0.5, 1.0)
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
        'no_constant_muscle',
        'Identify again with --estimator tracking, which follows a muscle that changes.',
    ),
    ('not white', 'Look at the force below: the patient may have tensed, or the coil moved.'),
    ('held out', 'Look at the time courses: what changed in the last part of the session?'),
    ('baseline drifts', 'Let the sensor warm up and zero it before the session.'),
    ('threshold', 'Use intensities around the threshold too: `rpms protocol` makes schedules.'),
    ('is known only as', 'Stimulate longer, or use random intensities up to the highest.'),
    ('force_unexplained', 'Look where the residual is largest: effort, spasm or a moved coil.'),
    (
        'identified muscle explains',
        'Look at the force below, and whether the intensity of each pulse was recorded.',
    ),
)
_NO_CURVE = 'For a recruitment curve, stimulate with several intensities.'
_USE = 'Use the curve. Keep coil and sensor where they are for the next session.'


@dataclass(frozen=True, kw_only=True)
class Headline:
    """The first screen of a report: what the muscle did, and what to do next."""

    steadiness: str
    next_steps: list[str]
    effort: str | None = None


def headline_of(result: IdentificationResult, session: IdentifiedSession) -> Headline:
    """Return the first screen.

    Parameters
    ----------
    result, session : IdentificationResult, IdentifiedSession
        What was identified.
    """
    course = course_of(session)
    return Headline(
        steadiness=steadiness(course) if result.verdict.grade != 'no' else 'Not known.',
        next_steps=_next_steps(result),
        effort=_effort(course, session.force[session.usable], session.last.unit),
    )


def _effort(course: Course, force: FloatArray, unit: str) -> str | None:
    """Return a sentence on force that the stimulation did not cause, None if there was none."""
    path = course.disturbance
    with np.errstate(invalid='ignore'):
        sure = course.settled & path.known & (path.lower > _EFFORT * float(np.ptp(force)))
    if not sure.any():
        return None
    largest = int(np.argmax(np.where(sure, path.value, -np.inf)))
    most, when = f'{path.value[largest]:.3g} {unit}', f'{course.time_s[largest]:.0f} s'
    other = 'something else than the stimulation (voluntary effort, spasm or a knock)'
    return f'Up to {most} came from {other}, most at {when}.'


def _next_steps(result: IdentificationResult) -> list[str]:
    verdict = result.verdict
    moved = [change.time_s for change in result.changes or () if change.kind == 'thresholds']
    steps = [
        f'The curve is that of the coil after {at:.0f} s: fix it better.' for at in moved[-1:]
    ]
    if verdict.grade == 'good':
        if result.curve is not None:
            return steps or [_USE]
        if result.dynamics is None and result.physiology is None:
            return steps or [_NO_CURVE]
        known = 'T_a' if result.dynamics is None else 'onset, T_a'
        return steps or [f'Use {known} and latency. {_NO_CURVE}']
    steps += [
        step
        for reason in verdict.reasons
        for sign, step in _ADVICE
        if sign in reason and f'--estimator {result.estimator},' not in step
    ]
    return list(dict.fromkeys(steps)) or ['Look at the reasons above, and record again.']


@dataclass(frozen=True, kw_only=True)
class SessionReport:
    """Every number that the page of a session shows, and what its figures are drawn from.

    Forces in N, times in s, rates in Hz, energies in J, intensities as shares of the maximum.

    Attributes
    ----------
    title : str
        Name of the session.
    headline : Headline
        The first screen.
    result : IdentificationResult
        As `rpms identify --json` prints it.
    twitch : dict
        Peak, time to peak and half relaxation of the response to one pulse, and a remark on it.
    flags : list of Flag
        Doubtful parts of the session.
    truth : dict or None
        Errors of the result, where the recording was simulated.
    residuals : ResidualAnalysis or None
        None where they cannot be analysed.
    faults : list of dict
        Name, count and meaning of each.
    schedule : Dose
        Schedule and dose.
    driver : DriverTotals or None
        Totals that a driver published.
    session : dict
        Facts of the recording.
    methods : dict
        Sentence for a paper, command, versions.
    remarks : list of str
        Warnings, and why something is missing.
    recording : Recording
        Where it comes from.
    identified : IdentifiedSession
        Estimates and traces.
    course : Course
        Quantities of the session over time.
    true_muscle : KnownMuscle or None
        The true muscle, where the recording was simulated.
    """

    title: str
    headline: Headline
    result: IdentificationResult
    twitch: dict[str, float | str | None]
    flags: list[Flag]
    truth: dict[str, Any] | None
    residuals: ResidualAnalysis | None
    faults: list[dict[str, str | int]]
    schedule: Dose
    driver: DriverTotals | None
    session: dict[str, Any]
    methods: dict[str, Any]
    remarks: list[str]
    recording: Recording = internal()
    identified: IdentifiedSession = internal()
    course: Course = internal()
    true_muscle: KnownMuscle | None = internal()


def report_of(
    title: str,
    recording: Recording,
    recorded: RecordedMessages,
    session: IdentifiedSession,
    result: IdentificationResult,
    command: str = '',
) -> SessionReport:
    """Return the report of a session.

    Parameters
    ----------
    title : str
        Name of the session.
    recording, recorded : Recording, RecordedMessages
        What was recorded.
    session, result : IdentifiedSession, IdentificationResult
        What was identified, and its result.
    command : str
        The command line that makes the report; empty if there is none.
    """
    notes, course = recording.facts.custom, course_of(session)
    dose = dose_of(recording.pulses, int(session.stamp_ns[0]))
    truth = known_muscle(recorded.truths, notes, session.last.repetition_rate)
    judgement = truth and truth.judged(course)
    remarks = list(result.notes)
    # the samples learnt from at the end of the session
    stamps, residuals = session.stamp_ns, None
    late = stamps >= stamps[-1] - round(_RESIDUAL_SHARE * int(stamps[-1] - stamps[0]))
    kept = session.usable & late
    residual = (session.force - session.prediction)[kept]
    try:
        residuals = analyse_residuals(stamps[kept], residual, recording.pulses)
    except ReportError as error:
        remarks.append(f'no residual analysis: {error}')
    if recorded.unreadable:
        remarks.append(f'{recorded.unreadable} messages of nodes could not be decoded')
    return SessionReport(
        title=title,
        headline=headline_of(result, session),
        result=result,
        twitch=_twitch(result),
        flags=course.flags,
        truth={'sentence': judgement.sentence, **plain(judgement)} if judgement else None,
        residuals=residuals,
        faults=[
            {'name': name, 'count': n, 'meaning': MEANING.get(name, 'fault of the recording')}
            for name, n in result.faults.items()
        ],
        schedule=dose,
        driver=recorded.driver,
        session=_facts(recording, session, recorded),
        methods={
            'sentence': _sentence(result, dose),
            'command': command or None,
            'versions': {
                'rpms_ros': __version__,
                'python': platform.python_version(),
                **{name: version(name) for name in ('numpy', 'scipy', 'numba', 'matplotlib')},
            },
        },
        remarks=remarks,
        recording=recording,
        identified=session,
        course=course,
        true_muscle=truth,
    )


def _sentence(result: IdentificationResult, dose: Dose) -> str:
    """Return the sentence for a paper."""
    if result.verdict.grade == 'no':
        return f'No muscle was identified: {result.verdict.reasons[0]}.'
    what = QUANTITIES[result.unit]
    found = result.dynamics
    identified, by = 'Recruitment and impulse response', f'estimator {result.estimator}'
    if result.curve is None:
        identified = 'The response to a pulse and its latency'
    if found is not None:
        identified, by = 'Dynamics', found.model
    counts = f'{counted(result.pulses, "pulse")} and {counted(result.samples, "sample")}'
    data = f'{counts} of isometric {what} over {result.duration_s:.4g} s'
    text = f'{identified} were identified with rpms_ros {__version__} ({by}) from {data}'
    if dose.rate_hz and dose.intensity:
        low, high = (100 * dose.intensity[end] for end in ('lowest', 'highest'))
        shares = f'intensities of {low:.3g} to {high:.3g} % of the maximum'
        text += f' at {dose.rate_hz["median"]:.4g} Hz and {shares}'
    if found is not None:
        fit = f'{found.fit_percent:.1f} % (100 (1 - |residual| / |force - mean|))'
        trains = f'{counted(found.trains, "train")} at their own rate'
        return f'{text}. The {found.model} fits {fit} of {trains}.'
    if result.curve is not None:
        text += f'; the recruitment curve is stated for {result.rate_hz:g} Hz'
    if result.confidence:
        text += f' with intervals of {100 * result.confidence:g} %'
    if not np.isfinite(result.output_error_n):
        return f'{text}. No sample was predicted before it was learnt.'
    share = f'{100 * result.output_error_of_range:.2g} % of the range of the {what}'
    error = f'{result.output_error_n:.2g} {result.unit} ({share})'
    return f'{text}. The root mean square of measured minus predicted {what} was {error}.'


def _twitch(result: IdentificationResult) -> dict[str, float | str | None]:
    """Return peak [N], time to peak and half relaxation [s] of the response to one pulse.

    Half relaxation is when the force has fallen to half its peak, None if it does not.
    """
    response = result.impulse_response
    peak, at = response.peak.value, response.peak_time_s
    below = response.time_s[(response.time_s >= at) & (response.force <= 0.5 * peak)]
    return {
        'peak_force': peak,
        'time_to_peak_s': at,
        'half_relaxation_s': float(below[0] - at) if len(below) else None,
        'remark': NOT_A_TWITCH if result.is_no_twitch else None,
    }


def _facts(
    recording: Recording, session: IdentifiedSession, recorded: RecordedMessages
) -> dict[str, Any]:
    facts, stamps = recording.facts, recording.forces.stamp_ns
    steps = np.diff(np.sort(stamps)) / NANOSECONDS_PER_SECOND
    period = float(np.median(steps)) if len(steps) else 0.0
    return {
        'recording': facts.path.name,
        'storage': facts.storage,
        'start_ns': int(session.stamp_ns[0]),
        'sampling_rate_hz': 1.0 / period if period > 0 else None,
        'frame_ids': facts.frame_ids,
        'topics': [
            {'name': topic.name, 'type': topic.type_name, 'messages': topic.count}
            for topic in facts.topics
        ],
        'recorded_estimates': len(recorded.estimates),
        'notes': facts.custom,
    }
