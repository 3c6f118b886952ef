# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates over time: force, parameters, changes, flags, effort; whether it was one muscle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import NOT_INFORMED, Estimate, IdentifiedSession
from rpms_ros.identification.analysis.trains import evenly
from rpms_ros.identification.quality.doubts import MEANING, NO_CONSTANT_MUSCLE, REASON
from rpms_ros.identification.quality.explained_force import Stated, informed_physiology
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray
from rpms_ros.report.text import interval_of
from rpms_ros.schema import documented

# Most estimates that are drawn, evenly spaced: a page has no more pixels.
_MOST_SHOWN = 300
# Time for an estimator to settle; the first fifth of a shorter session [s].
_SETTLING = 10.0
# Warnings no further apart are one span [s].
_BREAK = 1.0
# Meaning of each kind of change.
MEANING_OF_CHANGE = {
    'gain': 'the force of all intensities changed alike: the muscle, or the angle of the joint',
    'thresholds': 'other intensities are needed than before: the coil probably moved',
    'dynamics': 'the response to a pulse has another shape',
}
_UNNAMED = 'the force no longer fits the muscle before; the kind of the change is not determined'


@dataclass(frozen=True, kw_only=True)
class Change:
    """One sudden change that was found."""

    time_s: float = documented('after the first force sample [s]')
    kind: str = documented('gain, thresholds, dynamics, baseline or unknown')
    reason: str = documented('what that means, as a sentence')


@dataclass(frozen=True, kw_only=True)
class Flag:
    """A part of the session in which estimates or data are doubtful."""

    start_s: float = documented('after the first force sample [s]')
    end_s: float = documented('after the first force sample [s]')
    text: str = documented('why')


@dataclass(frozen=True)
class TimeCourse:
    """A quantity over time, NaN where it is not known.

    Attributes
    ----------
    value, lower, upper : ndarray (estimates,)
        Estimate and the ends of its interval.
    """

    value: FloatArray
    lower: FloatArray
    upper: FloatArray

    @property
    def known(self) -> BoolArray:
        """Where there is a value (estimates,)."""
        return np.isfinite(self.value)


@dataclass(frozen=True)
class Course:
    """Quantities of a session over time, one value for each estimate.

    Attributes
    ----------
    estimates : list of Estimate
        All of them.
    start_ns : int
        Stamp of the first force sample [ns].
    end_s : float
        Time of the last one after it [s].
    """

    estimates: list[Estimate]
    start_ns: int
    end_s: float

    @cached_property
    def stamp_ns(self) -> IntArray:
        """Stamps of the estimates (estimates,) [ns]."""
        return np.array([one.stamp_ns for one in self.estimates], dtype=np.int64)

    @cached_property
    def time_s(self) -> FloatArray:
        """Times after the first force sample (estimates,) [s]."""
        return (self.stamp_ns - self.start_ns) / NANOSECONDS_PER_SECOND

    @cached_property
    def shown(self) -> IntArray:
        """Which estimates to draw: at most 300, first and last included."""
        return evenly(len(self.estimates), _MOST_SHOWN)

    @cached_property
    def settled(self) -> BoolArray:
        """Which estimates (estimates,) are past the time in which the muscle is first learnt."""
        return self.time_s >= min(_SETTLING, 0.2 * self.end_s)

    @property
    def has_course(self) -> bool:
        """Whether there is more than one estimate of the muscle."""
        return int(np.count_nonzero(self.force.known)) > 1

    @cached_property
    def force(self) -> TimeCourse:
        """Steady force at full intensity, in the unit of the estimates."""
        return _path(
            Stated(one.curve_force[-1], _last(one.curve_lower), _last(one.curve_upper))
            if one.curve_known and one.samples
            else None
            for one in self.estimates
        )

    def parameter(self, name: str) -> TimeCourse:
        """Return a parameter of the recruitment curve; unknown where it is not informed."""
        return _path(_parameter(one, name) for one in self.estimates)

    def physiology(self, name: str) -> TimeCourse:
        """Return a number of the physiology, unknown where it is not informed."""
        return _path(informed_physiology(one).get(name) for one in self.estimates)

    @cached_property
    def disturbance(self) -> TimeCourse:
        """Force that the stimulation does not cause, with two standard deviations each side."""
        return _path(
            _banded('disturbance', one.disturbance, one.disturbance_deviation, 0.95)
            if one.disturbance_deviation > 0.0
            else None
            for one in self.estimates
        )

    @cached_property
    def follows(self) -> bool:
        """Whether the estimator follows slow changes of the muscle."""
        return any(one.rate_names for one in self.estimates)

    @cached_property
    def changes(self) -> list[Change]:
        """The sudden changes, each once, in their order."""
        found: dict[int, Change] = {}
        for one, time_s in zip(self.estimates, self.time_s.tolist(), strict=True):
            pairs = zip(one.change_kinds, one.change_ago.tolist(), strict=True)
            for number, (kind, ago) in enumerate(pairs, one.changes - len(one.change_kinds)):
                reason = MEANING_OF_CHANGE.get(kind, _UNNAMED)
                found[number] = Change(time_s=time_s - ago, kind=kind, reason=reason)
        return [found[number] for number in sorted(found)]

    @cached_property
    def flags(self) -> list[Flag]:
        """The parts with a warning of the estimator, or with faulty data, by their beginning."""
        before = [self.estimates[0], *self.estimates[:-1]]
        texts = [_warnings(*pair) for pair in zip(before, self.estimates, strict=True)]
        found = [
            Flag(start_s=start, end_s=end, text=text)
            for text in dict.fromkeys(text for several in texts for text in several)
            for start, end in _runs(np.array([text in several for several in texts]), self.time_s)
        ]
        return sorted(found, key=lambda flag: (flag.start_s, flag.text))


