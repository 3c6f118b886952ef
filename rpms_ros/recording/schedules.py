# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules that a driver accepted, as a recording has them."""

import hashlib
from dataclasses import dataclass
from typing import Any

from rosbags.serde import SerdeError

from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted
from rpms_ros.printable import printable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording.budget import Budget
from rpms_ros.recording.definitions import types_of
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.records import Channel
from rpms_ros.recording.records import Records
from rpms_ros.schema import documented

ACCEPTED_SCHEDULE = 'rpms_msgs/msg/AcceptedSchedule'
_MOST = 1000
_LONGEST_NAME = 200


@dataclass(frozen=True, kw_only=True)
class RecordedSchedule:
    """A schedule that a driver accepted."""

    name: str = documented('what people call it')
    sha256: str = documented('hash of its text, computed from the text in the recording')
    pulses: int = documented('that it stands for')
    duration_s: float = documented('[s]')
    operator: str = documented('who asked for it; empty where nobody is asked for')
    accepted_ns: int = documented('stamp of its acceptance [ns]')

    def __str__(self) -> str:
        who = f', started by {self.operator}' if self.operator else ''
        pulses = counted(self.pulses, 'pulse')
        return f'{self.name}, {pulses}, {self.duration_s:g} s{who}, sha256 {self.sha256}'


class ScheduleReading:
    """Collects the schedules while a recording is read.

    Parameters
    ----------
    findings : Findings
        Where faults are noted.
    budget : Budget
        What reading may take.
    """

    def __init__(self, findings: Findings, budget: Budget) -> None:
        self._findings = findings
        self._budget = budget
        self._found: list[RecordedSchedule] = []

    @property
    def schedules(self) -> tuple[RecordedSchedule, ...]:
        """What was found, in the order of the recording."""
        return tuple(self._found)

    def take(self, channel: Channel, records: Records) -> None:
        """Keep the schedules among these messages."""
        if channel.type_name != ACCEPTED_SCHEDULE:
            return
        try:
            types = types_of(channel.type_name, channel.definition, channel.definition_encoding)
        except RecordingError as error:
            self._findings.add('undecodable_message', str(error), len(records))
            return
        for index in range(len(records)):
            try:
                message = types.deserialize_cdr(records.message(index), channel.type_name)
                self._keep(channel.topic, message)
            except (SerdeError, AttributeError, IndexError, TypeError, ValueError) as error:
                reason = f'{channel.topic}: expected a schedule, got {type(error).__name__}'
                self._findings.add('undecodable_message', reason)

    def _keep(self, topic: str, message: Any) -> None:
        found = _schedule_of(message)
        if found.sha256 != str(message.sha256):
            self._findings.add(
                'altered_schedule',
                f'{topic}: the text of {found.name} is not the one whose hash was recorded',
            )
        if len(self._found) < _MOST:
            self._budget.keep(1)
            self._found.append(found)
        else:
            self._findings.add('too_many_schedules', f'{topic}: more than {_MOST} schedules')


def _schedule_of(message: Any) -> RecordedSchedule:
    text = str(message.schedule).encode('utf-8', 'surrogateescape')
    stamp = message.header.stamp
    return RecordedSchedule(
        name=printable(str(message.name))[:_LONGEST_NAME],
        sha256=hashlib.sha256(text).hexdigest(),
        pulses=int(message.pulses),
        duration_s=float(message.duration),
        operator=printable(str(message.operator_id))[:_LONGEST_NAME],
        accepted_ns=int(stamp.sec) * NANOSECONDS_PER_SECOND + int(stamp.nanosec),
    )
