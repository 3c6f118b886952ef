# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording: its files, and all messages with what is found about its topics.

A recording is a folder with metadata.yaml, one without, or a file by itself.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording.rosbag.mcap_files import McapFile
from rpms_ros.recording.rosbag.metadata import NAME as METADATA, read_metadata
from rpms_ros.recording.rosbag.records import (
    ZSTD_MAGIC,
    Budget,
    Channel,
    Findings,
    Records,
    StorageFile,
    gather,
    unpack_file,
    unpacked,
)
from rpms_ros.recording.rosbag.sqlite_files import SqliteFile

Progress = Callable[[int], None]
"""Is told how many messages were read since the last call."""
READERS: dict[str, type[StorageFile]] = {'.mcap': McapFile, '.db3': SqliteFile}
_PACKED_SUFFIX = '.zstd'


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
        steps = np.diff(np.sort(np.append(records.time_ns, self.last_ns if self.count else first)))
        return replace(
            self,
            count=self.count + len(records),
            first_ns=min(first, self.first_ns) if self.count else first,
            last_ns=max(last, self.last_ns) if self.count else last,
            silent_ns=self.silent_ns + int(steps[steps > NANOSECONDS_PER_SECOND // 2].sum()),
        )


class Scan:
    """One pass over a recording.

    Parameters
    ----------
    path : Path
        Folder or file.
    memory : int or None
        What reading may take [bytes]; None for 1 GB and four times the size of the recording.

    Attributes
    ----------
    paths : list of Path
        Storage files that are there, in their order.
    storage : str
        ``mcap`` or ``sqlite3``.
    custom : dict of str to str
        What the writer noted for people.
    findings : Findings
        Faults, complete after the pass.
    topics : dict of (topic, type) to TopicFacts
        Complete after the pass; with topics without messages, as metadata.yaml tells.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """

    def __init__(self, path: Path, memory: int | None = None) -> None:
        self.path = path
        self.findings = Findings()
        self._count = 0
        try:
            self.paths, metadata = _found(path, self.findings)
            size = sum(file.stat().st_size for file in self.paths)
        except OSError as error:
            raise RecordingError(f'expected a recording that may be read, got {error}') from error
        self.budget = Budget(size, memory)
        self.storage = 'mcap' if _suffix(self.paths[0]) == '.mcap' else 'sqlite3'
        named = metadata.get('storage_identifier', self.storage)
        if named != self.storage:
            remark = f'{METADATA} names the storage {named!r:.40}, got files of {self.storage}'
            self.findings.add('damaged_metadata', remark)
        custom = (metadata.get('custom_data') or {}).items()
        # a few aliases within each other stand for more than a memory holds
        plain = (str, int, float)
        self.custom = {str(key): str(one) for key, one in custom if isinstance(one, plain)}
        self._stated = metadata.get('message_count')
        entries = [one['topic_metadata'] for one in metadata.get('topics_with_message_count', [])]
        keys = [(entry['name'], entry['type']) for entry in entries]
        self.topics: dict[tuple[str, str], TopicFacts] = {key: TopicFacts(*key) for key in keys}

    def blocks(self, progress: Progress | None = None) -> Iterator[tuple[Channel, Records]]:
        """Yield the messages in the order of the files.

        Raises
        ------
        RecordingError
            If no file of the recording can be read.
        """
        for path in self.paths:
            try:
                yield from self._file(path, progress)
            except (RecordingError, OSError) as error:
                if len(self.paths) == 1:
                    raise RecordingError(str(error)) from error
                self.findings.add('unreadable_file', f'{path.name} left out: {error}')
        if self._stated not in (None, self._count) and not self.findings.counts:
            remark = f'{METADATA} states {self._stated} messages, got {self._count}'
            self.findings.add('wrong_count', remark)

    def _file(self, path: Path, progress: Progress | None) -> Iterator[tuple[Channel, Records]]:
        with self._opened(path) as file:
            for topic, batch in file.batches():
                whole = replace(batch, place=np.arange(self._count, self._count + len(topic)))
                self._count += len(topic)
                for number in np.unique(topic).tolist():
                    records = whole.select(topic == number)
                    if number not in file.channels:
                        remark = f'messages of topic number {number} left out: {path.name} '
                        remark += 'does not describe it'
                        self.findings.add('unknown_channel', remark, len(records))
                        continue
                    channel = file.channels[number]
                    key = channel.topic, channel.type_name
                    self.topics[key] = self.topics.get(key, TopicFacts(*key)).with_records(records)
                    if progress:
                        progress(len(records))
                    yield channel, _unpacked(records, self.budget)
            for channel in file.channels.values():
                key = channel.topic, channel.type_name
                self.topics.setdefault(key, TopicFacts(*key))

    @contextmanager
    def _opened(self, path: Path) -> Iterator[StorageFile]:
        """Open one file, unpacked first if it is packed as a whole."""
        reader = READERS[_suffix(path)]
        if path.suffix != _PACKED_SUFFIX:
            yield reader(path, self.findings, self.budget)
            return
        with TemporaryDirectory() as folder:
            plain = Path(folder, path.stem)
            complete = unpack_file(path, plain, self.budget.memory)
            if complete is None:
                raise self.budget.exceeded(f'{path.name}, which unpacks into more')
            if not complete:
                self.findings.add('truncated_file', f'{path.name} is cut off or damaged')
            yield reader(plain, self.findings, self.budget)


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


def _found(path: Path, findings: Findings) -> tuple[list[Path], dict[str, Any]]:
    """Return the storage files, and what metadata.yaml tells."""
    if not path.exists():
        raise RecordingError(f'expected a recording at {path}, got no such file or folder')
    metadata: dict[str, Any] = {}
    paths = [path] if _is_storage(path) else []
    if path.is_dir():
        metadata = read_metadata(path / METADATA, findings)
        listed = [path / Path(name).name for name in metadata.get('relative_file_paths', [])]
        for one in itertools.filterfalse(_is_storage, listed):
            findings.add('missing_file', f'{one.name} is named in {METADATA} but not there')
        # Part 2 before part 10; what is packed beside itself is one file.
        found = _by_name(filter(_is_storage, path.iterdir()))
        paths = [*filter(_is_storage, listed)] or [*found.values()]
        for name in sorted(found.keys() - _by_name(paths).keys()):
            findings.add('unlisted_file', f'{name} is not named in {METADATA}: left out')
    elif paths:
        # Of the metadata beside a file only the notes, and only if they are its own.
        beside = read_metadata(path.with_name(METADATA), Findings())
        if beside.get('relative_file_paths') == [path.name] and 'custom_data' in beside:
            metadata = {'custom_data': beside['custom_data']}
    if not paths:
        named = metadata.get('storage_identifier')
        other = f' ({METADATA} names the storage {named!r:.40})' if named else ''
        if path.is_file():
            other = '; `rpms import` makes a recording of a table or of a file of other software'
        raise RecordingError(f'expected .mcap or .db3 files at {path}, got none{other}')
    return paths, metadata


def _by_name(files: Iterable[Path]) -> dict[str, Path]:
    """Return storage files by their names, part 2 before part 10; one that is packed too once."""

    def place(one: Path) -> tuple[int, str, int]:
        name = one.name.removesuffix(_PACKED_SUFFIX)
        return len(name), name, -len(one.name)

    return {place(one)[1]: one for one in sorted(files, key=place)}


def _is_storage(path: Path) -> bool:
    # Not a pipe, which would be waited for, nor a device.
    return bool(_suffix(path)) and path.is_file()


def _suffix(path: Path) -> str:
    """Return the suffix of the storage, or nothing."""
    name = path.name.removesuffix(_PACKED_SUFFIX)
    return next((suffix for suffix in READERS if name.endswith(suffix)), '')
