# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated muscles that are none of the model's."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import Contraction, IntensityRecruitment, Subject
from rpms_ros.muscle.motor_units import MotorUnits
from rpms_ros.muscle.recruitment import OTHER_SHAPES
from rpms_ros.muscle.scenario import load_scenario

INTENSITY = np.linspace(0.0, 1.0, 101)
STAMPS = 1_000_000 * np.arange(4000, dtype=np.int64)


@pytest.mark.parametrize('shape', OTHER_SHAPES)
def test_another_recruitment_rises_from_nothing_to_the_whole(shape):
    recruitment = IntensityRecruitment(shape=shape).normalised()
    curve = recruitment(INTENSITY)
    assert curve[0] == 0.0
    assert curve[-1] == pytest.approx(1.0)
    assert (np.diff(curve) >= 0.0).all()
    model = IntensityRecruitment().normalised()(INTENSITY)
    assert np.abs(curve - model).max() > 0.02
    muscle = Contraction(Subject(recruitment=recruitment))
    np.testing.assert_allclose(muscle.steady_force(0, INTENSITY, 20.0), 9.99 * curve, rtol=2e-3)


def test_a_shape_that_nobody_knows_is_refused():
    with pytest.raises(MuscleError, match=r'expected a recruitment of arctan, boltzmann, .*, got'):
        IntensityRecruitment(shape='round')


def trained(onset_ns, intensity, blocks=1):
    muscle = MotorUnits(Subject(maximum_force=8.0))
    muscle.add_pulses(onset_ns, intensity)
    return np.concatenate([muscle.force(part) for part in np.array_split(STAMPS, blocks)])


@pytest.mark.parametrize('intensity', [0.6, 0.8, 1.0])
def test_motor_units_have_the_curve_of_the_subject(intensity):
    onset_ns = 50_000_000 * np.arange(80)
    force = trained(onset_ns, np.full(80, intensity))
    curve = float(Subject().recruitment(intensity) / Subject().recruitment(1.0))
    assert force[-1000:].mean() == pytest.approx(8.0 * curve, abs=0.05)


def test_motor_units_do_not_sum_as_linear_dynamics():
    one, other = (trained([at], [1.0]) for at in (0, 8_000_000))
    both = trained([0, 8_000_000], [1.0, 1.0])
    assert both.max() < 0.8 * (one + other).max()


def test_force_of_motor_units_hardly_depends_on_the_blocks():
    onset_ns, intensity = 50_000_000 * np.arange(80), INTENSITY[:80]
    whole = trained(onset_ns, intensity)
    np.testing.assert_allclose(trained(onset_ns, intensity, 7), whole, atol=1e-9)


def test_motor_units_that_were_to_change_are_refused():
    with pytest.raises(MuscleError, match='expected motor units that do not change'):
        MotorUnits(Subject(), settings=load_scenario('fatigue').living)
    falling = replace(Subject(), recruitment=IntensityRecruitment(0.1, 0.4, 5.0, 40.0))
    with pytest.raises(MuscleError, match='a recruitment that does not fall'):
        MotorUnits(falling)
