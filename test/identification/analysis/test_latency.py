# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.identification.analysis.latency import crossing_latency, latency_table
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.muscle import twitch


def test_rows_are_intensities_with_mean_spread_and_number():
    latency = np.array([9.0, 11.0, 8.0, np.nan, 10.0]) * 1e-3
    intensity = np.array([1.0, 1.0, 0.5, 0.5, np.nan])
    table = latency_table('zero crossing', 'stamp', latency, intensity, {'saturated': 2})
    half, full, unknown = table.rows
    assert (half.intensity, half.count, half.mean) == (0.5, 1, pytest.approx(8e-3))
    assert np.isnan(half.spread)
    assert (full.count, full.mean) == (2, pytest.approx(10e-3))
    assert full.spread == pytest.approx(np.sqrt(2) * 1e-3)
    assert np.isnan(unknown.intensity)
    assert table.count == 4
    assert table.rejected == {'saturated': 2, 'no zero crossing before the steepest rise': 1}


def test_no_latency_at_all_is_no_number():
    table = latency_table('joint fit', 'stamp', np.array([]), np.array([]), {})
    assert table.rows == ()
    assert np.isnan(table.mean)


def response(lag, artifact=np.nan):
    force = twitch(lag - 0.0105, 0.038) + np.where(lag >= 0, np.exp(-lag / 5e-4), 0.0)
    usable = np.ones(len(lag), dtype=np.bool_)
    return Response(np.zeros(1), lag, force, usable, 1.0, artifact, 0)


def test_the_latency_counts_from_the_artifact_if_there_is_one():
    lag = np.arange(-50, 400) * 1e-3
    from_stamp = crossing_latency(response(lag), 9e-3, 1e-3, True)
    from_artifact = crossing_latency(response(lag, artifact=2e-3), 9e-3, 1e-3, True)
    assert from_artifact == pytest.approx(from_stamp - 2e-3)
    assert crossing_latency(response(lag, 2e-3), 9e-3, 1e-3, False) == from_stamp


def test_samples_that_are_not_even_give_nearly_the_same_latency():
    even = np.arange(-50, 400) * 1e-3
    jittered = even + np.random.default_rng(0).uniform(-2e-4, 2e-4, len(even))
    expected = crossing_latency(response(even), 9e-3, 1e-3, False)
    # linear interpolation moves the end of the artifact by the jitter at most
    assert crossing_latency(response(jittered), 9e-3, 1e-3, False) == pytest.approx(
        expected, abs=5e-4
    )
