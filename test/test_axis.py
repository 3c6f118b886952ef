# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One parser of axes: what the node takes, commands and recordings take too."""

import pytest

from rpms_ros.axis import unit_vector
from rpms_ros.cli.options import add_reading_options
from rpms_ros.errors import AxisError


def test_a_direction_has_length_one_whatever_it_is_written_with() -> None:
    assert unit_vector('0,-5,0') == (0.0, -1.0, 0.0)
    assert unit_vector((3e200, 0.0, 4e200)) == pytest.approx((0.6, 0.0, 0.8), abs=1e-15)


@pytest.mark.parametrize('text', ['', 'up', '-w', '1,2', '0,0,0', 'nan,0,1', 'inf,0,0', '1,2,3,4'])
def test_what_is_no_direction_is_refused(text: str) -> None:
    with pytest.raises(AxisError, match='expected axis x, y, z, -x or three numbers'):
        unit_vector(text)


def test_a_command_takes_a_negative_axis() -> None:
    import argparse

    parser = argparse.ArgumentParser()
    add_reading_options(parser)
    axis = parser.parse_args(['--axis=-z']).axis
    assert unit_vector(axis) == (0.0, 0.0, -1.0)
