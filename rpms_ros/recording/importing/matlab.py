# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""MATLAB files: vectors and columns of matrices, in structures too; version 5 and 7.3 (HDF5)."""

import zlib
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.export.reading import by_scipy
from rpms_ros.recording.importing.signals import (
    Events,
    Signal,
    SignalFile,
    as_samples,
    needed,
    unit_of,
    unlike,
)
from rpms_ros.recording.rosbag.records import LEAST, PER_BYTE

_HDF5 = b'\x89HDF'
_RATES = ('fs', 'samplerate', 'samplingrate', 'sampling_rate', 'sample_rate', 'rate', 'srate')
_MOST_COLUMNS = 64


def read_matlab(path: Path) -> SignalFile:
    """Return every vector of numbers in the file, named by its place; of Spike2 its channels.

    Raises
    ------
    RecordingError
        If the file is damaged, or of version 7.3 and h5py is not installed.
    """
    with path.open('rb') as file:
        head = file.read(1024)
    hdf5 = _HDF5 in head
    try:
        if not hdf5:
            refuse_packed_bomb(path)
            content = by_scipy('loadmat', path, squeeze_me=True, struct_as_record=False)
            if (channels := spike2_channels(path, content)) is not None:
                return channels
        items = list(_from_hdf5(path) if hdf5 else _from_version_5(content))
    except RecordingError:
        raise
    # scipy and h5py raise whatever the damage leads to
    except Exception as error:
        raise RecordingError(f'expected a MATLAB file at {path}, got {error}') from error
    vectors = [(name, values) for name, array in items for name, values in _columns(name, array)]
    rates = [
        float(array.ravel()[0])
        for name, array in items
        if name.rpartition('.')[2].lower() in _RATES and array.size == 1
    ]
    names = unlike([name for name, _ in vectors])
    return SignalFile(
        path,
        f'MATLAB {"7.3" if hdf5 else "5"}',
        tuple(
            Signal(name, values, unit_of(name))
            for name, (_, values) in zip(names, vectors, strict=True)
        ),
        sampling_rate_hz=rates[0] if rates and rates[0] > 0.0 else None,
    )


def _columns(name: str, array: 'np.ndarray[Any, Any]') -> Iterator[tuple[str, Any]]:
    values = np.squeeze(array)
    if values.ndim == 1 and len(values) > 1:
        yield name, np.ascontiguousarray(values, dtype=np.float64)
    elif values.ndim == 2:
        tall = values if values.shape[0] >= values.shape[1] else values.T
        if tall.shape[1] <= _MOST_COLUMNS:
            for index, column in enumerate(tall.T):
                yield f'{name} {index + 1}', np.ascontiguousarray(column, dtype=np.float64)


def _from_version_5(content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if not name.startswith('__'):
            yield from _walked(name, value)


def _walked(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    for field in getattr(value, '_fieldnames', ()):
        yield from _walked(f'{name}.{field}', getattr(value, field))
    array = np.asarray(value)
    if array.dtype.kind in 'fiub':
        yield name, array


def _from_hdf5(path: Path) -> Iterator[tuple[str, Any]]:
    h5py = needed(import_module, 'h5py', f'a MATLAB file of version 7.3 ({path})')
    found: list[tuple[str, Any]] = []
    left = largest_content(path)

    def visit(name: str, item: Any) -> None:
        nonlocal left
        if isinstance(item, h5py.Dataset) and item.dtype.kind in 'fiub' and '#' not in name:
            left -= item.size * item.dtype.itemsize
            if left < 0:
                raise too_large(path)
            found.append((name.replace('/', '.'), item[()]))

    with h5py.File(path, 'r') as file:
        file.visititems(visit)
    yield from found


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


_WAVEFORM = {'interval', 'start', 'values'}
_EVENTS = {'title', 'length', 'times'}


def spike2_channels(path: Path, content: Mapping[str, Any]) -> SignalFile | None:
    """Return the channels of a MATLAB file that Spike2 has written; None if it is another one.

    Channels that are neither waveforms nor events, such as wavemarks, are left out.

    Parameters
    ----------
    path : Path
        The file.
    content : mapping
        Its variables, structures as objects with ``_fieldnames``.

    Raises
    ------
    RecordingError
        If the interval of a waveform is not above zero.
    """
    channels = {name: set(getattr(value, '_fieldnames', ())) for name, value in content.items()}
    if not any(found >= _WAVEFORM for found in channels.values()):
        return None
    signals: list[Signal] = []
    events: list[Events] = []
    for name, found in channels.items():
        channel = content[name]
        title = _text(channel, 'title') or name
        if found >= _WAVEFORM:
            if (values := as_samples(channel.values)) is not None:
                signals.append(_waveform(path, title, channel, values))
        elif found >= _EVENTS and 'values' not in found:
            times = np.atleast_1d(np.asarray(channel.times, dtype=np.float64)).ravel()
            events.append(Events(title, times))
    names = unlike([one.name for one in signals] + [one.name for one in events])
    count = len(signals)
    return SignalFile(
        path,
        'Spike2 MATLAB',
        tuple(
            Signal(name, one.values, one.unit, one.time)
            for name, one in zip(names[:count], signals, strict=True)
        ),
        tuple(Events(name, one.time) for name, one in zip(names[count:], events, strict=True)),
    )


def _waveform(path: Path, title: str, channel: Any, values: Any) -> Signal:
    start, interval = float(channel.start), float(channel.interval)
    if not (np.isfinite(start) and 0.0 < interval < np.inf):
        raise RecordingError(
            f'expected a waveform with an interval above 0 s in {path}, got {interval} of '
            f'{title!r}'
        )
    time = start + interval * np.arange(len(values), dtype=np.float64)
    return Signal(title, values, _text(channel, 'units'), time)


def _text(channel: Any, name: str) -> str:
    """Return a text of a channel; MATLAB's empty one is an empty array."""
    value = getattr(channel, name, '')
    return value if isinstance(value, str) else ''
