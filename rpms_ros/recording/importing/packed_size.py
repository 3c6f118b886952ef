# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What packed variables of a MATLAB file unpack into, told before they are unpacked.

A file of version 5 is a head of 128 bytes, then elements of a type, a size and content.  Each
variable may be packed by zlib: its first eight bytes unpacked are type and size of what it holds.
"""

import zlib
from pathlib import Path

from rpms_ros.errors import RecordingError
from rpms_ros.recording.budget import LEAST
from rpms_ros.recording.budget import PER_BYTE

_HEAD = 128
_TAG = 8
# Types of variables: plain, and packed.  Nothing else is in a file beside them.
_MATRIX, _PACKED = 14, 15
# Unpacking eight bytes needs no more of a variable than this.
_BEGINNING = 4096


def largest_content(path: Path) -> int:
    """Return what a file may unpack into [bytes]: as much as a recording may take."""
    return LEAST + PER_BYTE * path.stat().st_size


def too_large(path: Path) -> RecordingError:
    """Return the error for a file that unpacks into more."""
    return RecordingError(
        f'expected a file that unpacks into {largest_content(path) / 1e9:.3g} GB at most, '
        f'got more in {path}'
    )


def refuse_packed_bomb(path: Path) -> None:
    """Raise `RecordingError` if the variables of a file of version 5 are larger than they may be.

    What is no such file is left to its reader, which refuses it at the first element of another
    type: to step on through hundreds of megabytes of zeros by eight bytes takes a minute.
    """
    left = largest_content(path)
    with path.open('rb') as file:
        head = file.read(_HEAD)
        order = 'little' if head[126:128] == b'IM' else 'big'
        while len(tag := file.read(_TAG)) == _TAG:
            kind, size = (int.from_bytes(part, order) for part in (tag[:4], tag[4:]))  # type: ignore[arg-type]
            if kind not in (_MATRIX, _PACKED):
                return
            begin = file.tell()
            if kind == _PACKED:
                left -= _stated(file.read(min(size, _BEGINNING)), order)
            if left < 0:
                raise too_large(path)
            file.seek(begin + size)


def _stated(packed: bytes, order: str) -> int:
    """Return the size that the first element in packed bytes states; 0 if they are damaged."""
    try:
        beginning = zlib.decompressobj().decompress(packed, _TAG)
    except zlib.error:
        return 0
    return int.from_bytes(beginning[4:_TAG], order)  # type: ignore[arg-type]
