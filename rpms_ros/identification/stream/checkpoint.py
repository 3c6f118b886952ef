# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of a stream and its estimator in a file, to continue from there bit for bit.

The file has three parts: a line with a name and the SHA-256 of all that follows; a line of JSON
with versions, the name of the estimator and both states, their arrays replaced by numbers; and
the arrays as an uncompressed ``.npz``.  It is read without pickle, and is refused if its checksum
is wrong, its versions or settings differ, or a value has another type or shape than in a fresh
object.
"""

import hashlib
import io
import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt

import rpms_ros
from rpms_ros.errors import IdentificationError
from rpms_ros.identification.model.estimate import Estimator, RestorableEstimator
from rpms_ros.identification.stream.stream import IdentificationStream
from rpms_ros.saved_state import State

FORMAT = 'rpms-identification-state'
VERSION = 1
MOST_BYTES = 2**30
_MOST_DEPTH = 40
_ARRAY, _NUMBER = '$array', '$number'
_TEXTS = {'nan': math.nan, 'inf': math.inf, '-inf': -math.inf}


def save(path: Path | str, stream: IdentificationStream) -> None:
    """Save a stream and its estimator; an existing file is replaced atomically.

    Raises
    ------
    IdentificationError
        If the estimator or a monitor cannot be saved, `IdentificationStream.advance` has not
        been called for the newest estimates, or the file cannot be written.
    """
    estimator = _restorable(stream.estimator)
    content = _content(
        {
            'version': VERSION,
            'package': rpms_ros.__version__,
            'estimator': estimator.name,
            'estimator_state': dict(estimator.state()),
            'stream_state': stream.state(),
        }
    )
    line = f'{FORMAT} {hashlib.sha256(content).hexdigest()}\n'.encode()
    _write(Path(path), line + content)


def load(path: Path | str, stream: IdentificationStream) -> None:
    """Restore a fresh stream that has the settings of the saved one.

    If the file is refused, the stream must not be used any more.

    Raises
    ------
    IdentificationError
        If the file cannot be read, is damaged, or is of another version, estimator or settings.
    """
    estimator = _restorable(stream.estimator)
    document = read_state(path)
    for name, own in (('package', rpms_ros.__version__), ('estimator', estimator.name)):
        if document.get(name) != own:
            raise IdentificationError(
                f'expected a saved state of the {name} {own}, got {document.get(name)!r} in {path}'
            )
    try:
        stream.restore(document['stream_state'])
        estimator.restore(document['estimator_state'])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise IdentificationError(f'expected a saved state in {path}, got {error!r}') from error


def is_state(path: Path | str) -> bool:
    """Return whether a file begins as saved states do.

    Raises
    ------
    IdentificationError
        If it cannot be read.
    """
    return _read(Path(path)).startswith(FORMAT.encode())


def read_state(path: Path | str) -> State:
    """Return the content of a file after a check of its checksum and format version.

    Raises
    ------
    IdentificationError
        If the file cannot be read, is damaged or of another version.
    """
    content = _read(Path(path))
    line, _, content = content.partition(b'\n')
    wanted = f'{FORMAT} {hashlib.sha256(content).hexdigest()}'.encode()
    if not line.startswith(FORMAT.encode()):
        raise IdentificationError(f'expected a state that was saved, got {path}')
    if line != wanted:
        raise IdentificationError(f'expected a saved state that is whole, got {path}: wrong sum')
    text, _, packed = content.partition(b'\n')
    try:
        document = json.loads(text)
        if document.get('version') != VERSION:
            raise IdentificationError(
                f'expected a saved state of version {VERSION}, got {document.get("version")!r}'
            )
        restored: State = _unpacked(document, _arrays(packed), 0)
    except (
        AttributeError,
        BadZipFile,
        IndexError,
        KeyError,
        MemoryError,
        OSError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise IdentificationError(f'expected a saved state in {path}, got {error!r}') from error
    return restored


def _restorable(estimator: Estimator) -> RestorableEstimator:
    if not isinstance(estimator, RestorableEstimator):
        raise IdentificationError(
            f'expected an estimator with state() and restore(), got {estimator.name}'
        )
    return estimator


def _content(document: State) -> bytes:
    arrays: list[npt.NDArray[Any]] = []
    text = json.dumps(_packed(document, arrays), allow_nan=False, separators=(',', ':'))
    buffer = io.BytesIO()
    with ZipFile(buffer, 'w', ZIP_STORED) as archive:
        for place, array in enumerate(arrays):
            with archive.open(f'a{place}.npy', 'w') as file:
                np.lib.format.write_array(file, array, version=(1, 0), allow_pickle=False)
    return text.encode() + b'\n' + buffer.getvalue()


def _packed(value: Any, arrays: list[npt.NDArray[Any]]) -> Any:
    """Return a value for JSON, its arrays appended to `arrays`."""
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise IdentificationError('expected arrays of numbers in a state, got objects')
        arrays.append(value)
        return {_ARRAY: len(arrays) - 1}
    if isinstance(value, float) and not math.isfinite(value):
        return {_NUMBER: str(value)}
    if isinstance(value, Mapping):
        return {str(name): _packed(item, arrays) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_packed(item, arrays) for item in value]
    return value


def _unpacked(value: Any, arrays: list[npt.NDArray[Any]], depth: int) -> Any:
    if depth > _MOST_DEPTH:
        raise ValueError(f'expected a depth of at most {_MOST_DEPTH}, got more')
    if isinstance(value, dict):
        if set(value) == {_ARRAY}:
            return arrays[value[_ARRAY]]
        if set(value) == {_NUMBER}:
            return _TEXTS[value[_NUMBER]]
        return {name: _unpacked(item, arrays, depth + 1) for name, item in value.items()}
    if isinstance(value, list):
        return [_unpacked(item, arrays, depth + 1) for item in value]
    return value


def _arrays(packed: bytes) -> list[npt.NDArray[Any]]:
    """Return the arrays of an uncompressed ``.npz``; no larger than the file itself."""
    with ZipFile(io.BytesIO(packed)) as archive:
        members = archive.infolist()
        stored = all(member.compress_type == ZIP_STORED for member in members)
        if not stored or sum(member.file_size for member in members) > len(packed):
            raise ValueError('expected arrays as they are, got packed ones')
        for member in members:
            with archive.open(member) as file:
                _check_header(file, member.file_size)
    with np.load(io.BytesIO(packed), allow_pickle=False) as loaded:
        return [loaded[f'a{place}'] for place in range(len(members))]


def _check_header(file: Any, size: int) -> None:
    """Raise `ValueError` if the header of an array announces more bytes than the file holds."""
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError('expected arrays of format 1.0, got another')
    shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize > size or min(shape, default=0) < 0:
        raise ValueError(f'expected an array of {size} bytes, got shape {shape}')


def _read(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise IdentificationError(f'expected a file with a saved state, got {path}')
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise IdentificationError(
                f'expected a saved state of at most {MOST_BYTES} bytes, got {size}'
            )
        return path.read_bytes()
    except OSError as error:
        raise IdentificationError(f'expected to read {path}, got {error}') from error


def _write(path: Path, content: bytes) -> None:
    """Write a temporary file in the same folder, then rename it."""
    try:
        descriptor, beside = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
        try:
            with os.fdopen(descriptor, 'wb') as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(beside).replace(path)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise IdentificationError(f'expected to write {path}, got {error}') from error
