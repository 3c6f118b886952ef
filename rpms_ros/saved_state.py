# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of an object as plain values and in a file, to continue from there bit for bit.

A class that derives from `Restorable` declares its state by annotations in its body: numbers,
texts, arrays, containers and records of them, or further `Restorable` objects.  Its other
attributes follow from how it was made.  A file may hold anything, so a value whose type is not
that of the annotation is refused.

A file has three parts: a line with a name and the SHA-256 of all that follows; a line of JSON,
in which arrays are replaced by type, shape and place; and the bytes of the arrays.
"""

import dataclasses
import hashlib
import json
import math
import os
import tempfile
import types
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from rpms_ros.errors import IdentificationError

FORMAT = 'rpms-identification-state'
VERSION = 3
MOST_BYTES = 2**30
_MOST_DEPTH = 40
_ARRAY, _NUMBER = '$array', '$number'

State = dict[str, Any]
"""Names and plain values: None, bool, int, float, str, ndarray, lists and states of them."""


_SETTINGS = 'settings'


class Restorable:
    """Has a state that can be saved and restored; see the module."""

    def state(self) -> State:
        """Return a copy of the whole state.

        Raises
        ------
        IdentificationError
            If a value cannot be saved.
        """
        return {name: plain(getattr(self, name)) for name in remembered(type(self))}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` of an object with the same settings has returned.

        Raises
        ------
        IdentificationError
            If it is not such a state; then the object must not be used any more.
        """
        hints = remembered(type(self))
        where = type(self).__name__
        expect(isinstance(state, Mapping) and set(state) == set(hints), where, 'its names')
        for name, hint in hints.items():
            own = getattr(self, name)
            if isinstance(own, Restorable):
                expect(isinstance(state[name], Mapping), f'{where}.{name}', 'a state')
                own.restore(state[name])
                continue
            if own is None and any(issubclass(kind, Restorable) for kind in _kinds(hint)):
                expect(state[name] is None, f'{where}.{name}', 'nothing')
                continue
            value = typed(hint, state[name], f'{where}.{name}')
            if isinstance(own, deque):
                value = deque(value, maxlen=own.maxlen)
            setattr(self, name, value)
        self._check_restored()

    def _check_restored(self) -> None:
        """Raise `IdentificationError` if values that were restored do not fit together."""


class RestorableWithSettings(Restorable, ABC):
    """Has settings; a state that was saved with others is refused."""

    @abstractmethod
    def described_settings(self) -> State:
        """Return all settings by name, as `described` does."""

    def state(self) -> State:
        """Return the whole state and the settings; see `Restorable.state`."""
        return {**super().state(), _SETTINGS: self.described_settings()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what was saved with the same settings; see `Restorable.restore`."""
        refuse_other_settings(state.get(_SETTINGS), self.described_settings())
        super().restore({name: value for name, value in state.items() if name != _SETTINGS})


def described(settings: Any) -> State:
    """Return the values of a dataclass by dotted names."""
    found: State = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            inner = described(value)
            found |= {f'{field.name}.{name}': item for name, item in inner.items()}
        else:
            found[field.name] = plain(list(value) if isinstance(value, tuple) else value)
    return found


def refuse_other_settings(saved: Any, own: State) -> None:
    """Raise `IdentificationError` with the first difference if settings differ."""
    expect(isinstance(saved, Mapping), 'state', 'settings')
    for name in [*own, *(name for name in saved if name not in own)]:
        here, there = own.get(name, 'nothing'), saved.get(name, 'nothing')
        if here != there or type(here) is not type(there):
            raise IdentificationError(
                f'expected a saved state with {name} {here}, as it is set here, got {there}'
            )


def expect(fits: bool, where: str, what: str) -> None:
    """Raise `IdentificationError` unless a saved value fits."""
    if not fits:
        raise IdentificationError(f'expected {what} in the saved {where}, got something else')


def remembered(kind: type) -> Mapping[str, Any]:
    """Return the annotations of a class by name, without those of class variables."""
    hints = get_type_hints(kind)
    return {name: hint for name, hint in hints.items() if get_origin(hint) is not ClassVar}


def _kinds(hint: Any) -> list[type]:
    return [kind for kind in get_args(hint) if isinstance(kind, type)]


def plain(value: Any) -> Any:
    """Return a value as a `State` can hold it."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, Restorable):
        return value.state()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, '_fields'):
        return {name: plain(item) for name, item in zip(value._fields, value, strict=True)}
    if isinstance(value, Mapping):
        return [[plain(key), plain(item)] for key, item in value.items()]
    if isinstance(value, set | frozenset):
        return sorted(plain(item) for item in value)
    if isinstance(value, list | tuple | deque):
        return [plain(item) for item in value]
    raise IdentificationError(f'expected a value that can be saved, got {type(value).__name__}')


