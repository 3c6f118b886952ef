# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates over time: force, parameters, changes, flags, effort."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification import NOT_INFORMED
from rpms_ros.identification import Estimate
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.faults import MEANING
from rpms_ros.identification.informed import informed_physiology
from rpms_ros.identification.plausibility import REASON
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.schema import documented

MOST_SHOWN = 300
"""Most estimates that are drawn, evenly spaced: a page has no more pixels."""
# Time for an estimator to settle; the first fifth of a shorter session [s].
_SETTLING = 10.0
_LEVEL_95 = 0.95
# Warnings no further apart are one span [s].
_BREAK = 1.0
# Meaning of each kind of change.
MEANING_OF_CHANGE = {
    'gain': 'the force of all intensities changed alike: the muscle, or the angle of the joint',
    'thresholds': 'other intensities are needed than before: the coil probably moved',
    'dynamics': 'the response to a pulse has another shape',
    'baseline': 'the force at rest jumped: the sensor or the posture, not the muscle',
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


@dataclass(frozen=True, kw_only=True)
class Path:
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

    @property
    def has_interval(self) -> bool:
        """Whether there is an interval anywhere."""
        return bool(np.isfinite(self.lower).any())


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
        time: FloatArray = (self.stamp_ns - self.start_ns) / NANOSECONDS_PER_SECOND
        return time

    @cached_property
    def shown(self) -> IntArray:
        """Which estimates to draw: at most `MOST_SHOWN`, first and last included."""
        count = len(self.estimates)
        if count <= MOST_SHOWN:
            return np.arange(count)
        return np.linspace(0, count - 1, MOST_SHOWN).round().astype(np.int64)

    @cached_property
    def settled(self) -> BoolArray:
        """Which estimates (estimates,) are past the time in which the muscle is first learnt."""
        late: BoolArray = self.time_s >= min(_SETTLING, 0.2 * self.end_s)
        return late

    @property
    def has_course(self) -> bool:
        """Whether there is more than one estimate of the muscle."""
        return int(np.count_nonzero(self.force.known)) > 1

    @cached_property
    def force(self) -> Path:
        """Steady force at full intensity, in the unit of the estimates."""
        return _path(
            (one.curve_force[-1], _last(one.curve_lower), _last(one.curve_upper))
            if one.curve_known and one.samples
            else None
            for one in self.estimates
        )

    def parameter(self, name: str) -> Path:
        """Return a parameter of the recruitment curve; unknown where it is not informed."""
        return _path(_parameter(one, name) for one in self.estimates)

    def physiology(self, name: str) -> Path:
        """Return a number of the physiology, unknown where it is not informed."""
        return _path(_physiology(one, name) for one in self.estimates)

    @cached_property
    def disturbance(self) -> Path:
        """Force that the stimulation does not cause, with two standard deviations each side."""
        half = float(ndtri(0.5 + 0.5 * _LEVEL_95))
        return _path(
            (
                one.disturbance,
                one.disturbance - half * one.disturbance_deviation,
                one.disturbance + half * one.disturbance_deviation,
            )
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
        for one in self.estimates:
            first = one.changes - len(one.change_kinds)
            pairs = zip(one.change_kinds, one.change_ago.tolist(), strict=True)
            for index, (kind, ago) in enumerate(pairs):
                time = (one.stamp_ns - self.start_ns) / NANOSECONDS_PER_SECOND - ago
                reason = MEANING_OF_CHANGE.get(kind, _UNNAMED)
                found[first + index] = Change(time_s=time, kind=kind, reason=reason)
        return [found[index] for index in sorted(found)]

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


def _parameter(one: Estimate, name: str) -> tuple[float, float, float] | None:
    index = one.nonlinear_names.index(name)
    flags = one.nonlinear_identifiability
    if not one.samples or (len(flags) > index and flags[index] == NOT_INFORMED):
        return None
    value = float(one.nonlinear[index])
    if len(one.nonlinear_covariance) <= index or not one.confidence:
        return value, np.nan, np.nan
    variance = max(float(one.nonlinear_covariance[index, index]), 0.0)
    half = float(ndtri(0.5 + 0.5 * one.confidence)) * variance**0.5
    return value, value - half, value + half


def _physiology(one: Estimate, name: str) -> tuple[float, float, float] | None:
    for index in informed_physiology(one):
        if one.physiology_names[index] == name:
            columns = (one.physiology, one.physiology_lower, one.physiology_upper)
            value, lower, upper = (float(column[index]) for column in columns)
            return value, lower, upper
    return None


def _warnings(before: Estimate, one: Estimate) -> list[str]:
    """Return the doubts of the estimator, and the faults counted since the last estimate.

    Why an interval is wide is no doubt: the band shows it.
    """
    new = (name for name, count in one.faults.items() if count > before.faults.get(name, 0))
    doubts = (REASON[name] for name in one.doubts if name in REASON)
    return [*doubts, *(f'{name}: {MEANING.get(name, "of a monitor")}' for name in new)]


def _path(rows: Iterator[tuple[float, float, float] | None]) -> Path:
    table = np.array([(np.nan,) * 3 if row is None else row for row in rows], dtype=np.float64)
    value, lower, upper = table.reshape(-1, 3).T
    return Path(value=value, lower=lower, upper=upper)


def _last(values: FloatArray) -> float:
    return float(values[-1]) if len(values) else np.nan


def _runs(chosen: BoolArray, time_s: FloatArray) -> list[tuple[float, float]]:
    """Return beginning and end of each run of True [s]; short breaks do not end one."""
    times = time_s[chosen]
    if not len(times):
        return []
    apart = np.flatnonzero(np.diff(times) > _BREAK)
    starts, ends = np.append(0, apart + 1), np.append(apart, len(times) - 1)
    return [(float(times[one]), float(times[two])) for one, two in zip(starts, ends, strict=True)]
