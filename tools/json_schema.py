# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The JSON schema of what `rpms_ros.schema.plain` makes of a dataclass."""

import dataclasses
import types
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

_JSON_TYPES = {bool: 'boolean', int: 'integer', float: 'number', str: 'string', type(None): 'null'}


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
    fields = [one for one in dataclasses.fields(kind) if 'internal' not in one.metadata]
    properties = {}
    for field in fields:
        properties[field.name] = _schema_of(hints[field.name])
        if doc := field.metadata.get('doc'):
            properties[field.name]['description'] = doc
    return {
        'type': 'object',
        'description': (kind.__doc__ or '').strip().splitlines()[0],
        'properties': properties,
        'required': [field.name for field in fields if field.default is not None],
        'additionalProperties': False,
    }
