# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results as plain values for JSON and templates, and the JSON schema, both from dataclasses.

The fields of a dataclass are the keys of the object.  A field whose default is None is left out of
the object where it is None; a field made by `internal` is never in it.  NaN and infinity, which
JSON does not have, become null.
"""

import dataclasses
import math
import types
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

_INTERNAL, _DOC = 'internal', 'doc'
_JSON_TYPES = {bool: 'boolean', int: 'integer', float: 'number', str: 'string', type(None): 'null'}


def documented(doc: str, **options: Any) -> Any:
    """Return a dataclass field with a sentence on its meaning and unit, for the schema."""
    return dataclasses.field(metadata={_DOC: doc}, **options)


def internal(**options: Any) -> Any:
    """Return a dataclass field that does not go into JSON, such as a trace."""
    return dataclasses.field(metadata={_INTERNAL: True}, **options)


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: dicts, lists, texts, finite numbers, None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = _fields(type(value))
        items = [(field, getattr(value, field.name)) for field in fields]
        return {
            field.name: plain(item)
            for field, item in items
            if not (item is None and field.default is None)
        }
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_schema(kind: type) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of what `plain` makes of a dataclass."""
    return {'$schema': 'https://json-schema.org/draft/2020-12/schema', **_schema_of(kind)}


def _schema_of(kind: Any) -> dict[str, Any]:
    if dataclasses.is_dataclass(kind):
        return _schema_of_dataclass(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return {'anyOf': [_schema_of(one) for one in inner]}
    if kind is np.ndarray or origin is np.ndarray:
        return {'type': 'array', 'items': {'type': ['number', 'null', 'array']}}
    if origin in (list, tuple):
        return {'type': 'array', 'items': _schema_of(inner[0])}
    if origin in (dict, Mapping):
        return {'type': 'object', 'additionalProperties': _schema_of(inner[1])}
    # a float that is not finite is null
    return {'type': ['number', 'null'] if kind is float else _JSON_TYPES[kind]}


def _schema_of_dataclass(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind)
    properties = {}
    for field in _fields(kind):
        properties[field.name] = _schema_of(hints[field.name])
        if doc := field.metadata.get(_DOC):
            properties[field.name]['description'] = doc
    return {
        'type': 'object',
        'description': (kind.__doc__ or '').strip().splitlines()[0],
        'properties': properties,
        'required': [field.name for field in _fields(kind) if field.default is not None],
        'additionalProperties': False,
    }


def _fields(kind: Any) -> list['dataclasses.Field[Any]']:
    return [field for field in dataclasses.fields(kind) if not field.metadata.get(_INTERNAL)]
