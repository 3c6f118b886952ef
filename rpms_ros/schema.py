# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results as plain values for JSON and templates, made of dataclasses.

The fields of a dataclass are the keys of the object.  A field whose default is None is left out of
the object where it is None; a field made by `internal` is never in it.  NaN and infinity, which
JSON does not have, become null.  `tools/json_schema.py` writes the JSON schema.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

INTERNAL = {'internal': True}
"""Metadata of a field that does not go into JSON, such as a trace."""


def documented(doc: str, **options: Any) -> Any:
    """Return a dataclass field with a sentence on its meaning and unit, for the schema."""
    return dataclasses.field(metadata={'doc': doc}, **options)


def internal(**options: Any) -> Any:
    """Return a dataclass field that does not go into JSON, such as a trace."""
    return dataclasses.field(metadata=INTERNAL, **options)


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: dicts, lists, texts, finite numbers, None."""
    if dataclasses.is_dataclass(value):
        fields = (one for one in dataclasses.fields(value) if 'internal' not in one.metadata)
        items = ((field, getattr(value, field.name)) for field in fields)
        given = (pair for pair in items if pair[1] is not None or pair[0].default is not None)
        return {field.name: plain(item) for field, item in given}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
