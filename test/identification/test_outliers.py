# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples compared with the prediction: a few that jump are outliers, a lasting change is not."""

import numpy as np
import pytest

from rpms_ros.identification import IdentifiedSession, estimator_by_name, identify
from rpms_ros.pulses import ForceTrace

NAMES = ('tracking', 'recursive')
# Each algorithm with its settings for people.
FOR_PEOPLE = ('batch', 'recursive', 'tracking')


def session(record, name, spoil=None, step=1) -> IdentifiedSession:
    """Eight seconds of random pulses; `spoil` changes the force, in samples of 1 kHz."""
    pulses, forces = record(np.random.default_rng(11).uniform(size=160))
    force = forces.force + 0.02 * np.random.default_rng(12).standard_normal(len(forces))
    if spoil is not None:
        spoil(force)
    trace = ForceTrace(forces.stamp_ns[::step], force[::step])
    # the muscle answers at once, as the paper's simulated plant does
    return identify(estimator_by_name(name, 'paper_table_4'), pulses, trace)


def bump(force) -> None:
    """Longer than neighbours can tell: half of those within 10 ms are part of it."""
    force[6010:6026] += 4.0


@pytest.mark.parametrize('name', NAMES)
def test_one_sample_of_a_slow_sensor_is_set_aside(record, name) -> None:
    def one(force) -> None:
        force[6000] += 4.0

    found = session(record, name, one, step=10)
    assert found.last.faults['force_outlier'] == 1
    assert not found.usable[600]
    # Slow sensors have steps in their force, which are none.
    assert found.usable.sum() == len(found.usable) - 1


@pytest.mark.parametrize('name', NAMES)
def test_nothing_is_set_aside_where_nothing_is_wrong(record, name) -> None:
    for step in (1, 10):
        found = session(record, name, step=step)
        assert found.usable.all()


@pytest.mark.parametrize('name', NAMES)
def test_a_muscle_that_is_just_beginning_to_be_known_is_learnt_from(record, name) -> None:
    def first(force) -> None:
        force[800:812] += 4.0

    found = session(record, name, first)
    assert 'force_outlier' not in found.last.faults


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('share', [0.5, 1.6])
@pytest.mark.parametrize('step', [1, 10])
def test_a_sudden_change_of_the_muscle_is_learnt_from(record, name, share, step) -> None:
    def change(force) -> None:
        force[5000:] *= share

    found = session(record, name, change, step)
    # The step itself may be; what follows is the muscle.
    assert found.usable[5200 // step :].all()


@pytest.mark.parametrize('name', NAMES)
def test_voluntary_effort_is_no_outlier(record, name) -> None:
    def effort(force) -> None:
        rise = 0.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 300)))
        force[6000:6300] += 5.0 * rise

    found = session(record, name, effort)
    assert 'force_outlier' not in found.last.faults


@pytest.mark.parametrize('name', NAMES)
def test_a_burst_of_jumps_is_no_outlier(record, name) -> None:
    def burst(force) -> None:
        for first in range(6000, 7000, 60):
            force[first : first + 15] += 4.0

    found = session(record, name, burst)
    # The first ones could be; then there are too many.
    assert np.count_nonzero(~found.usable[6000:7000]) <= 45


def test_an_outlier_leaves_the_curve_alone(record) -> None:
    clean = session(record, 'tracking')
    found = session(record, 'tracking', bump)
    moved = np.abs(found.last.curve_force - clean.last.curve_force).max()
    # Sixteen samples less out of 8000 move it by far less than the noise does, 0.1 %.
    assert moved < 1e-3 * clean.last.curve_force.max()


@pytest.mark.parametrize('name', FOR_PEOPLE)
def test_bumps_are_set_aside_for_people_too(record, name) -> None:
    pulses, forces = record(np.random.default_rng(11).uniform(size=400))
    force = forces.force + 0.02 * np.random.default_rng(12).standard_normal(len(forces))
    for first in range(10_000, 19_500, 700):
        force[first : first + 15] += 8.0
    estimator = estimator_by_name(name)
    found = identify(estimator, pulses, ForceTrace(forces.stamp_ns, force)).last
    assert found.faults == {'force_outlier': 14 * 15, 'samples_excluded': 14 * 15}
