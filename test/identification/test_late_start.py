# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stream that begins amid stimulation: the force of pulses that were not heard is not learnt."""

import numpy as np
import pytest

from rpms_ros.identification import (
    CURVE_INTENSITY,
    estimator_by_name,
    identify,
)
from rpms_ros.identification.quality.verdict import verdict_of
from rpms_ros.muscle import Contraction, Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

SUBJECT = Subject()
TRUTH = SUBJECT.steady_force(CURVE_INTENSITY, 20.0)


@pytest.fixture(name='cut', scope='module')
def cut_fixture() -> tuple[PulseTrain, ForceTrace]:
    """The part of a session from 5.02 s on."""
    generator = np.random.default_rng(5)
    pulses = PulseTrain.regular(generator.uniform(size=300), 20.0)
    muscle = Contraction(SUBJECT)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(15_000, dtype=np.int64) * 1_000_000
    force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
    begin = round(5.02 * NANOSECONDS_PER_SECOND)
    return pulses[pulses.onset_ns >= begin], ForceTrace(stamps[5020:], force[5020:])


@pytest.mark.parametrize('name', ['batch', 'recursive', 'tracking'])
def test_the_curve_is_that_of_the_muscle(cut: tuple[PulseTrain, ForceTrace], name: str) -> None:
    estimator = estimator_by_name(name)
    found = identify(estimator, *cut)
    assert np.abs(found.last.curve_force - TRUTH).max() < 0.005 * TRUTH.max()
    # up to the first pulse that is heard, and as long as those before it may act
    excluded = round(1000 * estimator.memory) + 30
    assert found.last.faults == {'samples_excluded': pytest.approx(excluded, abs=2)}
    assert found.last.doubts == ()
    assert verdict_of(found, *cut).grade == 'good'
