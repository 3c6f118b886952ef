# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Outliers and ends of the range are told from changes and from the maxima of a muscle."""

import numpy as np
import pytest

from rpms_ros.identification import IdentifiedSession, estimator_by_name, identify
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

NAMES = ('tracking', 'recursive')
# Each algorithm with its settings for people.
FOR_PEOPLE = ('batch', 'recursive', pytest.param('tracking', marks=pytest.mark.long))


def session(
    record, name, spoil=None, step=1, pulses=160, preset='paper_table_4'
) -> IdentifiedSession:
    """Eight seconds of random pulses; `spoil` changes the force, in samples of 1 kHz."""
    # the muscle answers at once, as the paper's simulated plant does
    train, forces = record(np.random.default_rng(11).uniform(size=pulses))
    force = forces.force + 0.02 * np.random.default_rng(12).standard_normal(len(forces))
    if spoil is not None:
        spoil(force)
    trace = ForceTrace(forces.stamp_ns[::step], force[::step])
    return identify(estimator_by_name(name, preset), train, trace)


@pytest.mark.parametrize('name', NAMES)
def test_one_sample_of_a_slow_sensor_is_set_aside(record, name):
    def one(force) -> None:
        force[6000] += 4.0

    found = session(record, name, one, step=10)
    assert found.last.faults['force_outlier'] == 1
    assert not found.usable[600]
    # Slow sensors have steps in their force, which are none.
    assert found.usable.sum() == len(found.usable) - 1


@pytest.mark.parametrize('name', NAMES)
def test_nothing_is_set_aside_where_nothing_is_wrong(record, name):
    for step in (1, 10):
        assert session(record, name, step=step).usable.all()


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('share', [0.5, 1.6])
@pytest.mark.parametrize('step', [1, 10])
def test_a_sudden_change_of_the_muscle_is_learnt_from(record, name, share, step):
    def change(force) -> None:
        force[5000:] *= share

    found = session(record, name, change, step)
    # The step itself may be; what follows is the muscle.
    assert found.usable[5200 // step :].all()


def early(force) -> None:
    """Before the muscle is known."""
    force[800:812] += 4.0


def effort(force) -> None:
    force[6000:6300] += 2.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 300)))


def burst(force) -> None:
    for first in range(6000, 7000, 60):
        force[first : first + 15] += 4.0


# of a burst the first ones could be outliers; then there are too many
@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(('spoil', 'most'), [(early, 0), (effort, 0), (burst, 45)])
def test_early_jumps_effort_and_bursts_are_no_outliers(record, name, spoil, most):
    assert session(record, name, spoil).last.faults.get('force_outlier', 0) <= most


def test_an_outlier_leaves_the_curve_alone(record):
    def bump(force) -> None:
        """Longer than neighbours can tell: half of those within 10 ms are part of it."""
        force[6010:6026] += 4.0

    clean = session(record, 'tracking')
    found = session(record, 'tracking', bump)
    moved = np.abs(found.last.curve_force - clean.last.curve_force).max()
    # Sixteen samples less out of 8000 move it by far less than the noise does, 0.1 %.
    assert moved < 1e-3 * clean.last.curve_force.max()


@pytest.mark.parametrize('name', FOR_PEOPLE)
def test_bumps_are_set_aside_for_people_too(record, name):
    def bumps(force) -> None:
        for first in range(10_000, 19_500, 700):
            force[first : first + 15] += 8.0

    found = session(record, name, bumps, pulses=400, preset='people').last
    assert found.faults == {'force_outlier': 14 * 15, 'samples_excluded': 14 * 15}


SECONDS = 10
REST_NS = NANOSECONDS_PER_SECOND
# Pulses and samples a second: the ripple of a train, and a sample a pulse, which shows none.
RATES = [(20, 1000), (50, 1000), (100, 100)]


def constant_train(pulses_hz, samples_hz) -> tuple[PulseTrain, ForceTrace]:
    """A second of rest and a train of one intensity, without noise."""
    intensity = np.full(pulses_hz * SECONDS, 0.7)
    pulses = PulseTrain.regular(intensity, float(pulses_hz), REST_NS)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    step_ns = NANOSECONDS_PER_SECOND // samples_hz
    stamps = np.arange(REST_NS // step_ns + samples_hz * SECONDS, dtype=np.int64) * step_ns
    return pulses, ForceTrace(stamps, muscle.force(stamps))


@pytest.mark.long
@pytest.mark.parametrize(
    ('pulses_hz', 'samples_hz', 'digits'),
    [*((*rates, 99) for rates in RATES), (50, 1000, 4), (50, 1000, 6)],
)
def test_the_maximum_of_a_train_is_no_end_of_a_range(pulses_hz, samples_hz, digits):
    pulses, forces = constant_train(pulses_hz, samples_hz)
    rounded = ForceTrace(forces.stamp_ns, np.round(forces.force, digits))
    # what makes the train look clipped: its maximum comes often, to the last digit
    assert np.count_nonzero(rounded.force == rounded.force.max()) > SECONDS * pulses_hz / 2
    last = identify(estimator_by_name('recursive'), pulses, rounded).last
    assert 'force_clipped' not in last.faults
    assert 'force_clipped' not in last.doubts


@pytest.mark.long
@pytest.mark.parametrize(('pulses_hz', 'samples_hz'), RATES)
@pytest.mark.parametrize('share', [0.6, 0.99])
def test_the_same_train_is_clipped_below_its_maximum(pulses_hz, samples_hz, share):
    pulses, forces = constant_train(pulses_hz, samples_hz)
    most = share * forces.force.max()
    cut = ForceTrace(forces.stamp_ns, np.minimum(forces.force, most))
    last = identify(estimator_by_name('recursive'), pulses, cut).last
    # the monitor waits for ten samples at the end of the range, and looks at a tenth of a second
    late = np.count_nonzero(cut.force == most) - last.faults.get('force_clipped', 0)
    assert late <= samples_hz / 5
    assert 'force_clipped' in last.doubts
