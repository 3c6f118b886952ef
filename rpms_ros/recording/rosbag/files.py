# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording: a folder with metadata.yaml, one without, or a file by itself."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from rpms_ros.errors import RecordingError
from rpms_ros.recording.rosbag.compression import unpack_file
from rpms_ros.recording.rosbag.mcap_files import McapFile
from rpms_ros.recording.rosbag.metadata import CRC_KEY, NAME, read_metadata
from rpms_ros.recording.rosbag.records import Batch, Budget, Channel, Findings
from rpms_ros.recording.rosbag.sqlite_files import SqliteFile

PACKED_SUFFIX = '.zstd'


class StorageFile(Protocol):
    """One file with messages."""

    channels: dict[int, Channel]
    """Channels that were met so far, by number."""

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in the order of the file."""


READERS: dict[str, type[McapFile] | type[SqliteFile]] = {'.mcap': McapFile, '.db3': SqliteFile}


@dataclass(frozen=True)
class RecordingFiles:
    """Files of a recording in their order.

    Attributes
    ----------
    paths : tuple of Path
        Files that are there.
    storage : str
        ``mcap`` or ``sqlite3``.
    topics : dict of str to str
        Type by topic as metadata.yaml tells, also of topics without messages.
    custom : dict of str to str
        What the writer noted for people.
    message_count : int or None
        Number of messages as metadata.yaml tells.
    crc32 : int or None
        Checksum of a sqlite3 file as metadata.yaml tells.
    """

    paths: tuple[Path, ...]
    storage: str
    topics: dict[str, str]
    custom: dict[str, str]
    message_count: int | None = None
    crc32: int | None = None

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(path.stat().st_size for path in self.paths)


def find_files(path: Path, findings: Findings) -> RecordingFiles:
    """Return the files of a recording.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """
    try:
        return _found(path, findings)
    except OSError as error:
        raise RecordingError(f'expected a recording that may be read, got {error}') from error


def _found(path: Path, findings: Findings) -> RecordingFiles:
    if not path.exists():
        raise RecordingError(f'expected a recording at {path}, got no such file or folder')
    metadata: dict[str, Any] = {}
    if path.is_dir():
        metadata = read_metadata(path / NAME, findings)
        paths = _listed(path, metadata, findings) or _storage_files(path)
    else:
        paths = [path] if _is_storage(path) else []
        metadata = _beside_file(path)
    named = metadata.get('storage_identifier')
    if not paths:
        other = f' ({NAME} names the storage {named!r:.40})' if named else ''
        if path.is_file():
            other = '; `rpms import` makes a recording of a table or of a file of other software'
        raise RecordingError(f'expected .mcap or .db3 files at {path}, got none{other}')
    storage = 'mcap' if _suffix(paths[0]) == '.mcap' else 'sqlite3'
    if named not in (None, storage):
        remark = f'{NAME} names the storage {named!r:.40}, got files of {storage}'
        findings.add('damaged_metadata', remark)
    topics = [entry['topic_metadata'] for entry in metadata.get('topics_with_message_count', [])]
    custom = {str(key): str(value) for key, value in (metadata.get('custom_data') or {}).items()}
    crc32 = custom.pop(CRC_KEY, '')
    return RecordingFiles(
        tuple(paths),
        storage,
        {topic['name']: topic['type'] for topic in topics},
        custom,
        metadata.get('message_count') if path.is_dir() else None,
        int(crc32, 16) if re.fullmatch('[0-9a-f]{8}', crc32) else None,
    )


def _listed(folder: Path, metadata: dict[str, Any], findings: Findings) -> list[Path]:
    """Return the files that the metadata name and that exist."""
    paths: list[Path] = []
    for name in metadata.get('relative_file_paths', []):
        path = folder / Path(name).name
        if _is_storage(path):
            paths.append(path)
        else:
            findings.add('missing_file', f'{path.name} is named in {NAME} but not there')
    return paths


def _storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder, part 2 before part 10."""
    return sorted(filter(_is_storage, folder.iterdir()), key=_natural_order)


def _natural_order(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r'(\d+)', path.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]


def _beside_file(path: Path) -> dict[str, Any]:
    """Return the metadata beside a storage file, without its topics, if they are its own."""
    metadata = read_metadata(path.with_name(NAME), Findings())
    return {
        key: value
        for key, value in metadata.items()
        if key == 'custom_data' and metadata['relative_file_paths'] == [path.name]
    }


def _is_storage(path: Path) -> bool:
    # Not a pipe, which would be waited for, nor a device.
    return bool(_suffix(path)) and path.is_file()


def _suffix(path: Path) -> str:
    """Return the suffix of the storage, or nothing."""
    name = path.name.removesuffix(PACKED_SUFFIX)
    return next((suffix for suffix in READERS if name.endswith(suffix)), '')


@contextmanager
def opened(path: Path, findings: Findings, budget: Budget) -> Iterator[StorageFile]:
    """Open one file, unpacked first if it is packed as a whole."""
    reader = READERS[_suffix(path)]
    if path.suffix != PACKED_SUFFIX:
        yield reader(path, findings, budget)
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder, path.stem)
        complete = unpack_file(path, plain, budget.memory)
        if complete is None:
            raise budget.exceeded(f'{path.name}, which unpacks into more')
        if not complete:
            findings.add('truncated_file', f'{path.name} is cut off or damaged')
        yield reader(plain, findings, budget)
