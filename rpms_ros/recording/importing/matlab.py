# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""MATLAB files: vectors and columns of matrices, in structures too; version 5 and 7.3 (HDF5)."""

from collections.abc import Iterator
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.extra import needed
from rpms_ros.recording.importing.packed_size import largest_content
from rpms_ros.recording.importing.packed_size import refuse_packed_bomb
from rpms_ros.recording.importing.packed_size import too_large
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.signals import unit_of
from rpms_ros.recording.importing.signals import unlike
from rpms_ros.recording.importing.spike2_matlab import spike2_channels

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
            content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
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
