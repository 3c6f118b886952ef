# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All messages of a recording, block by block, with what is found about its topics on the way."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording.rosbag.checksums import file_crc32
from rpms_ros.recording.rosbag.compression import ZSTD_MAGIC, unpacked
from rpms_ros.recording.rosbag.files import RecordingFiles, find_files, opened
from rpms_ros.recording.rosbag.metadata import NAME as METADATA
from rpms_ros.recording.rosbag.records import Batch, Budget, Channel, Findings, Records, gather

Progress = Callable[[int], None]
"""Is told how many messages were read since the last call."""

_SILENT_NS = NANOSECONDS_PER_SECOND // 2


@dataclass(frozen=True)
class TopicFacts:
    """What is known of a topic of one type.

    Attributes
    ----------
    name, type_name : str
        Topic and type of its messages.
    count : int
        Number of messages.
    first_ns, last_ns : int
        When the first and the last of them were received [ns]; 0 if there are none.
    silent_ns : int
        Sum of the gaps of more than half a second between them [ns].
    """

    name: str
    type_name: str
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    silent_ns: int = 0

    def with_records(self, records: Records) -> 'TopicFacts':
        """Return the facts with more messages."""
        first, last = int(records.time_ns.min()), int(records.time_ns.max())
        times = np.append(records.time_ns, self.last_ns if self.count else first)
        steps = np.diff(np.sort(times))
        return TopicFacts(
            self.name,
            self.type_name,
            self.count + len(records),
            min(first, self.first_ns) if self.count else first,
            max(last, self.last_ns) if self.count else last,
            self.silent_ns + int(steps[steps > _SILENT_NS].sum()),
        )


@dataclass
class Scan:
    """One pass over a recording.

    Attributes
    ----------
    path : Path
        Folder or file.
    memory : int or None
        What reading may take [bytes]; None for 1 GB and four times the size of the recording.
    findings : Findings
        Faults, complete after the pass.
    topics : dict of (topic, type) to TopicFacts
        Complete after the pass.
    """

    path: Path
    memory: int | None = None
    findings: Findings = field(default_factory=Findings)
    topics: dict[tuple[str, str], TopicFacts] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._count = 0
        self.files: RecordingFiles = find_files(self.path, self.findings)
        self.budget = Budget(self.files.size, self.memory)

    def blocks(self, progress: Progress | None = None) -> Iterator[tuple[Channel, Records]]:
        """Yield the messages in the order of the files.

        Raises
        ------
        RecordingError
            If no file of the recording can be read.
        """
        for name, type_name in self.files.topics.items():
            self.topics[name, type_name] = TopicFacts(name, type_name)
        for path in self.files.paths:
            try:
                yield from self._file(path, progress)
            except (RecordingError, OSError) as error:
                if len(self.files.paths) == 1:
                    raise _one_class(error) from error
                self.findings.add('unreadable_file', f'{path.name} left out: {error}')
        stated = self.files.message_count
        if stated not in (None, self._count) and not self.findings.counts:
            remark = f'{METADATA} states {stated} messages, got {self._count}'
            self.findings.add('wrong_count', remark)

    def _file(self, path: Path, progress: Progress | None) -> Iterator[tuple[Channel, Records]]:
        self._check_sum(path)
        with opened(path, self.findings, self.budget) as file:
            for batch in file.batches():
                for number, records in self._placed(batch):
                    if number not in file.channels:
                        self._unknown(path, number, len(records))
                        continue
                    channel = file.channels[number]
                    self._facts(channel)
                    key = channel.topic, channel.type_name
                    self.topics[key] = self.topics[key].with_records(records)
                    if progress:
                        progress(len(records))
                    yield channel, _unpacked(records, self.budget)
            for channel in file.channels.values():
                self._facts(channel)

    def _placed(self, batch: Batch) -> Iterator[tuple[int, Records]]:
        """Yield the messages of each topic with its number, and count their places."""
        place = np.arange(self._count, self._count + len(batch), dtype=np.int64)
        self._count += len(batch)
        whole = replace(batch.records, place=place)
        for number in np.unique(batch.topic).tolist():
            yield number, whole.select(batch.topic == number)

    def _check_sum(self, path: Path) -> None:
        """Compare a sqlite3 file, which has no checksums of its own, with the stated one."""
        if self.files.crc32 is not None and file_crc32(path) != self.files.crc32:
            self.findings.add('wrong_checksum', f'the checksum of {path.name} does not fit')

    def _unknown(self, path: Path, number: int, count: int) -> None:
        remark = f'messages of topic number {number} left out: {path.name} does not describe it'
        self.findings.add('unknown_channel', remark, count)

    def _facts(self, channel: Channel) -> None:
        key = channel.topic, channel.type_name
        self.topics.setdefault(key, TopicFacts(*key))


def _one_class(error: Exception) -> RecordingError:
    return error if isinstance(error, RecordingError) else RecordingError(str(error))


def _unpacked(records: Records, budget: Budget) -> Records:
    """Return messages that were packed one by one (`compression_mode: message`) as they were."""
    long_enough = records.end - records.start >= len(ZSTD_MAGIC)
    head = gather(records.buffer, records.start[long_enough], 'V4')
    if not (head == np.void(ZSTD_MAGIC)).any():
        return records
    messages: list[bytes] = []
    for index in range(len(records)):
        message = records.message(index)
        if message.startswith(ZSTD_MAGIC):
            message = unpacked(message, 'zstd', budget.chunk)
            budget.unpack(len(message), 'a message')
        messages.append(message)
    return Records.of(messages, records.time_ns, records.place)
