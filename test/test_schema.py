# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Plain values and the JSON schema of dataclasses."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from rpms_ros.pulses import FloatArray
from rpms_ros.schema import documented, internal, plain

SCHEMA = Path(__file__).parents[1] / 'tools' / 'json_schema.py'


@dataclass(frozen=True)
class Inner:
    """Inner object."""

    name: str


@dataclass(frozen=True)
class Outer:
    """Outer object.

    More about it.
    """

    count: int
    share: float = documented('a share')
    values: FloatArray
    known: Inner | None
    counts: dict[str, int]
    names: tuple[str, ...]
    note: str | None = documented('only if there is one', default=None)
    trace: FloatArray | None = internal(default=None)


VALUE = Outer(
    2, 0.5, np.array([1.0, np.nan]), Inner('x'), {'a': 1}, ('b',), 'note', trace=np.ones(3)
)


def test_a_dataclass_is_an_object_of_what_json_holds():
    assert plain(VALUE) == {
        'count': 2,
        'share': 0.5,
        'values': [1.0, None],
        'known': {'name': 'x'},
        'counts': {'a': 1},
        'names': ['b'],
        'note': 'note',
    }
    # required fields are null, optional ones are left out
    bare = plain(replace(VALUE, known=None, note=None))
    assert bare['known'] is None
    assert 'note' not in bare


def test_numbers_of_numpy_and_keys_are_plain():
    given = {'a': np.array([1.0, np.nan]), 2: (np.float64(3.0), None), 'c': float('inf')}
    assert plain(given) == {'a': [1.0, None], '2': [3.0, None], 'c': None}


def test_what_is_plain_is_valid_and_what_differs_is_not(module_at):
    schema = module_at(SCHEMA).json_schema(Outer)
    jsonschema.Draft202012Validator.check_schema(schema)
    document = json.loads(json.dumps(plain(VALUE), allow_nan=False))
    jsonschema.validate(document, schema)
    jsonschema.validate(plain(replace(VALUE, known=None, share=float('nan'))), schema)
    for spoiled in ({'count': 'two'}, {'colour': 'red'}, {'known': {}}, {'names': [1]}):
        with pytest.raises(jsonschema.ValidationError, match=r'.'):
            jsonschema.validate({**document, **spoiled}, schema)
    with pytest.raises(jsonschema.ValidationError, match="'values' is a required property"):
        jsonschema.validate({k: v for k, v in document.items() if k != 'values'}, schema)
