# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Jumps of a clock against pauses of the process."""

import pytest

from rpms_ros.nodes.plant_simulator import JumpDetector

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ('clock_step', 'steady_step', 'jumped'),
    [(1, 1, False), (3600, 3600, False), (3600, 0, True), (-2, 0, True), (1, 1.9, False)],
)
def test_only_steps_that_differ_are_jumps(
    clock_step: float, steady_step: float, jumped: bool
) -> None:
    detector = JumpDetector()
    assert not detector.at(10**18, 5)
    after = (10**18 + round(clock_step * SECOND), 5 + round(steady_step * SECOND))
    assert detector.at(*after) is jumped
    # once only
    assert not detector.at(after[0] + 1, after[1] + 1)
