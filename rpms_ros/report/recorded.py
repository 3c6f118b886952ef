# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the nodes in a recording: estimates, totals of a driver, truth of a simulator.

Estimates as a table: one row each, with the columns that any of them has.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.serde import SerdeError

from rpms_ros import estimate_messages, messages
from rpms_ros.errors import MessageError, RecordingError
from rpms_ros.identification import DEFAULT_RATE, Estimate
from rpms_ros.muscle import Subject
from rpms_ros.muscle.simulation import Truth
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.export import EstimateTable
from rpms_ros.recording.rosbag.definitions import MUSCLE_ESTIMATE, types_of
from rpms_ros.recording.rosbag.reading import held_bytes
from rpms_ros.recording.rosbag.scan import Scan
from rpms_ros.report.known_muscle import KnownMuscle, known_muscle
from rpms_ros.report.result import IDENTIFIABILITY

if TYPE_CHECKING:
    from rpms_ros.recording import Recording

DRIVER_STATUS = 'rpms_msgs/msg/DriverStatus'
_TYPES = (MUSCLE_ESTIMATE, DRIVER_STATUS, messages.MUSCLE_TRUTH)
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


@dataclass(frozen=True)
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

    estimates: list[Estimate]
    driver: DriverTotals | None
    unreadable: int
    truths: list[Truth] = field(default_factory=list)


def recorded_messages(
    path: Path | str,
    memory: int | None = None,
    held: int = 0,
    only: tuple[str, ...] = _TYPES,
) -> RecordedMessages:
    """Return the messages of an identifier and a driver in a recording.

    Parameters
    ----------
    path : Path or str
        Folder or file.
    memory : int, optional
        What reading may take, as of `read_recording` [bytes].
    held : int
        How much of it is in use already [bytes].
    only : tuple of str
        Types that are read; all of them if not given.

    Raises
    ------
    RecordingError
        If the recording cannot be read, or several nodes published estimates.
    """
    estimates: list[Estimate] = []
    truths: list[Truth] = []
    totals = _Totals()
    topics: set[str] = set()
    unreadable = 0
    scan = Scan(Path(path), memory)
    scan.budget.hold(held)
    for topic, type_name, size, message in _decoded(scan, only):
        try:
            if type_name == DRIVER_STATUS:
                totals.take(message)
                continue
            if type_name == messages.MUSCLE_TRUTH:
                truths.append(estimate_messages.truth_of(message))
                scan.budget.hold(_PER_TRUTH + size)
                continue
            estimate = estimate_messages.estimate_of(message)
        except _NOT_THERE:
            unreadable += 1
            continue
        scan.budget.hold(_PER_ESTIMATE + size)
        topics.add(topic)
        estimates.append(estimate)
    if len(topics) > 1:
        raise RecordingError(
            f'expected estimates of one identifier in {path}, got {", ".join(sorted(topics))}'
        )
    return RecordedMessages(estimates, totals.found, unreadable, truths)


def true_muscle(
    recording: 'Recording', rate_hz: float, memory: int | None = None
) -> KnownMuscle | None:
    """Return the muscle of a simulated recording, None if it has none.

    Parameters
    ----------
    recording : Recording
        Of a simulator, or not.
    rate_hz : float
        Rate for which the curve is stated, where only the notes tell the muscle [Hz].
    memory : int, optional
        What reading may take, as of `read_recording` [bytes].

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    """
    return known_muscle(_truths(recording, memory), recording.facts.custom, rate_hz)


def recorded_truth(recording: 'Recording') -> tuple[Subject | None, KnownMuscle | None]:
    """Return the subject that a simulated recording notes, and its muscle over time.

    Either is None where the recording does not tell it, or tells no possible muscle; the second
    also where the muscle does not change.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    """
    notes = recording.facts.custom
    noted = known_muscle((), notes, DEFAULT_RATE)
    truths = _truths(recording, None)
    return (
        None if noted is None else noted.subject,
        known_muscle(truths, notes, DEFAULT_RATE) if truths else None,
    )


def _truths(recording: 'Recording', memory: int | None) -> list[Truth]:
    """Return the messages of a simulation in a recording."""
    facts = recording.facts
    if not any(topic.type_name == messages.MUSCLE_TRUTH for topic in facts.topics):
        return []
    return recorded_messages(
        facts.path, memory=memory, held=held_bytes(recording), only=(messages.MUSCLE_TRUTH,)
    ).truths


