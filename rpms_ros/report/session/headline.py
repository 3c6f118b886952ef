# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""First screen of a report: the muscle in a few numbers, and what to do next."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from typing import Any

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.pulses import FloatArray
from rpms_ros.report.course import Change
from rpms_ros.report.course import Course
from rpms_ros.report.course import course_of
from rpms_ros.report.named import RATE_WORDS
from rpms_ros.report.result import IdentificationResult
from rpms_ros.report.steadiness import steadiness

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
