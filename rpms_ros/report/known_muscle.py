# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""True state of a simulated muscle over a session, to compare the estimates with.

It comes from messages `rpms_msgs/MuscleTruth` in a recording, from the subject in the notes of
one, or from the simulation itself.  It is never part of a result.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rpms_ros.errors import MuscleError
from rpms_ros.identification import Estimate
from rpms_ros.identification.model.estimate import CURVE_INTENSITY
from rpms_ros.muscle import Subject, twitch
from rpms_ros.muscle.recruitment import IntensityRecruitment, RateRecruitment
from rpms_ros.muscle.simulation import Truth
from rpms_ros.muscle.twitch import twitch_area
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray
from rpms_ros.report.course import Course
from rpms_ros.schema import documented

# The worst error over a session counts from here on [s]; of a shorter one from its middle.
_SETTLED_S = 15.0
_STATE = ('threshold', 'saturation', 'time_constant', 'latency')
# Parameters of the estimators by their names in the true muscle.
_RECRUITMENT = {
    'u_thr': 'threshold',
    'u_sat': 'saturation',
    'alpha_thr': 'threshold_slope',
    'alpha_sat': 'saturation_slope',
}


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Errors of the identified curve, as shares of the true maximum."""

    error_at_the_end: float = documented('worst error of the curve of the last estimate')
    worst_error: float = documented('worst error of any estimate after `since_s`')
    worst_at_s: float = documented('time of that estimate [s]')
    since_s: float = documented('from when on estimates count [s]')

    @property
    def sentence(self) -> str:
        """The errors as a sentence."""
        text = (
            f'The muscle was simulated: the identified curve is at most '
            f'{100 * self.error_at_the_end:.2g} % of its maximum from the true one at the end'
        )
        if self.worst_at_s > 0.0:
            since = f'from {self.since_s:.0f} s on (at {self.worst_at_s:.0f} s)'
            text += f', and at most {100 * self.worst_error:.2g} % at any time {since}'
        return f'{text}.'


class KnownMuscle(NamedTuple):
    """A simulated muscle over a session; between its times values are interpolated.

    Attributes
    ----------
    stamp_ns : ndarray of int64 (times,)
        Ascending [ns].
    rate_hz : float
        Repetition rate for which the curve is stated [Hz].
    intensity : ndarray (points,)
        Shares of the maximum.
    curve : ndarray (times, points)
        Steady force.
    state : mapping of str to ndarray (times,)
        ``threshold`` and ``saturation``, u_thr and u_sat [1], ``time_constant`` T_a, ``latency``
        [s], and ``effort``, force that the stimulation does not cause.
    subject : Subject or None
        The muscle at rest, where it is known: order of the twitch and sharpness of the curve.
    """

    stamp_ns: IntArray
    rate_hz: float
    intensity: FloatArray
    curve: FloatArray
    state: Mapping[str, FloatArray]
    subject: Subject | None = None

    def at(self, name: str, stamp_ns: IntArray | int) -> FloatArray:
        """Return a part of `state` at stamps (stamps,) [ns]."""
        return self._between(self.state[name], stamp_ns)

    def curve_at(self, stamp_ns: IntArray | int) -> FloatArray:
        """Return the steady force (points,) at a time, or (points, stamps) at stamps [ns]."""
        return np.array([self._between(one, stamp_ns) for one in self.curve.T])

    def _between(self, values: FloatArray, wanted: IntArray | int) -> FloatArray:
        # relative to the first: a double does not resolve nanoseconds since 1970
        first = self.stamp_ns[0]
        found: FloatArray = np.interp(np.asarray(wanted) - first, self.stamp_ns - first, values)
        return found

    def parameter(self, name: str, stamp_ns: IntArray) -> FloatArray | None:
        """Return a parameter of the curve at stamps (stamps,), None if it is not known."""
        known = _RECRUITMENT.get(name, '')
        if self.subject is not None and self.subject.recruitment.shape != 'arctan':
            return None
        if known in self.state:
            return self.at(known, stamp_ns)
        if self.subject is None or not known:
            return None
        return np.full(np.shape(stamp_ns), getattr(self.subject.recruitment, known))

    def response(self, time_s: FloatArray, stamp_ns: int) -> FloatArray | None:
        """Return the force (times,) after one pulse of full intensity, None if not known.

        Its mean at the rate of the curve is the steady force.
        """
        if self.subject is None:
            return None
        constant, order = float(self.at('time_constant', stamp_ns)), self.subject.order
        peak = float(self.curve_at(stamp_ns)[-1]) / (self.rate_hz * twitch_area(constant, order))
        return peak * twitch(time_s - float(self.at('latency', stamp_ns)), constant, order)

    def comparable(self, estimate: Estimate) -> bool:
        """Whether an estimate states a curve for the same repetition rate."""
        return estimate.curve_known and estimate.repetition_rate == self.rate_hz

    def error(self, estimate: Estimate) -> float:
        """Return the worst error of a curve relative to the true maximum, NaN if not known."""
        if not self.comparable(estimate):
            return float('nan')
        true = self.curve_at(estimate.stamp_ns)
        found = np.interp(self.intensity, estimate.curve_intensity, estimate.curve_force)
        return float(np.abs(found - true).max() / true.max())

    def judged(self, course: Course) -> Judgement | None:
        """Return the errors of a session's curves, None if the true ones are not known."""
        since = min(_SETTLED_S, 0.5 * course.end_s)
        late = [one for one in course.estimates if one.stamp_ns >= course.start_ns + 1e9 * since]
        errors = np.array([self.error(one) for one in late])
        if not len(late) or np.isnan(errors[-1]):
            return None
        worst = int(np.nanargmax(errors))
        worst_ns = late[worst].stamp_ns - course.start_ns
        return Judgement(
            error_at_the_end=float(errors[-1]),
            worst_error=float(errors[worst]),
            worst_at_s=worst_ns / NANOSECONDS_PER_SECOND if len(late) > 1 else 0.0,
            since_s=since,
        )


