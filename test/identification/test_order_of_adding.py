# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses are added before their force, or soon after it, as docs/how-to/compose.md says."""

import numpy as np
import pytest

from rpms_ros.identification import Estimate, IdentificationStream, estimator_by_name
from rpms_ros.pulses import ForceTrace, PulseTrain

MILLISECOND = 1_000_000


def last_of(block: int, pulses_first: bool) -> Estimate:
    """Return the estimate after 4 s, read in blocks [ms]."""
    stream = IdentificationStream(estimator_by_name('recursive'))
    pulses = PulseTrain.regular(np.random.default_rng(1).random(80), 20.0)
    number = 1 + np.arange(4000, dtype=np.int64)
    for first in range(0, 4000, block):
        onset = pulses.onset_ns
        begin, end = first * MILLISECOND, (first + block) * MILLISECOND
        some = pulses[(onset >= begin) & (onset < end)]
        stamps = number[first : first + block] * MILLISECOND
        forces = ForceTrace(stamps, np.sin(1e-9 * stamps))
        if pulses_first:
            stream.add_pulses(some)
        stream.add_forces(forces)
        if not pulses_first:
            stream.add_pulses(some)
    return stream.finish()[-1]


@pytest.mark.parametrize(('block', 'pulses_first'), [(500, True), (100, True), (80, False)])
def test_every_pulse_is_in_time(block: int, pulses_first: bool) -> None:
    last = last_of(block, pulses_first)
    assert last.pulses == 80
    assert 'pulse_late' not in last.faults


def test_pulses_after_half_a_second_of_force_are_late() -> None:
    last = last_of(500, pulses_first=False)
    assert last.faults['pulse_late'] > 40
    assert last.faults['samples_excluded'] > 3000
