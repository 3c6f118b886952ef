"""Messages of the nodes in a recording: estimates, and the totals of a stimulator driver."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError

from rpms_ros import messages
from rpms_ros.errors import MessageError
from rpms_ros.errors import RecordingError
from rpms_ros.identification import Estimate
from rpms_ros.recording.definitions import MUSCLE_ESTIMATE
from rpms_ros.recording.definitions import types_of
from rpms_ros.recording.scan import Progress
from rpms_ros.recording.scan import Scan

DRIVER_STATUS = 'rpms_msgs/msg/DriverStatus'


@dataclass(frozen=True)
class DriverTotals:
    """Totals that a stimulator driver published, since its device was opened.

    Attributes
    ----------
    pulses_delivered, pulses_dropped : int
        Pulses.
    coil_energy_j : float
        Energy put into the coil [J].
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
    """

    estimates: list[Estimate]
    driver: DriverTotals | None
    unreadable: int


def recorded_messages(path: Path | str, progress: Progress | None = None) -> RecordedMessages:
    """Return the messages of an identifier and a driver in a recording.

    Raises
    ------
    RecordingError
        If the recording cannot be read, or several nodes published estimates.
    """
    estimates: list[Estimate] = []
    statuses: list[Any] = []
    topics: set[str] = set()
    unreadable = 0
    for topic, type_name, message in _decoded(Path(path), progress):
        if message is None:
            unreadable += 1
        elif type_name == DRIVER_STATUS:
            statuses.append(message)
        else:
            topics.add(topic)
            try:
                estimates.append(messages.estimate_of(message))
            except (MessageError, ValueError):
                unreadable += 1
    if len(topics) > 1:
        raise RecordingError(
            f'expected estimates of one identifier in {path}, got {", ".join(sorted(topics))}'
        )
    return RecordedMessages(estimates, _totals_of(statuses), unreadable)


def _decoded(path: Path, progress: Progress | None) -> Iterator[tuple[str, str, Any]]:
    """Yield topic, type and message, None in place of one that cannot be decoded."""
    for channel, records in Scan(path).blocks(progress):
        if channel.type_name not in (MUSCLE_ESTIMATE, DRIVER_STATUS):
            continue
        types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
        for index in range(len(records)):
            try:
                message = types.deserialize_cdr(records.message(index), channel.type_name)
            except (SerdeError, ValueError, IndexError):
                message = None
            yield channel.topic, channel.type_name, message


def _totals_of(statuses: list[Any]) -> DriverTotals | None:
    if not statuses:
        return None
    last = statuses[-1]
    counts = (int(count) for count in last.fault_counts)
    names = [str(status.schedule) for status in statuses if status.schedule]
    return DriverTotals(
        pulses_delivered=int(last.pulses_delivered),
        pulses_dropped=int(last.pulses_dropped),
        coil_energy_j=float(last.coil_energy),
        highest_temperature_celsius=max(float(status.coil_temperature) for status in statuses),
        lateness_max_s=float(last.lateness_max),
        schedule=names[-1] if names else None,
        faults=dict(zip(map(str, last.fault_names), counts, strict=True)),
    )
