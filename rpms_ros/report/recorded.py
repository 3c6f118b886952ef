# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the nodes in a recording: estimates, totals of a driver, truth of a simulator.

Recorded estimates as a table for an export, and compared with those of another run.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from rpms_ros import estimate_messages, messages
from rpms_ros.errors import MessageError, RecordingError
from rpms_ros.identification import Estimate
from rpms_ros.muscle.simulation import Truth
from rpms_ros.printable import printable, spreadsheet_text
from rpms_ros.pulses import FloatArray, IntArray
from rpms_ros.recording.rosbag.reading import decoded
from rpms_ros.recording.rosbag.scan import Scan
from rpms_ros.report.known_muscle import KnownMuscle, known_muscle
from rpms_ros.report.result import IDENTIFIABILITY

if TYPE_CHECKING:
    from rpms_ros.recording import Recording

DRIVER_STATUS = 'rpms_msgs/msg/DriverStatus'
_TYPES = (messages.MUSCLE_ESTIMATE, DRIVER_STATUS, messages.MUSCLE_TRUTH)
# What an estimate takes besides its arrays [bytes]: objects of Python, and heads of arrays.
_PER_ESTIMATE = 8000
_PER_TRUTH = 2000
# What a message raises that lacks a field, or whose fields are not what they should be.
_NOT_THERE = (MessageError, AttributeError, OverflowError, TypeError, ValueError)


@dataclass(frozen=True)
class DriverTotals:
    """Totals that a stimulator driver published, since it was started.

    Attributes
    ----------
    pulses_delivered, pulses_dropped : int
        Pulses.
    coil_energy_j : float
        Energy of these pulses, and of those that its dose ledger says the patient had before [J].
    highest_temperature_celsius : float
        Of the coil, measured or modelled, over the recording [Celsius].
    lateness_max_s : float
        Of delivered pulses against their schedule [s].
    schedule : str or None
        Name of the last schedule that ran; None if none did.
    faults : dict of str to int
        What went wrong.
    """

    pulses_delivered: int
    pulses_dropped: int
    coil_energy_j: float
    highest_temperature_celsius: float
    lateness_max_s: float
    schedule: str | None
    faults: dict[str, int]


@dataclass
class RecordedMessages:
    """Messages of the nodes in a recording.

    Attributes
    ----------
    estimates : list of Estimate
        In the order of reception.
    driver : DriverTotals or None
        None if no status was recorded.
    unreadable : int
        Messages that could not be decoded.
    truths : list of Truth
        True states published by a simulator.
    """

    estimates: list[Estimate] = field(default_factory=list)
    driver: DriverTotals | None = None
    unreadable: int = 0
    truths: list[Truth] = field(default_factory=list)


def recorded_messages(
    recording: 'Recording', memory: int | None = None, only: tuple[str, ...] = _TYPES
) -> RecordedMessages:
    """Return the messages of an identifier and a driver in a recording.

    Parameters
    ----------
    recording : Recording
        What was read; messages of other namespaces than that of its pulses are not of its muscle.
    memory : int, optional
        What reading may take, as of `read_recording` [bytes].
    only : tuple of str
        Types that are read; all of them if not given.

    Raises
    ------
    RecordingError
        If the recording cannot be read, or several nodes published estimates.
    """
    found = RecordedMessages()
    topics: set[str] = set()
    path = recording.facts.path
    scan = Scan(path, memory)
    for channel, records in scan.blocks():
        of_it = channel.topic.rpartition('/')[0] == recording.namespace
        if channel.type_name not in only or not of_it:
            continue
        sizes = (records.end - records.start).tolist()
        for size, message in zip(sizes, decoded(channel, records), strict=True):
            try:
                if channel.type_name == DRIVER_STATUS:
                    found.driver = _totals(found.driver, message)
                elif channel.type_name == messages.MUSCLE_TRUTH:
                    found.truths.append(estimate_messages.truth_of(message))
                    scan.budget.hold(_PER_TRUTH + size)
                else:
                    found.estimates.append(estimate_messages.estimate_of(message))
                    scan.budget.hold(_PER_ESTIMATE + size)
                    topics.add(channel.topic)
            except _NOT_THERE:
                found.unreadable += 1
    if len(topics) > 1:
        fault = f'expected estimates of one identifier in {path}, got {", ".join(sorted(topics))}'
        raise RecordingError(fault)
    return found


def true_muscle(recording: 'Recording', rate_hz: float) -> KnownMuscle | None:
    """Return the muscle of a simulated recording, None if it has none.

    Parameters
    ----------
    recording : Recording
        Of a simulator, or not.
    rate_hz : float
        Rate for which the curve is stated, where only the notes tell the muscle [Hz].

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    """
    facts, truths = recording.facts, []
    if any(topic.type_name == messages.MUSCLE_TRUTH for topic in facts.topics):
        truths = recorded_messages(recording, None, (messages.MUSCLE_TRUTH,)).truths
    return known_muscle(truths, facts.custom, rate_hz)


def _totals(before: DriverTotals | None, status: Any) -> DriverTotals:
    """Return the totals after a status; raises an exception of `_NOT_THERE` if it is none."""
    hottest = float(status.coil_temperature)
    if before is not None and before.highest_temperature_celsius >= hottest:
        hottest = before.highest_temperature_celsius
    return DriverTotals(
        pulses_delivered=int(status.pulses_delivered),
        pulses_dropped=int(status.pulses_dropped),
        coil_energy_j=float(status.coil_energy),
        highest_temperature_celsius=hottest,
        lateness_max_s=float(status.lateness_max),
        schedule=str(status.schedule) or (None if before is None else before.schedule),
        faults=dict(zip(map(str, status.fault_names), map(int, status.fault_counts), strict=True)),
    )


