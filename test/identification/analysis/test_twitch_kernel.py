# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.identification.analysis.twitch_kernel import coarse_start, linear_parts, shared_fit
from rpms_ros.identification.model.physiology import twitch_row
from rpms_ros.muscle import twitch

LAG = np.arange(-0.05, 0.5, 1e-3)


def value(lag, constant, order):
    row = np.zeros(4)
    twitch_row(lag, constant, order, row)
    return row


@given(
    lag=st.floats(1e-3, 0.4),
    constant=st.floats(5e-3, 0.1),
    order=st.floats(1.5, 6.0),
)
@settings(deadline=None)
def test_derivatives_of_the_shape_are_the_central_differences(lag, constant, order):
    _, to_onset, to_logarithm, to_order = value(lag, constant, order)[:4]
    step = 1e-6
    scaled = step * constant
    up, down = value(lag - scaled, constant, order)[0], value(lag + scaled, constant, order)[0]
    # the second-order error of the differences is 1e-12 times a third derivative below 1e3
    assert to_onset * constant == pytest.approx((up - down) / (2 * step), abs=1e-6)
    up = value(lag, constant * np.exp(step), order)[0]
    down = value(lag, constant * np.exp(-step), order)[0]
    assert to_logarithm == pytest.approx((up - down) / (2 * step), abs=1e-6)
    up, down = value(lag, constant, order + step)[0], value(lag, constant, order - step)[0]
    assert to_order == pytest.approx((up - down) / (2 * step), abs=1e-6)


def test_the_shape_is_the_twitch():
    rows = np.array([value(lag, 0.03, 3.0)[0] for lag in LAG])
    assert np.allclose(rows, twitch(LAG, 0.03, 3))


@given(
    onset=st.floats(5e-3, 25e-3),
    constant=st.floats(15e-3, 60e-3),
    order=st.sampled_from([2, 3, 4]),
    peak=st.floats(0.1, 100.0),
    base=st.floats(-10.0, 10.0),
)
# the first example compiles the kernel: no deadline
@settings(max_examples=30, deadline=None)
def test_a_clean_twitch_is_found_exactly(onset, constant, order, peak, base):
    force = base + peak * twitch(LAG - onset, constant, order)
    starts = np.array([0, len(LAG)])
    start = coarse_start(LAG, force, starts, float(order), 4)
    theta, _, _ = shared_fit(LAG, force, starts, start, 2)
    # the search ends when a step promises less than 1e-9 of the error: far below a microsecond
    assert theta[0] == pytest.approx(onset, abs=1e-6)
    assert np.exp(theta[1]) == pytest.approx(constant, rel=1e-4)
    parts = linear_parts(LAG, force, starts, theta)[0]
    assert parts[0] == pytest.approx(peak, rel=1e-3)
    assert parts[1] == pytest.approx(base, abs=1e-3 * peak)


def test_the_order_can_be_a_real_number():
    force = twitch(LAG - 0.01, 0.03, 3.4)
    starts = np.array([0, len(LAG)])
    start = coarse_start(LAG, force, starts, 3.0, 4)
    theta, _, _ = shared_fit(LAG, force, starts, start, 3)
    assert theta[2] == pytest.approx(3.4, abs=1e-3)


def test_twitches_of_different_size_share_their_shape():
    random = np.random.default_rng(3)
    peaks, bases = [1.0, 5.0, 0.2], [0.0, 3.0, -1.0]
    parts = [b + a * twitch(LAG - 0.011, 0.04) for a, b in zip(peaks, bases, strict=True)]
    force = np.concatenate(parts) + 0.01 * random.standard_normal(3 * len(LAG))
    lag = np.tile(LAG, 3)
    starts = np.arange(4) * len(LAG)
    theta, normal, error = shared_fit(lag, force, starts, np.array([0.005, np.log(0.03), 3.0]), 2)
    deviation = np.sqrt(np.diag(np.linalg.inv(normal)) * error / (len(lag) - 8))
    # four standard deviations: one in 16000 seeds
    assert abs(theta[0] - 0.011) < 4 * deviation[0]
    assert abs(theta[1] - np.log(0.04)) < 4 * deviation[1]
    assert np.allclose(linear_parts(lag, force, starts, theta)[:, 0], peaks, atol=0.01)


def test_a_force_without_a_twitch_has_no_peak():
    force = np.full(len(LAG), 2.5)
    starts = np.array([0, len(LAG)])
    theta, _, error = shared_fit(LAG, force, starts, np.array([0.01, np.log(0.03), 3.0]), 2)
    peak, base, _ = linear_parts(LAG, force, starts, theta)[0]
    assert error < 1e-20
    assert peak == pytest.approx(0.0, abs=1e-9)
    assert base == pytest.approx(2.5)
