# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksums of a finished recording, and a signature if there is a key.

``SHA256SUMS`` is the format of ``sha256sum --check``.  ``SHA256SUMS.hmac`` holds the HMAC-SHA256
of that file under the key of the laboratory: it cannot be made without the key.
"""

import hashlib
import hmac
import re
from collections.abc import Iterable
from pathlib import Path

from rpms_ros.errors import RecordingError

try:
    # Ten times as quick: checking a recording then costs next to nothing of reading it.
    from isal.isal_zlib import crc32 as crc32
except ImportError:
    from zlib import crc32 as crc32

SUMS_NAME = 'SHA256SUMS'
SIGNATURE_NAME = 'SHA256SUMS.hmac'
SHORTEST_KEY = 16
_LONGEST = 1 << 16
_LINE = re.compile(r'([0-9a-f]{64})  ([^/\0]+)')
_BLOCK = 1 << 20


def write_checksums(folder: Path, names: Iterable[str], key: bytes | None = None) -> None:
    """Write SHA256SUMS of these files and, with a key, its signature."""
    lines = [f'{sha256(folder / name)}  {name}\n' for name in names]
    text = ''.join(lines).encode()
    (folder / SUMS_NAME).write_bytes(text)
    if key:
        (folder / SIGNATURE_NAME).write_text(f'{signature(text, key)}\n')


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
    lines = checksum_text(folder).decode('utf-8', 'replace').splitlines()
    matches = [_LINE.fullmatch(line) for line in lines]
    found = {match[2]: match[1] for match in matches if match}
    if not found or len(found) < len(lines):
        raise RecordingError(f'expected lines of SHA-256 and file name in {path}, got others')
    return found


def checksum_text(folder: Path) -> bytes:
    """Return the content of SHA256SUMS, the first 64 kB of it at most."""
    path = folder / SUMS_NAME
    if not path.is_file():
        raise RecordingError(f'expected a regular file {path}, got something else')
    with path.open('rb') as file:
        return file.read(_LONGEST)


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open('rb') as file:
        return hashlib.file_digest(file, 'sha256').hexdigest()


def file_crc32(path: Path) -> int:
    """Return the CRC-32 of a file, which is quick enough for every reading."""
    value = 0
    with path.open('rb') as file:
        while block := file.read(_BLOCK):
            value = crc32(block, value)
    return value


def signature(text: bytes, key: bytes) -> str:
    """Return the HMAC-SHA256 of SHA256SUMS as hexadecimal digits."""
    return hmac.new(key, text, hashlib.sha256).hexdigest()


def signature_fits(folder: Path, key: bytes) -> bool | None:
    """Tell whether the signature was made with this key; None if there is none."""
    path = folder / SIGNATURE_NAME
    if not path.is_file():
        return None
    with path.open('rb') as file:
        found = file.read(_LONGEST).strip()
    return hmac.compare_digest(found, signature(checksum_text(folder), key).encode())


def read_key(path: Path) -> bytes:
    """Return the key in a file, without white space around it.

    Raises
    ------
    RecordingError
        If the file cannot be read or the key is too short to protect anything.
    """
    try:
        key = path.read_bytes().strip() if path.is_file() else b''
    except OSError as error:
        raise RecordingError(f'expected a key in {path}, got {error}') from error
    if len(key) < SHORTEST_KEY:
        raise RecordingError(
            f'expected a key of {SHORTEST_KEY} bytes or more in {path}, got {len(key)}'
        )
    return key
