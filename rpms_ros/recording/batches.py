"""Raw messages of several topics in one order, ready to be written."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import IntArray
from rpms_ros.recording.records import ByteArray
from rpms_ros.recording.records import Records
from rpms_ros.recording.records import windows


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

    def part(self, begin: int, end: int) -> 'Batch':
        """Return the messages from `begin` up to `end`."""
        return Batch(self.topic[begin:end], self.records.select(slice(begin, end)))


def merged(topics: Mapping[int, Records]) -> Batch:
    """Return the messages of several topics in the order of reception.

    At equal times the topic that comes first in `topics` is first: give pulses before forces.
    """
    records = list(topics.values())
    shift = np.cumsum([0, *(len(part.buffer) for part in records)])
    number = [np.full(len(part), key, np.int64) for key, part in topics.items()]
    time_ns = _joined([part.time_ns for part in records])
    order = np.argsort(time_ns, kind='stable')
    begins = [part.start + offset for part, offset in zip(records, shift, strict=False)]
    ends = [part.end + offset for part, offset in zip(records, shift, strict=False)]
    whole = Records(
        np.concatenate([part.buffer for part in records]), _joined(begins), _joined(ends), time_ns
    )
    return Batch(_joined(number)[order], whole.select(order))


def _joined(parts: Sequence[IntArray]) -> IntArray:
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


def copied(records: Records, target: ByteArray, at: IntArray) -> None:
    """Copy messages into `target`, each to its place, one length after the other."""
    length = records.end - records.start
    for size in np.unique(length).tolist():
        if size:
            chosen = length == size
            source = windows(records.buffer, f'V{size}')
            windows(target, f'V{size}')[at[chosen]] = source[records.start[chosen]]