_SHARES = (25, 50, 75, 100)
# columns that are called as fields of an estimate
_SAME = (
    *('disturbance', 'disturbance_deviation', 'output_error', 'confidence'),
    *('samples', 'pulses', 'changes'),
)


def estimate_table(estimates: Sequence[Estimate]) -> tuple[IntArray, dict[str, list[str | float]]]:
    """Return the newest sample (estimates,) [ns] of estimates, and their cells by column.

    Columns: name of the estimator, faults and doubts; the parameters by their names, each with its
    standard deviation and whether the data determine it; steady force at a quarter, half, three
    quarters and all of the intensity and the numbers of the response, each with the ends of its
    interval; rates of change, disturbance, output error, counts.  Cells without a value are empty.

    Parameters
    ----------
    estimates : sequence of Estimate
        In their order.
    """
    rows: list[dict[str, str | float]] = [{**_texts(one), **_numbers(one)} for one in estimates]
    names = dict.fromkeys(chain.from_iterable(rows))
    stamp_ns = np.array([one.stamp_ns for one in estimates], dtype=np.int64)
    return stamp_ns, {name: [row.get(name, '') for row in rows] for name in names}


def _numbers(one: Estimate) -> dict[str, float]:
    found = dict(zip(one.nonlinear_names, one.nonlinear.tolist(), strict=False))
    for name, variance in zip(list(found), np.diag(one.nonlinear_covariance), strict=False):
        if variance >= 0.0:
            found[f'{name}_deviation'] = float(np.sqrt(variance))
    names = [f'steady_force_{share}' for share in _SHARES]
    curves = (one.curve_force, one.curve_lower, one.curve_upper)
    found |= _banded(names, *(_at_shares(one, curve) for curve in curves))
    physiology = (one.physiology, one.physiology_lower, one.physiology_upper)
    found |= _banded(one.physiology_names, *physiology)
    found |= _banded(one.rate_names, one.rate, one.rate_lower, one.rate_upper)
    found |= {name: float(getattr(one, name)) for name in _SAME}
    return found | {'repetition_rate_hz': one.repetition_rate}


def _at_shares(one: Estimate, curve: FloatArray) -> FloatArray:
    if not len(curve) or len(curve) != len(one.curve_intensity):
        return np.empty(0)
    return np.interp(np.array(_SHARES) / 100.0, one.curve_intensity, curve)


def _banded(
    names: Sequence[str], values: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, float]:
    """Return values with their intervals by names; NaN where an array is shorter."""
    return {
        f'{name}{end}': float(column[index]) if index < len(column) else np.nan
        for index, name in enumerate(names)
        for end, column in (('', values), ('_lower', lower), ('_upper', upper))
    }


def _texts(one: Estimate) -> dict[str, str]:
    faults = json.dumps(dict(one.faults), sort_keys=True)
    found = {'estimator': one.estimator, 'faults': faults, 'doubts': '; '.join(one.doubts)}
    for name, flag in zip(one.nonlinear_names, one.nonlinear_identifiability, strict=False):
        found[f'{name}_determined'] = IDENTIFIABILITY.get(flag, '')
    # no text that a spreadsheet would run
    return {name: spreadsheet_text(printable(text)) for name, text in found.items()}


@dataclass(frozen=True)
class Agreement:
    """Estimates of a live run against those of the replay of its recording.

    Attributes
    ----------
    compared : int
        Estimates with a partner of the same stamp.
    missing : int
        Live estimates without one.
    differing : mapping of str to int
        Names of the fields that differ in any bit, and how often.
    """

    compared: int
    missing: int
    differing: Mapping[str, int]

    @property
    def exact(self) -> bool:
        """Whether there were estimates and all of them agree in every bit."""
        return self.compared > 0 and not self.missing and not self.differing

    def __str__(self) -> str:
        if self.exact:
            return f'all {self.compared} estimates, bit for bit'
        counts = f'{self.missing} estimates missing, {self.compared} compared'
        fields = ', '.join(f'{name} {count}' for name, count in self.differing.items())
        return f'DIFFERS: {counts}, differing fields {fields or "none"}'


def compare(live: Sequence[Estimate], replayed: Sequence[Estimate]) -> Agreement:
    """Return whether each live estimate is the replayed one of its stamp, bit for bit."""
    partners = {one.stamp_ns: one for one in replayed}
    pairs = [(one, partners[one.stamp_ns]) for one in live if one.stamp_ns in partners]
    differing = Counter(name for pair in pairs for name in differences(*pair))
    return Agreement(len(pairs), len(live) - len(pairs), differing)


def differences(first: Estimate, second: Estimate) -> list[str]:
    """Return the names of the fields that differ in any bit."""
    names = (field.name for field in fields(Estimate))
    return [name for name in names if not _same(getattr(first, name), getattr(second, name))]


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, float | np.ndarray):
        left, right = np.asarray(first, np.float64), np.asarray(second, np.float64)
        return left.shape == right.shape and left.tobytes() == right.tobytes()
    return bool(first == second)
