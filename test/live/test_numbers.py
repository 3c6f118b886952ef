# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of anybody are valid JSON, many at once as one by one."""

import json

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from rpms_ros.live.heard import number, numbers

LARGEST = 1.7976931348623157e308


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True)))
def test_many_numbers_are_those_of_each(values):
    found = numbers(np.array(values))
    assert len(found) == len(values)
    for value, many in zip(values, found, strict=True):
        one = number(value)
        assert (one is None) == (many is None)
        # halves are rounded to either side, so they may differ by one in the fifth digit; below
        # 1e-295 there is no power of ten for all digits
        if one is not None:
            assert many == pytest.approx(one, rel=1.01e-4, abs=1e-295)
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize('value', [LARGEST, -LARGEST, float('nan'), float('inf')])
def test_what_json_cannot_say_is_nothing(value):
    # the largest double, written with five digits, is read as infinite
    assert number(value) is None
    assert numbers([value, 1.0]) == [None, 1.0]


def test_five_digits_make_a_short_text():
    values = np.array([0.1 + 0.2, 1234567.8, -9.87654321e-7, 100000.4, 0.0])
    assert json.dumps(numbers(values)) == '[0.3, 1234600.0, -9.8765e-07, 100000.0, 0.0]'
    assert numbers([number(value) for value in values]) == numbers(values)
