"""The files of a recording: a folder with metadata.yaml, one without, or a file by itself."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from typing import Protocol

import yaml

from rpms_ros.errors import RecordingError
from rpms_ros.recording.batches import Batch
from rpms_ros.recording.compression import unpack_file
from rpms_ros.recording.findings import Findings
from rpms_ros.recording.mcap_reading import McapFile
from rpms_ros.recording.records import Channel
from rpms_ros.recording.sqlite_reading import SqliteFile

METADATA_NAME = 'metadata.yaml'
METADATA_KEY = 'rosbag2_bagfile_information'
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
    """

    paths: tuple[Path, ...]
    storage: str
    topics: dict[str, str]
    custom: dict[str, str]


def find_files(path: Path, findings: Findings) -> RecordingFiles:
    """Return the files of a recording.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """
    if not path.exists():
        raise RecordingError(f'expected a recording at {path}, got no such file or folder')
    metadata: dict[str, Any] = {}
    if path.is_dir():
        metadata = _metadata(path / METADATA_NAME, findings)
        paths = _listed(path, metadata, findings) or _storage_files(path)
    else:
        paths = [path] if _suffix(path) else []
    if not paths:
        raise RecordingError(f'expected .mcap or .db3 files at {path}, got none')
    topics = [entry['topic_metadata'] for entry in metadata.get('topics_with_message_count', [])]
    return RecordingFiles(
        tuple(paths),
        'mcap' if _suffix(paths[0]) == '.mcap' else 'sqlite3',
        {topic['name']: topic['type'] for topic in topics},
        dict(metadata.get('custom_data') or {}),
    )


def _metadata(path: Path, findings: Findings) -> dict[str, Any]:
    if not path.exists():
        findings.add('missing_metadata', f'{path.name} is missing: read without it')
        return {}
    try:
        content = yaml.load(path.read_text(), getattr(yaml, 'CSafeLoader', yaml.SafeLoader))
        metadata = _checked(content[METADATA_KEY])
    except (yaml.YAMLError, TypeError, KeyError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0]
        findings.add('damaged_metadata', f'{path.name} left aside: {reason}')
        return {}
    return metadata


def _checked(metadata: Any) -> dict[str, Any]:
    """Return metadata that have the entries which are used later."""
    for entry in metadata['topics_with_message_count']:
        str(entry['topic_metadata']['name'] + entry['topic_metadata']['type'])
    for name in metadata['relative_file_paths']:
        Path(name)
    return dict(metadata)


def _listed(folder: Path, metadata: dict[str, Any], findings: Findings) -> list[Path]:
    """Return the files that the metadata name and that exist."""
    paths: list[Path] = []
    for name in metadata.get('relative_file_paths', []):
        path = folder / Path(name).name
        if path.exists() and _suffix(path):
            paths.append(path)
        else:
            findings.add('missing_file', f'{path.name} is named in {METADATA_NAME} but not there')
    return paths


def _storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder, part 2 before part 10."""
    return sorted(filter(_suffix, folder.iterdir()), key=_natural_order)


def _natural_order(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r'(\d+)', path.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]


def _suffix(path: Path) -> str:
    """Return the suffix of the storage, or nothing."""
    name = path.name.removesuffix(PACKED_SUFFIX)
    return next((suffix for suffix in READERS if name.endswith(suffix)), '')


@contextmanager
def opened(path: Path, findings: Findings) -> Iterator[StorageFile]:
    """Open one file, unpacked first if it is packed as a whole."""
    reader = READERS[_suffix(path)]
    if path.suffix != PACKED_SUFFIX:
        yield reader(path, findings)
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder, path.stem)
        if not unpack_file(path, plain):
            findings.add('truncated_file', f'{path.name} is cut off or damaged')
        yield reader(plain, findings)
