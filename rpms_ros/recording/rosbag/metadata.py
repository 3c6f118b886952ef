# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands beside the messages of a recording: metadata.yaml and checksums.

metadata.yaml is believed only if it is whole and what it should be.  No YAML reader of Python
bounds how deep it calls itself.

``SHA256SUMS`` is the format of ``sha256sum --check``; who signs it signs the recording.
"""

import hashlib
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from rpms_ros.errors import MISREAD, RecordingError
from rpms_ros.recording.rosbag.records import Findings

NAME = 'metadata.yaml'
KEY = 'rosbag2_bagfile_information'
# A recording with a thousand topics has a tenth of it [bytes].
_LARGEST = 4_000_000
_DEEPEST = 32
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_REQUIRED = ('version', 'storage_identifier', 'relative_file_paths', 'message_count')
# The key that rosbag2 writes last, from a version on: a file without it was cut off.
_LAST = {
    1: 'topics_with_message_count',
    3: 'compression_mode',
    5: 'files',
    6: 'custom_data',
    8: 'ros_distro',
}
_KINDS: dict[str, type | tuple[type, ...]] = {
    'version': int,
    'message_count': int,
    'relative_file_paths': list,
    'topics_with_message_count': list,
    'custom_data': (dict, type(None)),
}


_FAULTS = (yaml.YAMLError, OSError, RecordingError, *MISREAD)


def read_metadata(path: Path, findings: Findings) -> dict[str, Any]:
    """Return what metadata.yaml tells; nothing, and a fault, if it is missing or damaged."""
    if not path.exists():
        findings.add('missing_metadata', f'{path.name} is missing: read without it')
        return {}
    try:
        # Neither a pipe nor larger than any description.
        if not path.is_file() or path.stat().st_size > _LARGEST:
            raise RecordingError(f'expected a regular file of {_LARGEST} bytes at most')
        metadata = _checked(_loaded(path.read_text('utf-8'))[KEY])
    except _FAULTS as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        findings.add('damaged_metadata', f'{path.name} left aside: {reason}')
        return {}
    try:
        sums = read_checksums(path.parent)
    except (OSError, RecordingError) as error:
        findings.add('wrong_checksum', str(error))
        return metadata
    if sums is None:
        return metadata
    # mcap files have quicker checksums
    for name in (path.name, *(name for name in sums if name.endswith('.db3'))):
        if not fits(path.parent / name, sums.get(name)):
            findings.add('wrong_checksum', f'{name} is not what was written: its SHA-256 differs')
    return metadata


def _loaded(text: str) -> Any:
    """Return a YAML document that is not too deep: its loader calls itself for every level.

    Raises
    ------
    RecordingError
        If it is too deep.
    yaml.YAMLError, ValueError
        If it is no YAML.
    """
    depth = 0
    for event in yaml.parse(text, _LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise RecordingError(f'expected at most {_DEEPEST} levels')
    return yaml.load(text, _LOADER)


def _checked(metadata: Any) -> dict[str, Any]:
    """Return metadata that have all keys of their version, with values that can be used.

    Raises
    ------
    RecordingError
        If something is missing: the file may have been cut off between two keys.
    """
    if not isinstance(metadata, dict):
        raise RecordingError(f'expected a mapping, got {type(metadata).__name__}')
    for name, kind in _KINDS.items():
        if name in metadata and not isinstance(metadata[name], kind):
            raise RecordingError(f'expected another {name}, got {metadata[name]!r:.80}')
    last = (name for since, name in _LAST.items() if metadata['version'] >= since)
    if missing := [name for name in (*_REQUIRED, *last) if name not in metadata]:
        raise RecordingError(f'expected {", ".join(missing)}, got no such entry')
    texts = list(metadata['relative_file_paths'])
    for entry in metadata['topics_with_message_count']:
        texts += [entry['topic_metadata']['name'], entry['topic_metadata']['type']]
    if wrong := [text for text in texts if not isinstance(text, str)]:
        raise RecordingError(f'expected names as text, got {wrong[0]!r:.80}')
    return metadata


SUMS_NAME = 'SHA256SUMS'
_LONGEST = 1 << 16
_LINE = re.compile(r'([0-9a-f]{64})  ([^/\0]+)')


def write_checksums(folder: Path, names: Iterable[str]) -> None:
    """Write SHA256SUMS of these files."""
    text = ''.join(f'{sha256(folder / name)}  {name}\n' for name in names)
    (folder / SUMS_NAME).write_text(text, 'utf-8', 'surrogateescape')


def fits(path: Path, digest: str | None) -> bool:
    """Return whether a file can be read and has this SHA-256."""
    with suppress(OSError):
        return path.is_file() and sha256(path) == digest
    return False


def read_checksums(folder: Path) -> dict[str, str] | None:
    """Return the SHA-256 by file name; None if the recording has no checksums.

    Raises
    ------
    RecordingError
        If the file is no list of checksums.
    """
    path = folder / SUMS_NAME
    if not path.exists():
        return None
    if not path.is_file():
        raise RecordingError(f'expected a regular file {path}, got something else')
    with path.open('rb') as file:
        lines = file.read(_LONGEST).decode('utf-8', 'surrogateescape').splitlines()
    found = {match[2]: match[1] for match in map(_LINE.fullmatch, lines) if match}
    if not found or len(found) < len(lines):
        raise RecordingError(f'expected lines of SHA-256 and file name in {path}, got others')
    return found


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open('rb') as file:
        return hashlib.file_digest(file, 'sha256').hexdigest()
