# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Counting of faults."""

import pytest

from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import FaultCounter


def test_counts_are_kept_in_one_order_whatever_came_first() -> None:
    counter = FaultCounter()
    counter.add(faults.SAMPLES_EXCLUDED, 3)
    counter.add(faults.FORCE_NOT_FINITE)
    counter.add(faults.FORCE_NOT_FINITE, 2)
    counter.add(faults.PULSE_LOST, 0)
    assert list(counter.counts().items()) == [('force_not_finite', 3), ('samples_excluded', 3)]


def test_only_known_faults_are_counted() -> None:
    with pytest.raises(KeyError, match=r'expected a fault of force_not_finite, .* got rain'):
        FaultCounter().add('rain')
