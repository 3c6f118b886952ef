# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Raw messages of several topics in one order, ready to be written."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import IntArray
from rpms_ros.recording.records import Records


@dataclass(frozen=True)
class Batch:
    """Messages with the numbers of their topics.

    Attributes
    ----------
    topic : ndarray of int64, shape (messages,)
        Number of the topic that the writer gave.
    records : Records
        The messages.
    """

    topic: IntArray
    records: Records

    def __len__(self) -> int:
        return len(self.topic)


def merged(topics: Mapping[int, Records]) -> Batch:
    """Return the messages of several topics in the order of reception.

    The order within a topic is kept, also where its clock was set back.  If that happened equally
    often in every topic, what came after it is merged by the times after it.  At equal times the
    topic that comes first in `topics` is first: give pulses before forces.
    """
    records = list(topics.values())
    shift = np.cumsum([0, *(len(part.buffer) for part in records)])
    number = [np.full(len(part), key, np.int64) for key, part in topics.items()]
    time_ns = _joined([part.time_ns for part in records])
    order = _order_of_reception([part.time_ns for part in records])
    begins = [part.start + offset for part, offset in zip(records, shift, strict=False)]
    ends = [part.end + offset for part, offset in zip(records, shift, strict=False)]
    whole = Records(
        np.concatenate([part.buffer for part in records]), _joined(begins), _joined(ends), time_ns
    )
    return Batch(_joined(number)[order], whole.select(order))


def _order_of_reception(times_ns: Sequence[IntArray]) -> IntArray:
    """Return what sorts the joined times of all topics without changing the order within one."""
    lines = [
        np.cumsum(np.diff(times, prepend=times[:1]) < 0, dtype=np.int64) for times in times_ns
    ]
    if len({int(line[-1]) for line in lines if len(line)}) > 1:
        rising = [np.maximum.accumulate(times) for times in times_ns]
        return np.argsort(_joined(rising), kind='stable')
    return np.lexsort((_joined(times_ns), _joined(lines)))


def _joined(parts: Sequence[IntArray]) -> IntArray:
    return np.concatenate(parts) if parts else np.empty(0, np.int64)