def known_muscle(
    truths: Sequence[Truth], notes: Mapping[str, str], rate_hz: float
) -> KnownMuscle | None:
    """Return the muscle of a simulated recording, None if it is not known.

    Parameters
    ----------
    truths : sequence of Truth
        Messages of the simulation.
    notes : mapping of str to str
        Notes of the recording.
    rate_hz : float
        Rate for which the curve is stated, where the notes tell the muscle [Hz].
    """
    subject = _noted_subject(notes)
    found = of_truths(truths, subject) or (of_subject(subject, rate_hz) if subject else None)
    # the notes of a recording need not describe a possible muscle
    if found is None or not np.isfinite(found.curve).all() or not (found.curve.max(1) > 0).all():
        return None
    return found


def of_truths(truths: Sequence[Truth], subject: Subject | None = None) -> KnownMuscle | None:
    """Return the muscle from messages of a simulation, None if there are none.

    After a restart of the simulator only messages stamped later than all before are used.
    """
    kept: list[Truth] = []
    for one in truths:
        alike = not kept or np.array_equal(one.curve_intensity, kept[0].curve_intensity)
        later = not kept or one.stamp_ns > kept[-1].stamp_ns
        if alike and later and len(one.curve_intensity) > 1:
            kept.append(one)
    if not kept:
        return None
    states = {name: np.array([getattr(one.state, name) for one in kept]) for name in _STATE}
    return KnownMuscle(
        stamp_ns=np.array([one.stamp_ns for one in kept], dtype=np.int64),
        rate_hz=kept[0].repetition_rate,
        intensity=kept[0].curve_intensity,
        curve=np.array([one.curve_force for one in kept]),
        state={**states, 'effort': np.array([one.effort for one in kept])},
        subject=subject,
    )


def of_subject(subject: Subject, rate_hz: float) -> KnownMuscle:
    """Return a muscle that does not change; its curve is stated for a repetition rate [Hz]."""
    shape = subject.recruitment
    known = (shape.threshold, shape.saturation, subject.time_constant, subject.latency, 0.0)
    state = {name: np.array([one]) for name, one in zip((*_STATE, 'effort'), known, strict=True)}
    curve = subject.steady_force(CURVE_INTENSITY, rate_hz)[np.newaxis]
    stamp_ns = np.zeros(1, dtype=np.int64)
    return KnownMuscle(stamp_ns, rate_hz, CURVE_INTENSITY, curve, state, subject)


def _noted_subject(notes: Mapping[str, str]) -> Subject | None:
    """Return the subject that `rpms simulate` noted in a recording, None if there is none."""
    try:
        values = json.loads(notes['subject'])
        recruitment = IntensityRecruitment(**values.pop('recruitment'))
        rates = RateRecruitment(**values.pop('rate_recruitment'))
        return replace(Subject(**values), recruitment=recruitment, rate_recruitment=rates)
    except (KeyError, TypeError, ValueError, AttributeError, MuscleError):
        return None
