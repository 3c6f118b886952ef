# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor that filters its noise: tracking says that it does not know how wrong it is."""

import pytest
from scipy.signal import butter, lfilter

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.quality.doubts import REASON, RESIDUALS_ALIKE
from rpms_ros.pulses import ForceTrace, PulseTrain

pytestmark = pytest.mark.long


def last(what, force):
    """Return the last estimate of `tracking`."""
    pulses = PulseTrain.regular(what.intensity, 20.0, 1_000)
    forces = ForceTrace(what.stamp_ns, force)
    return identify(
        estimator_by_name('tracking'), pulses, forces, StreamSettings(estimate_period=5.0)
    ).last


def test_noise_that_the_sensor_filters_is_said(living_sessions) -> None:
    what = living_sessions.session('steady', 'random', 1, 18.0)
    estimate = last(what, lfilter(*butter(2, 20.0, fs=1000.0), what.force))
    assert RESIDUALS_ALIKE in estimate.doubts
    assert REASON[RESIDUALS_ALIKE] in estimate.reasons
    # why: the band does not hold the curve
    away = abs(estimate.curve_force - what.curve[-1])
    assert (away > estimate.curve_upper - estimate.curve_force).mean() > 0.2


def test_noise_of_an_ordinary_sensor_is_not_doubted(living_sessions) -> None:
    what = living_sessions.session('bursts', 'random', 1, 18.0)
    assert RESIDUALS_ALIKE not in last(what, what.force).doubts
