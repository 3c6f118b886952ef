# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a session, and estimates compared bit by bit."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

import rpms_ros
from rpms_ros.muscle import simulation_subject
from rpms_ros.report.figures import draw_response, draw_session
from rpms_ros.report.known_muscle import of_subject
from rpms_ros.report.recorded import compare, differences


@pytest.mark.long
@pytest.mark.parametrize('kind', ['report', 'constant_report'])
@pytest.mark.parametrize('known', [True, False])
def test_a_figure_is_drawn(tmp_path, request, kind, known):
    path, shown = tmp_path / 'session.png', request.getfixturevalue(kind)
    truth = of_subject(simulation_subject(), 20.0) if known else None
    draw_session(shown.identified, shown.recording.pulses, truth, 'A title').savefig(path)
    picture = imread(path)[..., :3]
    # four panels with lines: far from blank
    assert picture.shape[0] > 800
    assert np.mean(np.any(picture < 0.9, axis=2)) > 0.02


def test_one_bit_is_a_difference(report):
    estimates = report.identified.estimates
    assert compare(estimates[:-2], estimates).exact
    linear = estimates[3].linear.copy()
    linear[0] = np.nextafter(linear[0], 1e9)
    nudged = replace(estimates[3], linear=linear)
    spoiled = [*estimates[:3], nudged, replace(estimates[4], damping=1.0)]
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
