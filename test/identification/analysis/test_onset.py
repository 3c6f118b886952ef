# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification.analysis.latency import crossing_onset, smoothed
from rpms_ros.muscle import twitch

LAG = np.arange(-0.05, 0.4, 1e-3)


def test_the_filter_has_unit_gain_and_no_delay():
    force = np.zeros(101)
    force[50] = 1.0
    filtered = smoothed(force, 9)
    assert filtered.sum() == pytest.approx(1.0)
    # nine samples forwards and nine backwards: a triangle of 17
    assert np.allclose(filtered, filtered[::-1])
    assert np.flatnonzero(filtered > 1e-12).tolist() == list(range(42, 59))
    assert filtered[50] == pytest.approx(1 / 9)


@given(level=st.floats(-100, 100), samples=st.integers(2, 20))
def test_a_constant_stays(level, samples):
    assert np.allclose(smoothed(np.full(50, level), samples), level)


def test_the_onset_lies_where_an_artifact_ends_and_the_twitch_begins():
    force = twitch(LAG - 0.0105, 0.038) + np.where(LAG >= 0, np.exp(-LAG / 5e-4), 0.0)
    # the artifact falls until eight samples after its maximum, where the rise takes over
    assert crossing_onset(LAG, force, 9) == pytest.approx(0.0085, abs=1.5e-3)


def test_crossings_at_the_flat_top_are_no_onset():
    force = twitch(LAG - 0.0105, 0.038)
    force += 0.01 * np.random.default_rng(0).standard_normal(len(LAG))
    assert crossing_onset(LAG, force, 9) < 0.02


def test_a_force_that_only_falls_has_no_onset():
    assert np.isnan(crossing_onset(LAG, -LAG, 9))


def test_a_window_before_the_stimulus_has_no_onset():
    assert np.isnan(crossing_onset(LAG - 1.0, twitch(LAG, 0.038), 9))
