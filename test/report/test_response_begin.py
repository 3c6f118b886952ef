# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What of a fitted response is drawn as determined."""

import numpy as np
from matplotlib.figure import Figure

import rpms_ros
from rpms_ros.muscle import twitch
from rpms_ros.report.figures import begin_of_response, draw_response

TIME = np.arange(80) * 0.005


def test_a_response_that_is_zero_before_it_rises_is_determined() -> None:
    assert begin_of_response(np.asarray(twitch(TIME, 0.04, 3))) == 0
    assert begin_of_response(np.asarray(twitch(TIME - 0.012, 0.04, 3))) == 0
    assert begin_of_response(np.zeros(80)) == 0
    assert begin_of_response(-np.asarray(twitch(TIME, 0.04, 3))) == 0


def test_a_swing_before_the_rise_is_not() -> None:
    force = np.asarray(twitch(TIME, 0.04, 3)).copy()
    force[:3] = 0.15, -0.04, -0.03
    assert begin_of_response(force) == 2
    # after the peak a force may fall below its baseline
    force[70:] = -0.1
    assert begin_of_response(force) == 2


def test_the_figure_marks_it() -> None:
    # the functions of batch swing before the latency of 9.45 ms of the simulated muscle
    result = rpms_ros.simulate(duration=15.0, noise=0.02).identify()
    axes = Figure().subplots()
    force = result.response.force.copy()
    force[:2] = 0.15, -0.04
    draw_response(axes, result.estimates, force)
    lines = {line.get_label(): line for line in axes.get_lines()}
    solid = lines['identified']
    dotted = lines['before the muscle answers: not determined']
    assert min(np.asarray(solid.get_xdata())) == max(np.asarray(dotted.get_xdata())) > 0.0
    assert dotted.get_linestyle() == ':'
