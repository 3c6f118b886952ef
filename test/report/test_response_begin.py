# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What of a fitted response is drawn as determined."""

import numpy as np
from matplotlib.figure import Figure

import rpms_ros
from rpms_ros.report.figures import draw_response


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
