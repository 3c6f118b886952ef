# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor at the end of its range is told from a force that reaches the same maximum again."""

import numpy as np
import pytest

from rpms_ros.identification import estimator_by_name, identify
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

pytestmark = pytest.mark.long

SECONDS = 10
REST_NS = NANOSECONDS_PER_SECOND
# Pulses and samples a second: the ripple of a train, and a sample a pulse, which shows none.
RATES = [(20, 1000), (50, 1000), (100, 100)]


def constant_train(pulses_hz: int, samples_hz: int) -> tuple[PulseTrain, ForceTrace]:
    """A second of rest and a train of one intensity, without noise."""
    intensity = np.full(pulses_hz * SECONDS, 0.7)
    pulses = PulseTrain.regular(intensity, float(pulses_hz), REST_NS)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    step_ns = NANOSECONDS_PER_SECOND // samples_hz
    stamps = np.arange(REST_NS // step_ns + samples_hz * SECONDS, dtype=np.int64) * step_ns
    return pulses, ForceTrace(stamps, muscle.force(stamps))


@pytest.mark.parametrize(('pulses_hz', 'samples_hz'), RATES)
def test_the_maximum_of_a_train_is_no_end_of_a_range(pulses_hz: int, samples_hz: int) -> None:
    pulses, forces = constant_train(pulses_hz, samples_hz)
    # what makes the train look clipped: its maximum comes often, to the last digit
    assert np.count_nonzero(forces.force == forces.force.max()) > SECONDS * pulses_hz / 2
    last = identify(estimator_by_name('recursive'), pulses, forces).last
    assert 'force_clipped' not in last.faults
    assert 'force_clipped' not in last.doubts


@pytest.mark.parametrize('digits', [4, 6])
def test_nor_is_that_of_a_rounded_train(digits: int) -> None:
    pulses, forces = constant_train(50, 1000)
    rounded = ForceTrace(forces.stamp_ns, np.round(forces.force, digits))
    last = identify(estimator_by_name('recursive'), pulses, rounded).last
    assert 'force_clipped' not in last.faults


@pytest.mark.parametrize(('pulses_hz', 'samples_hz'), RATES)
@pytest.mark.parametrize('share', [0.6, 0.99])
def test_the_same_train_is_clipped_below_its_maximum(
    pulses_hz: int, samples_hz: int, share: float
) -> None:
    pulses, forces = constant_train(pulses_hz, samples_hz)
    most = share * forces.force.max()
    cut = ForceTrace(forces.stamp_ns, np.minimum(forces.force, most))
    last = identify(estimator_by_name('recursive'), pulses, cut).last
    # the monitor waits for ten samples at the end of the range, and looks at a tenth of a second
    late = np.count_nonzero(cut.force == most) - last.faults.get('force_clipped', 0)
    assert late <= samples_hz / 5
    assert 'force_clipped' in last.doubts
