"""Packing and unpacking of parts of a recording; of cut-off parts, as much as is there."""

from collections.abc import Callable
from pathlib import Path

from backports import zstd
from lz4 import frame as lz4  # type: ignore[import-untyped]

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_BLOCK = 1 << 20
_ERRORS = (zstd.ZstdError, RuntimeError, EOFError)

COMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    '': bytes,
    'lz4': lz4.compress,
    'zstd': zstd.compress,
}
"""How a chunk is packed, by the name that mcap has for it."""

_WHOLE: dict[str, Callable[[bytes], bytes]] = {
    '': bytes,
    'lz4': lz4.decompress,
    'zstd': zstd.decompress,
}


def unpacked(data: bytes, compression: str) -> bytes:
    """Return the content; if the data end early or are damaged, what comes before that.

    Parameters
    ----------
    data : bytes
        Packed bytes.
    compression : str
        A key of `COMPRESSORS`.
    """
    try:
        return _WHOLE[compression](data)
    except _ERRORS:
        return _beginning(data, compression)


def _beginning(data: bytes, compression: str) -> bytes:
    decompressor = lz4.LZ4FrameDecompressor() if compression == 'lz4' else zstd.ZstdDecompressor()
    parts: list[bytes] = []
    for begin in range(0, len(data), _BLOCK):
        try:
            parts.append(decompressor.decompress(data[begin : begin + _BLOCK]))
        except _ERRORS:
            break
    return b''.join(parts)


def unpack_file(packed: Path, target: Path) -> bool:
    """Write the content of a zstd file to `target`; tell whether it was complete."""
    with zstd.open(packed, 'rb') as source, target.open('wb') as sink:
        while True:
            try:
                block = source.read1(_BLOCK)
            except _ERRORS:
                return False
            if not block:
                return True
            sink.write(block)
