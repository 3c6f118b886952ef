# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Unpacking of parts of a recording, up to a limit; of cut-off parts, as much as is there.

CRC-32 of bytes, as mcap and zlib have it, with the instructions of the processor if possible.

isal computes it ten times faster than zlib, which makes checking a recording cost next to nothing
of reading it.  Where it is not installed zlib gives the same values.
"""

import sys
import zlib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from lz4 import frame as lz4  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_BLOCK = 1 << 20
# Of a damaged frame, so much at once: no more than this is lost before the damage.
_STEP = 1 << 16
_ERRORS = (zstd.ZstdError, RuntimeError, EOFError, MemoryError)

DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    'lz4': lz4.LZ4FrameDecompressor,
    'zstd': zstd.ZstdDecompressor,
}
"""What unpacks a chunk, by the name that mcap has for its compression."""


def unpacked(data: bytes, compression: str, limit: int) -> bytes:
    """Return the content, at most `limit` bytes; of damaged data what comes before the damage.

    Parameters
    ----------
    data : bytes
        Packed bytes, of one frame or several.
    compression : str
        A key of `DECOMPRESSORS`.
    limit : int
        Never more than this is made, whatever the data say [bytes].
    """
    parts: list[bytes] = []
    left = limit
    while data and left > 0:
        decompressor = DECOMPRESSORS[compression]()
        try:
            part = decompressor.decompress(data, max_length=left)
        except _ERRORS:
            parts.append(_beginning(data, compression, left))
            break
        parts.append(part)
        left -= len(part)
        if not decompressor.eof:
            break
        data = decompressor.unused_data or b''
    return parts[0] if len(parts) == 1 else b''.join(parts)


def _beginning(data: bytes, compression: str, limit: int) -> bytes:
    decompressor = DECOMPRESSORS[compression]()
    parts: list[bytes] = []
    left = limit
    for begin in range(0, len(data), _STEP):
        try:
            part = decompressor.decompress(data[begin : begin + _STEP], max_length=left)
        except _ERRORS:
            break
        parts.append(part)
        left -= len(part)
        if decompressor.eof or left <= 0:
            break
    return b''.join(parts)


def unpack_file(packed: Path, target: Path, limit: int) -> bool | None:
    """Write the content of a zstd file to `target`.

    Returns
    -------
    bool or None
        Whether the file was complete; None if its content is larger than `limit` [bytes], in
        which case no more than that was written.
    """
    written = 0
    with zstd.open(packed, 'rb') as source, target.open('wb') as sink:
        while True:
            try:
                block = source.read1(_BLOCK)
            except _ERRORS:
                return False
            if not block:
                return True
            written += len(block)
            if written > limit:
                return None
            sink.write(block)


Crc32 = Callable[[bytes | memoryview, int], int]


def _quickest() -> Crc32:
    """Return isal's function if it is installed, else zlib's."""
    try:
        return cast(Crc32, import_module('isal.isal_zlib').crc32)
    except (ImportError, AttributeError):
        return zlib.crc32


_crc32 = _quickest()


def crc32(data: bytes | memoryview, before: int = 0) -> int:
    """Return the CRC-32 of `data`, which follows bytes whose CRC-32 is `before`."""
    return _crc32(data, before)