def course_of(session: IdentifiedSession) -> Course:
    """Return the quantities of a session over time."""
    start = int(session.stamp_ns[0])
    end = float(session.stamp_ns.max() - start) / NANOSECONDS_PER_SECOND
    return Course(session.estimates, start, end)


def _parameter(one: Estimate, name: str) -> Stated | None:
    index = one.nonlinear_names.index(name)
    flags = one.nonlinear_identifiability
    if not one.samples or (len(flags) > index and flags[index] == NOT_INFORMED):
        return None
    covariance = one.nonlinear_covariance
    variance = max(float(covariance[index, index]), 0.0) if len(covariance) > index else np.nan
    return _banded(name, float(one.nonlinear[index]), variance**0.5, one.confidence)


def _banded(name: str, value: float, deviation: float, confidence: float) -> Stated:
    return Stated(value, *(interval_of(name, value, deviation, confidence) or (np.nan, np.nan)))


def _warnings(before: Estimate, one: Estimate) -> list[str]:
    """Return the doubts of the estimator, and the faults counted since the last estimate.

    Why an interval is wide is no doubt: the band shows it.
    """
    new = (name for name, count in one.faults.items() if count > before.faults.get(name, 0))
    doubts = (REASON[name] for name in one.doubts if name in REASON)
    return [*doubts, *(f'{name}: {MEANING.get(name, "of a monitor")}' for name in new)]


def _path(found: Iterator[Stated | None]) -> TimeCourse:
    rows = [(one.value, one.lower, one.upper) if one else (np.nan,) * 3 for one in found]
    return TimeCourse(*np.array(rows).T)


def _last(values: FloatArray) -> float:
    return float(values[-1]) if len(values) else np.nan


def _runs(chosen: BoolArray, time_s: FloatArray) -> list[tuple[float, float]]:
    """Return beginning and end of each run of True [s], at least one; short breaks end none."""
    times = time_s[chosen]
    apart = np.flatnonzero(np.diff(times) > _BREAK)
    starts, ends = np.append(0, apart + 1), np.append(apart, len(times) - 1)
    return [(float(times[one]), float(times[two])) for one, two in zip(starts, ends, strict=True)]


