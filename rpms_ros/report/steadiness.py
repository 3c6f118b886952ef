# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the muscle stayed the same over a session, in one or two sentences."""

import math

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.plausibility import NO_CONSTANT_MUSCLE
from rpms_ros.identification.plausibility import REASON
from rpms_ros.report.course import Change
from rpms_ros.report.course import Course
from rpms_ros.report.course import Path

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
    slow = [text for span in _spans(course) if (text := _slow(course, *span))]
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
    return (
        f'The estimator {name} assumes a muscle that does not change; the estimator '
        'tracking can find out.'
    )


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


def _spans(course: Course) -> list[tuple[float, float]]:
    """Return the parts between sudden changes of the muscle, each without its first seconds."""
    edges = [change.time_s for change in course.changes if change.kind in _MUSCLE]
    starts = [0.0, *(edge + _AFTER for edge in edges)]
    return list(zip(starts, [*edges, math.inf], strict=True))


def _slow(course: Course, start: float, end: float) -> str:
    """Return the slow changes of force and twitch in a part of the session, empty if none."""
    inside = course.settled & (course.time_s >= start) & (course.time_s <= end)
    force = _difference(course.force, inside, 'fell', 'rose')
    slower = _difference(
        course.physiology(_TIME_CONSTANT), inside, 'became faster', 'became slower'
    )
    if not force and not slower:
        return ''
    when = _between(course, inside)
    told = [f'the {_what(course)} at full intensity {force}'] if force else []
    told += [f'the twitch {slower}'] if slower else []
    text = ' and '.join(told)
    return f'{text[0].upper()}{text[1:]} {when}.'


def _difference(path: Path, inside: np.ndarray, down: str, up: str) -> str:
    """Return the change of a quantity between two ends, empty if uncertain or too small."""
    places = _narrow(path, inside)
    if len(places) < 2:
        return ''
    change, half = _ratio(path, int(places[0]), int(places[-1]))
    if abs(change) <= half or abs(change) < _WORTH:
        return ''
    return f'{down if change < 0.0 else up} by {_percent(abs(change), half)}'


def _between(course: Course, inside: np.ndarray) -> str:
    places = _narrow(course.force, inside)
    if not len(places):
        places = np.flatnonzero(inside)
    first, last = course.time_s[places[0]], course.time_s[places[-1]]
    return f'between {first:.0f} and {last:.0f} s'


def _narrow(path: Path, inside: np.ndarray) -> np.ndarray:
    """Return the estimates at which a quantity is known well enough to be compared."""
    half = 0.5 * (path.upper - path.lower)
    with np.errstate(invalid='ignore'):
        chosen = inside & path.known & (half <= _NARROW * np.abs(path.value))
    return np.flatnonzero(chosen)


def _ratio(path: Path, first: int, last: int) -> tuple[float, float]:
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
    force = _step(course.force, course, change)
    if change.kind == 'baseline':
        return f'The {_what(course)} at rest jumped {at}, which is not the muscle.'
    begin = {
        'thresholds': f'The coil probably moved {at}',
        'gain': f'The {_what(course)} of all intensities changed {at}',
        'dynamics': f'The response to a pulse changed its shape {at}',
    }.get(change.kind, f'Something changed {at}')
    parts = []
    if change.kind == 'thresholds' and (moved := _moved(course, change)):
        parts.append(moved)
    if force:
        parts.append(f'the {_what(course)} at full intensity {force}')
    return f'{begin}: {", ".join(parts)}.' if parts else f'{begin}.'


def _lasted(course: Course, change: Change) -> bool:
    """Return whether a change left something different, or too vague to be compared.

    What is explained by other thresholds for a moment, and by the same ones afterwards, was
    rather an effort.
    """
    if change.kind not in _MUSCLE:
        return True
    compared = [course.force, course.parameter('u_thr'), course.parameter('u_sat')]
    widest = (_NARROW, _NARROW_INTENSITY, _NARROW_INTENSITY)
    for path, limit in zip(compared, widest, strict=True):
        pair = _around(path, course, change, _LATE)
        if pair is None or not _is_same(path, *pair, limit):
            return True
    constant = course.physiology(_TIME_CONSTANT)
    pair = _around(constant, course, change, _LATE)
    return pair is not None and not _is_same(constant, *pair, _NARROW)


def _is_same(path: Path, first: int, last: int, widest: float) -> bool:
    """Return whether two values agree within their intervals, which are narrow (relative)."""
    step, half = _ratio(path, first, last)
    return abs(step) <= half <= widest


def _step(path: Path, course: Course, change: Change) -> str:
    """Return the change of a quantity by a sudden change, empty if uncertain."""
    pair = _around(path, course, change)
    if pair is None:
        return ''
    step, half = _ratio(path, *pair)
    if not math.isfinite(half):
        return ''
    if abs(step) <= max(half, _WORTH):
        return f'stayed within {max(math.ceil(100 * (abs(step) + half)), 1)} %'
    return f'{"fell" if step < 0.0 else "rose"} by {_percent(abs(step), half)}'


def _moved(course: Course, change: Change) -> str:
    path = course.parameter('u_thr')
    pair = _around(path, course, change)
    if pair is None:
        return ''
    before, after = (float(path.value[place]) for place in pair)
    return f'the threshold went from {before:.2f} to {after:.2f}'


def _around(
    path: Path, course: Course, change: Change, after_s: float = _AFTER
) -> tuple[int, int] | None:
    """Return the last estimate before a change, and one so long after it."""
    edges = [one.time_s for one in course.changes if one.kind in _MUSCLE]
    later = min((edge for edge in edges if edge > change.time_s), default=math.inf)
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
    middle, low, high = (
        f'{100 * one:.{digits}f}' for one in (value, max(value - half, 0.0), value + half)
    )
    return f'{middle} % ({low} to {high} %)'
