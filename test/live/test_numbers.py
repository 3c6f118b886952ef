# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of anybody are valid JSON, many at once as one by one."""

import json

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from rpms_ros.live.heard import number, numbers


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