def _decoded(scan: Scan, only: tuple[str, ...]) -> Iterator[tuple[str, str, int, Any]]:
    """Yield topic, type, size [bytes] and message, None in place of one that cannot be decoded."""
    for channel, records in scan.blocks():
        if channel.type_name not in only:
            continue
        try:
            types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
        except RecordingError:
            types = None
        for index in range(len(records)):
            data = records.message(index)
            try:
                message = types.deserialize_cdr(data, channel.type_name) if types else None
            except (SerdeError, ValueError, IndexError):
                message = None
            yield channel.topic, channel.type_name, len(data), message


class _Totals:
    """Totals of the statuses of a driver, updated one by one instead of keeping all of them."""

    def __init__(self) -> None:
        self.found: DriverTotals | None = None

    def take(self, status: Any) -> None:
        """Add the next status; raise an exception of `_NOT_THERE` if it is none."""
        before = self.found
        counts = [int(count) for count in status.fault_counts]
        hottest = float(status.coil_temperature)
        if before is not None and before.highest_temperature_celsius >= hottest:
            hottest = before.highest_temperature_celsius
        earlier = None if before is None else before.schedule
        self.found = DriverTotals(
            pulses_delivered=int(status.pulses_delivered),
            pulses_dropped=int(status.pulses_dropped),
            coil_energy_j=float(status.coil_energy),
            highest_temperature_celsius=hottest,
            lateness_max_s=float(status.lateness_max),
            schedule=str(status.schedule) or earlier,
            faults=dict(zip(map(str, status.fault_names), counts, strict=True)),
        )


_SHARES = (25, 50, 75, 100)


def estimate_table(estimates: Sequence[Estimate]) -> EstimateTable:
    """Return estimates as a table.

    Columns: the parameters by their names, each with its standard deviation and whether the data
    determine it; steady force at a quarter, half, three quarters and all of the intensity and the
    numbers of the response, each with the ends of its interval; rates of change, disturbance,
    output error, counts; name of the estimator, faults and doubts.

    Parameters
    ----------
    estimates : sequence of Estimate
        In their order.
    """
    rows = [_numbers(one) for one in estimates]
    texts = [_texts(one) for one in estimates]
    numbers = dict.fromkeys(chain.from_iterable(rows))
    words = dict.fromkeys(chain.from_iterable(texts))
    return EstimateTable(
        np.array([one.stamp_ns for one in estimates], dtype=np.int64),
        {name: np.array([row.get(name, np.nan) for row in rows]) for name in numbers},
        {name: [row.get(name, '') for row in texts] for name in words},
    )


def _numbers(one: Estimate) -> dict[str, float]:
    found: dict[str, float] = {}
    variance = np.diag(one.nonlinear_covariance)
    for index, (name, value) in enumerate(
        zip(one.nonlinear_names, one.nonlinear.tolist(), strict=False)
    ):
        found[name] = value
        if index < len(variance) and variance[index] >= 0.0:
            found[f'{name}_deviation'] = float(np.sqrt(variance[index]))
    for share in _SHARES:
        curves = (one.curve_force, one.curve_lower, one.curve_upper)
        found |= _banded(f'steady_force_{share}', *(_at(one, share, curve) for curve in curves))
    bands = (one.physiology, one.physiology_lower, one.physiology_upper)
    found |= _listed(one.physiology_names, *bands)
    found |= _listed(one.rate_names, one.rate, one.rate_lower, one.rate_upper)
    return found | {
        'disturbance': one.disturbance,
        'disturbance_deviation': one.disturbance_deviation,
        'output_error': one.output_error,
        'confidence': one.confidence,
        'repetition_rate_hz': one.repetition_rate,
        'samples': float(one.samples),
        'pulses': float(one.pulses),
        'changes': float(one.changes),
    }


def _at(one: Estimate, share: int, curve: FloatArray) -> float:
    if not len(curve) or len(curve) != len(one.curve_intensity):
        return float('nan')
    return float(np.interp(share / 100.0, one.curve_intensity, curve))


def _listed(
    names: Sequence[str], values: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, float]:
    """Return values with their intervals by names; NaN where an array is shorter."""
    found: dict[str, float] = {}
    for index, name in enumerate(names):
        ends = (
            float(one[index]) if index < len(one) else float('nan')
            for one in (values, lower, upper)
        )
        found |= _banded(name, *ends)
    return found


def _banded(name: str, value: float, lower: float, upper: float) -> dict[str, float]:
    return {name: value, f'{name}_lower': lower, f'{name}_upper': upper}


def _texts(one: Estimate) -> dict[str, str]:
    flags = one.nonlinear_identifiability.tolist()
    return {
        'estimator': one.estimator,
        'faults': json.dumps(dict(one.faults), sort_keys=True),
        'doubts': '; '.join(one.doubts),
        **{
            f'{name}_determined': IDENTIFIABILITY.get(flag, '')
            for name, flag in zip(one.nonlinear_names, flags, strict=False)
        },
    }
