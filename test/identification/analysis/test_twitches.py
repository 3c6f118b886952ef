# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fits of twitches, the choice of their order, and both latencies."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.twitch_fits import (
    CONSTANT,
    ONSET,
    PEAK,
    choose_order,
    coarse_start,
    fit_twitches,
    shared_fit,
)
from rpms_ros.identification.analysis.twitches import (
    crossing_latency,
    crossing_onset,
    latency_table,
)
from rpms_ros.muscle import twitch
from rpms_ros.muscle.twitch import twitch_row

LAG = np.arange(-0.05, 0.5, 1e-3)
ORDERS = (2, 3, 4)


def value(lag, constant, order):
    row = np.zeros(4)
    twitch_row(lag, constant, order, row)
    return row


@given(lag=st.floats(1e-3, 0.4), constant=st.floats(5e-3, 0.1), order=st.floats(1.5, 6.0))
def test_derivatives_of_the_shape_are_the_central_differences(lag, constant, order):
    assert value(lag, constant, order)[0] == pytest.approx(twitch(lag, constant, order))
    _, to_onset, to_logarithm, to_order = value(lag, constant, order)
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


@given(
    onset=st.floats(5e-3, 25e-3),
    constant=st.floats(15e-3, 60e-3),
    order=st.sampled_from(ORDERS),
    peak=st.floats(0.1, 100.0),
    base=st.floats(-10.0, 10.0),
)
@settings(max_examples=30)
def test_a_clean_twitch_is_found_exactly(onset, constant, order, peak, base):
    force = base + peak * twitch(LAG - onset, constant, order)
    start = coarse_start(LAG, force, float(order))
    found = shared_fit(LAG, force, np.array([0, len(LAG)]), start)
    # the search ends when a step promises less than 1e-9 of the error: far below a microsecond
    assert found.theta[0] == pytest.approx(onset, abs=1e-6)
    assert np.exp(found.theta[1]) == pytest.approx(constant, rel=1e-4)
    assert found.linear[0, 0] == pytest.approx(peak, rel=1e-3)
    assert found.linear[0, 1] == pytest.approx(base, abs=1e-3 * peak)


def responses(order, count, noise=0.01):
    random = np.random.default_rng(0)
    found, truth = [], []
    for _ in range(count):
        lag = LAG + random.uniform(0, 1e-3)
        latency, constant = random.uniform(6.3e-3, 14.6e-3), random.uniform(26.7e-3, 49.8e-3)
        peak = random.uniform(1.0, 10.0)
        force = 2.0 + peak * twitch(lag - latency, constant, order)
        force += noise * peak * random.standard_normal(len(lag))
        usable = (lag < 0) | (lag > 4e-3)
        found.append(Response(np.zeros(1), lag, force, usable, 1.0, np.nan))
        truth.append((latency, constant, peak))
    return found, np.array(truth)


@pytest.mark.parametrize('order', ORDERS)
def test_each_twitch_alone_tells_its_order_at_one_per_cent_noise(order):
    draws, _ = responses(order, 40)
    choices = [choose_order(fit_twitches([draw], ORDERS)) for draw in draws]
    # beforehand: 200 of 200; the aim is 95 of 100
    assert [choice.order for choice in choices].count(order) >= 38


def test_twitches_are_found_and_progress_is_told():
    draws, truth = responses(3, 60)
    seen = []
    fits = fit_twitches(draws, ORDERS, lambda *step: seen.append(step))
    assert np.abs(fits.column(ONSET, 3) - truth[:, 0]).max() < 1e-3
    assert np.abs(fits.column(CONSTANT, 3) / truth[:, 1] - 1).max() < 0.02
    assert fits.column(PEAK, 3) == pytest.approx(truth[:, 2], rel=0.02)
    assert seen == [(done, 60) for done in range(1, 61)]


def test_the_evidence_says_what_the_choice_rests_on():
    draws, truth = responses(3, 10)
    choice = choose_order(fit_twitches(draws, ORDERS))
    assert (choice.order, choice.held_out_order) == (3, 3)
    second, third, fourth = choice.evidence
    assert third.information == 0.0
    assert min(second.information, fourth.information) > 100
    # the noise is 1 % of the peak, and unseen samples cannot be told better than that
    assert third.held_out == pytest.approx(0.01, rel=0.05)
    assert third.time_constant == pytest.approx(truth[:, 1].mean(), rel=0.01)


def test_a_higher_order_that_explains_no_more_is_not_taken():
    draws, _ = responses(3, 5, noise=3.0)
    assert choose_order(fit_twitches(draws, (3, 4))).order == 3


def test_the_onset_lies_where_an_artifact_ends_and_the_twitch_begins():
    # the artifact falls until eight samples after its maximum, where the rise takes over
    assert crossing_onset(LAG, marked(LAG).force, 9) == pytest.approx(0.0085, abs=1.5e-3)


def test_rows_of_latencies_are_intensities_with_mean_spread_and_number():
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
    none = latency_table('joint fit', 'stamp', np.array([]), np.array([]), {})
    assert none.rows == ()
    assert np.isnan(none.mean)


def marked(lag, artifact=np.nan):
    force = twitch(lag - 0.0105, 0.038) + np.where(lag >= 0, np.exp(-lag / 5e-4), 0.0)
    return Response(np.zeros(1), lag, force, np.ones(len(lag), dtype=np.bool_), 1.0, artifact)


def test_the_latency_counts_from_the_artifact_if_there_is_one():
    lag = np.arange(-50, 400) * 1e-3
    from_stamp = crossing_latency(marked(lag), 1e-3, True)
    from_artifact = crossing_latency(marked(lag, artifact=2e-3), 1e-3, True)
    assert from_artifact == pytest.approx(from_stamp - 2e-3)
    assert crossing_latency(marked(lag, 2e-3), 1e-3, False) == from_stamp
    jittered = lag + np.random.default_rng(0).uniform(-2e-4, 2e-4, len(lag))
    # linear interpolation moves the end of the artifact by the jitter at most
    uneven = crossing_latency(marked(jittered), 1e-3, False)
    assert uneven == pytest.approx(from_stamp, abs=5e-4)