def typed(hint: Any, value: Any, where: str) -> Any:
    """Return a plain value converted to the type of an annotation.

    Raises
    ------
    IdentificationError
        If it does not fit.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        kinds = [argument for argument in arguments if argument is not type(None)]
        if value is None and len(kinds) < len(arguments):
            return None
        return typed(kinds[0], value, where)
    if origin is np.ndarray:
        wanted = np.dtype(get_args(arguments[1])[0])
        fits = isinstance(value, np.ndarray) and value.dtype == wanted
        expect(fits, where, f'an array of {wanted}')
        return value.copy()
    if origin in (list, deque, set, tuple, dict):
        return _container(origin, arguments, value, where)
    if dataclasses.is_dataclass(hint) or hasattr(hint, '_fields'):
        return _record(hint, value, where)
    # To Python a bool is an int; in JSON a whole float is written as an int.
    accepted = (int, float) if hint is float else (hint,)
    fits = isinstance(value, accepted) and (hint is bool or not isinstance(value, bool))
    expect(fits, where, f'a value of the type {hint.__name__}')
    return float(value) if hint is float else value


def _container(origin: Any, arguments: tuple[Any, ...], value: Any, where: str) -> Any:
    expect(isinstance(value, list), where, 'a list')
    if origin is dict:
        pairs = [_container(tuple, arguments, pair, where) for pair in value]
        return dict(pairs)
    if origin is tuple and not (len(arguments) == 2 and arguments[1] is Ellipsis):
        expect(len(value) == len(arguments), where, f'{len(arguments)} values')
        return tuple(typed(kind, item, where) for kind, item in zip(arguments, value, strict=True))
    return origin(typed(arguments[0], item, where) for item in value)


def _record(kind: Any, value: Any, where: str) -> Any:
    hints = get_type_hints(kind)
    names = getattr(kind, '_fields', None) or [one.name for one in dataclasses.fields(kind)]
    expect(isinstance(value, Mapping) and set(value) == set(names), where, kind.__name__)
    fields = {name: typed(hints[name], value[name], f'{where}.{name}') for name in names}
    try:
        return kind(**fields)
    except ValueError as error:
        raise IdentificationError(f'saved {where}: {error}') from error


def write_state(path: Path | str, document: State) -> None:
    """Write a state to a file; an existing one is replaced atomically.

    Raises
    ------
    IdentificationError
        If the file cannot be written.
    """
    arrays: list[bytes] = []
    document = _packed({'version': VERSION, **document}, arrays)
    text = json.dumps(document, allow_nan=False, separators=(',', ':'))
    content = b''.join((text.encode(), b'\n', *arrays))
    line = f'{FORMAT} {hashlib.sha256(content).hexdigest()}\n'.encode()
    _write(Path(path), line + content)


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
    line, _, content = _read(Path(path)).partition(b'\n')
    wanted = f'{FORMAT} {hashlib.sha256(content).hexdigest()}'.encode()
    if not line.startswith(FORMAT.encode()):
        raise IdentificationError(f'expected a state that was saved, got {path}')
    if line != wanted:
        raise IdentificationError(f'expected a saved state that is whole, got {path}: wrong sum')
    text, _, arrays = content.partition(b'\n')
    try:
        document = json.loads(text)
        if document.get('version') != VERSION:
            raise IdentificationError(
                f'expected a saved state of version {VERSION}, got {document.get("version")!r}'
            )
        restored: State = _unpacked(document, arrays, 0)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise IdentificationError(f'expected a saved state in {path}, got {error!r}') from error
    return restored


def _packed(value: Any, arrays: list[bytes]) -> Any:
    """Return a value for JSON, the bytes of its arrays appended to `arrays`."""
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise IdentificationError('expected arrays of numbers in a state, got objects')
        place = sum(len(one) for one in arrays)
        arrays.append(value.tobytes())
        return {_ARRAY: [value.dtype.str, list(value.shape), place]}
    if isinstance(value, float) and not math.isfinite(value):
        return {_NUMBER: str(value)}
    if isinstance(value, Mapping):
        return {str(name): _packed(item, arrays) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_packed(item, arrays) for item in value]
    return value


def _unpacked(value: Any, arrays: bytes, depth: int) -> Any:
    if depth > _MOST_DEPTH:
        raise ValueError(f'expected a depth of at most {_MOST_DEPTH}, got more')
    if isinstance(value, dict):
        if set(value) == {_ARRAY}:
            kind, shape, place = value[_ARRAY]
            dtype = np.dtype(kind)
            if dtype.hasobject or min(shape, default=0) < 0:
                raise ValueError(f'expected an array of numbers, got {kind} {shape}')
            # no larger than the file: a shape of more than is there is refused
            count = math.prod(shape)
            found = np.frombuffer(arrays[place : place + count * dtype.itemsize], dtype)
            return found.reshape(shape)
        if set(value) == {_NUMBER}:
            return float(value[_NUMBER])
        return {name: _unpacked(item, arrays, depth + 1) for name, item in value.items()}
    if isinstance(value, list):
        return [_unpacked(item, arrays, depth + 1) for item in value]
    return value


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