# With half an interval wider than this share a value is not compared.
_NARROW = 0.05
# Smaller changes are not mentioned, however certain.
_WORTH = 0.02
# With larger bounds the muscle is not called the same.
_SAME = 0.1
# Time to settle after a sudden change [s].
_AFTER = 5.0
# After which a change has lasted [s], and how well thresholds have to be known to tell (relative).
_LATE, _NARROW_INTENSITY = 15.0, 0.05
_MUSCLE = ('gain', 'thresholds', 'dynamics', 'unknown')
_TIME_CONSTANT = 'twitch_time_constant_s'


def steadiness(course: Course) -> str:
    """Return sentences on whether the muscle stayed the same."""
    lasted = [_lasted(course, change) for change in course.changes]
    sudden = [_told(*pair, course) for pair in zip(course.changes, lasted, strict=True)]
    if not course.follows and not sudden:
        return _not_told(course)
    # each part between sudden changes, without its first seconds
    edges = _edges(course)
    parts = zip([0.0, *(edge + _AFTER for edge in edges)], [*edges, math.inf], strict=True)
    slow = [text for part in parts if (text := _slow(course, *part))]
    if slow or any(lasted):
        return ' '.join([*sudden, *slow])
    return ' '.join([*sudden, _same(course)])


def _what(course: Course) -> str:
    """Return force or torque."""
    return QUANTITIES[course.estimates[-1].unit]


def _not_told(course: Course) -> str:
    name = course.estimates[-1].estimator
    if not course.estimates[-1].curve_known:
        # nor could an estimator that follows the muscle
        return 'Pulses of nearly one intensity do not tell.'
    if name == 'batch':
        if NO_CONSTANT_MUSCLE in course.estimates[-1].doubts:
            return f'{REASON[NO_CONSTANT_MUSCLE].capitalize()}.'
        return 'One muscle explains all of the recording.'
    assumed = f'The estimator {name} assumes a muscle that does not change'
    return f'{assumed}; the estimator tracking can find out.'


def _same(course: Course) -> str:
    places = _narrow(course.force, course.settled)
    if not len(places):
        return 'The intervals are too wide to tell whether the muscle stayed the same.'
    force = course.force
    deviation = np.abs(force.value[places] / force.value[places[0]] - 1.0)
    change, half = _ratio(force, int(places[0]), int(places[-1]))
    bound = max(float(deviation.max()), abs(change) + half)
    percent = max(math.ceil(100.0 * bound), 1)
    if bound > _SAME:
        return f'No lasting change was found; one of less than {percent} % would not be seen.'
    since = f'from {course.time_s[places[0]]:.0f} s on' if places[0] else 'over the session'
    return f'The muscle stayed the same within {percent} % {since}.'


def _edges(course: Course) -> list[float]:
    """Return the times of the sudden changes of the muscle [s]."""
    return [change.time_s for change in course.changes if change.kind in _MUSCLE]


def _slow(course: Course, start: float, end: float) -> str:
    """Return the slow changes of force and twitch in a part of the session, empty if none."""
    inside = course.settled & (course.time_s >= start) & (course.time_s <= end)
    force = _difference(course.force, inside, 'fell', 'rose')
    constant = course.physiology(_TIME_CONSTANT)
    slower = _difference(constant, inside, 'became faster', 'became slower')
    if not force and not slower:
        return ''
    places = _narrow(course.force, inside)
    first, last = course.time_s[places if len(places) else np.flatnonzero(inside)][[0, -1]]
    told = [f'the {_what(course)} at full intensity {force}'] if force else []
    told += [f'the twitch {slower}'] if slower else []
    text = ' and '.join(told)
    return f'{text[0].upper()}{text[1:]} between {first:.0f} and {last:.0f} s.'


def _difference(path: TimeCourse, inside: np.ndarray, down: str, up: str) -> str:
    """Return the change of a quantity between two ends, empty if uncertain or too small."""
    places = _narrow(path, inside)
    if len(places) < 2:
        return ''
    change, half = _ratio(path, int(places[0]), int(places[-1]))
    if abs(change) <= half or abs(change) < _WORTH:
        return ''
    return f'{down if change < 0.0 else up} by {_percent(abs(change), half)}'


