# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a session, and estimates compared bit by bit."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

import rpms_ros
from rpms_ros.identification import ModifiedRecursiveLM, identify
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.report.figures import draw_response, draw_session
from rpms_ros.report.known_muscle import of_subject
from rpms_ros.report.recorded import compare, differences


@cache
def session(low=0.0):
    """Eight seconds of the simulated identification; at `low` = 1 at one intensity."""
    intensity = np.random.default_rng(1).uniform(low, 1.0, 160)
    pulses = PulseTrain.regular(intensity, 20.0)
    muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(8000) * 1_000_000
    forces = ForceTrace(stamps, muscle.force(stamps))
    return identify(ModifiedRecursiveLM(), pulses, forces), pulses


@pytest.mark.long
@pytest.mark.parametrize('low', [0.0, 1.0], ids=['curve', 'one intensity'])
@pytest.mark.parametrize('known', [True, False])
def test_a_figure_is_drawn(tmp_path, low, known):
    path = tmp_path / 'session.png'
    truth = of_subject(simulation_subject(), 20.0) if known else None
    draw_session(*session(low), truth, 'A title').savefig(path)
    picture = imread(path)[..., :3]
    # four panels with lines: far from blank
    assert picture.shape[0] > 800
    assert np.mean(np.any(picture < 0.9, axis=2)) > 0.02


def nudged(estimate):
    linear = estimate.linear.copy()
    linear[0] = np.nextafter(linear[0], 1e9)
    return replace(estimate, linear=linear)


def test_one_bit_is_a_difference():
    estimates = session()[0].estimates
    assert compare(estimates[:-2], estimates).exact
    spoiled = [*estimates[:3], nudged(estimates[3]), replace(estimates[4], damping=1.0)]
    assert differences(estimates[3], spoiled[3]) == ['linear']
    agreement = compare(spoiled, estimates)
    assert (agreement.compared, agreement.missing) == (5, 0)
    assert agreement.differing == {'linear': 1, 'damping': 1}
    assert not agreement.exact
    alone = compare([replace(estimates[0], stamp_ns=7)], estimates)
    assert (alone.compared, alone.missing, alone.exact) == (0, 1, False)
    assert not compare([], estimates).exact


def test_the_figure_marks_it():
    # the functions of batch swing before the latency of 9.45 ms of the simulated muscle
    result = rpms_ros.simulate(duration=15.0, noise=0.02).identify()
    axes = Figure().subplots()
    force = result.response.force.copy()
    force[:2] = 0.15, -0.04
    draw_response([axes], result.estimates, force)
    lines = {line.get_label(): line for line in axes.get_lines()}
    solid = lines['identified']
    dotted = lines['before the muscle answers: not determined']
    assert min(np.asarray(solid.get_xdata())) == max(np.asarray(dotted.get_xdata())) > 0.0
    assert dotted.get_linestyle() == ':'
