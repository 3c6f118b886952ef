# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a topic by who published them: those that count, and those of others."""

from dataclasses import replace

import numpy as np

from rpms_ros.identification.arrival_order import NO_FOREIGN
from rpms_ros.identification.arrival_order import Foreign
from rpms_ros.identification.first_publisher import counting
from rpms_ros.identification.stream_settings import StreamSettings
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import nanoseconds
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.topic_reading import TopicValues


def listened(
    values: TopicValues, findings: Findings, name: str
) -> tuple[TopicValues, TopicValues | None]:
    """Return the messages that an identifier listens to, and those of others if there are any.

    The others are noted among the findings, under the name of the topic.
    """
    if values.publisher is None:
        return values, None
    silence_ns = nanoseconds(StreamSettings().longest_gap)
    own = counting(values.publisher, values.stamp_ns(), silence_ns)
    count = int(np.count_nonzero(~own))
    if not count:
        return values, None
    remark = f'{count} messages of another publisher of {name} left out'
    findings.add('several_publishers', remark, count)
    return _chosen(values, own), _chosen(values, ~own)


def foreign_messages(
    force: TopicValues, other_forces: TopicValues | None, other_pulses: TopicValues | None
) -> Foreign:
    """Return what came of others among the samples that count."""
    nothing = NO_FOREIGN.onset_ns
    return Foreign(
        nothing if other_forces is None else np.searchsorted(force.place, other_forces.place),
        nothing if other_pulses is None else other_pulses.stamp_ns(),
        nothing if other_pulses is None else samples_before(other_pulses, force),
    )


def samples_before(messages: TopicValues, force: TopicValues) -> IntArray:
    """Return how many samples were received before each message (messages,) of another topic.

    Where the clock of reception was set back, only the order of the recording tells.  Otherwise
    the times do, since a recording may also have been written one topic after the other; a pulse
    comes before a sample of the same time.
    """
    rising = all((np.diff(topic.received_ns) >= 0).all() for topic in (messages, force))
    if rising:
        return np.searchsorted(force.received_ns, messages.received_ns, side='left')
    return np.searchsorted(force.place, messages.place)


def _chosen(values: TopicValues, chosen: BoolArray) -> TopicValues:
    return replace(
        values,
        number={path: column[chosen] for path, column in values.number.items()},
        received_ns=values.received_ns[chosen],
        place=values.place[chosen],
        publisher=None,
    )