def _narrow(path: TimeCourse, inside: np.ndarray) -> np.ndarray:
    """Return the estimates at which a quantity is known well enough to be compared."""
    half = 0.5 * (path.upper - path.lower)
    with np.errstate(invalid='ignore'):
        return np.flatnonzero(inside & path.known & (half <= _NARROW * np.abs(path.value)))


def _ratio(path: TimeCourse, first: int, last: int) -> tuple[float, float]:
    """Return relative change between two estimates, and half of its interval.

    The two are assumed independent, which makes the interval rather too wide.
    """
    # elsewhere the value may be 0, before the estimator has settled
    place = np.array([first, last])
    half = 0.5 * (path.upper - path.lower)[place] / np.abs(path.value[place])
    ratio = float(path.value[last] / path.value[first])
    return ratio - 1.0, abs(ratio) * math.hypot(*half.tolist())


def _told(change: Change, lasted: bool, course: Course) -> str:
    """Return a sentence on a sudden change."""
    at = f'at {change.time_s:.1f} s'
    if not lasted:
        return (
            f'Something {at} looked like another muscle, but thresholds, twitch and '
            f'{_what(course)} were the same afterwards: an effort, a spasm or a bump, say.'
        )
    begin = {
        'thresholds': f'The coil probably moved {at}',
        'gain': f'The {_what(course)} of all intensities changed {at}',
        'dynamics': f'The response to a pulse changed its shape {at}',
    }.get(change.kind, f'Something changed {at}')
    threshold, parts = course.parameter('u_thr'), []
    if change.kind == 'thresholds' and (pair := _around(threshold, course, change)):
        before, after = (float(threshold.value[place]) for place in pair)
        parts.append(f'the threshold went from {before:.2f} to {after:.2f}')
    if force := _step(course.force, course, change):
        parts.append(f'the {_what(course)} at full intensity {force}')
    return f'{begin}: {", ".join(parts)}.' if parts else f'{begin}.'


def _lasted(course: Course, change: Change) -> bool:
    """Return whether a change left something different, or too vague to be compared.

    What is explained by other thresholds for a moment, and by the same ones afterwards, was
    rather an effort.
    """
    if change.kind not in _MUSCLE:
        return True
    compared = (
        (course.force, _NARROW, True),
        (course.parameter('u_thr'), _NARROW_INTENSITY, True),
        (course.parameter('u_sat'), _NARROW_INTENSITY, True),
        (course.physiology(_TIME_CONSTANT), _NARROW, False),
    )
    for path, widest, without in compared:
        pair = _around(path, course, change, _LATE)
        step, half = (0.0, 0.0) if pair is None else _ratio(path, *pair)
        if (pair is None and without) or not abs(step) <= half <= widest:
            return True
    return False


def _step(path: TimeCourse, course: Course, change: Change) -> str:
    """Return the change of a quantity by a sudden change, empty if uncertain."""
    pair = _around(path, course, change)
    step, half = (0.0, math.nan) if pair is None else _ratio(path, *pair)
    if not math.isfinite(half):
        return ''
    if abs(step) <= max(half, _WORTH):
        return f'stayed within {max(math.ceil(100 * (abs(step) + half)), 1)} %'
    return f'{"fell" if step < 0.0 else "rose"} by {_percent(abs(step), half)}'


def _around(
    path: TimeCourse, course: Course, change: Change, after_s: float = _AFTER
) -> tuple[int, int] | None:
    """Return the last estimate before a change, and one so long after it."""
    later = min((edge for edge in _edges(course) if edge > change.time_s), default=math.inf)
    known, time = path.known, course.time_s
    before = np.flatnonzero(known & (time <= change.time_s))
    after = np.flatnonzero(known & (time > change.time_s) & (time <= later))
    if not len(before) or not len(after):
        return None
    learnt = after[time[after] >= change.time_s + after_s]
    return int(before[-1]), int(learnt[0] if len(learnt) else after[-1])


def _percent(value: float, half: float) -> str:
    """Return a share with its interval in per cent, with as many digits as the interval needs."""
    digits = 0 if half >= 0.005 else 1
    ends = max(value - half, 0.0), value + half
    middle, low, high = (f'{100 * one:.{digits}f}' for one in (value, *ends))
    return f'{middle} % ({low} to {high} %)'
