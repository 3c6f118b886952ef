# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.twitch_fits import (
    CONSTANT,
    CONSTANT_SD,
    ONSET,
    ONSET_SD,
    PEAK,
    choose_order,
    fit_twitches,
)
from rpms_ros.muscle import twitch

ORDERS = (2, 3, 4)


def responses(order, count, noise=0.01, seed=0):
    random = np.random.default_rng(seed)
    found, truth = [], []
    for _ in range(count):
        lag = np.arange(-0.05, 0.5, 1e-3) + random.uniform(0, 1e-3)
        latency, constant = random.uniform(6.3e-3, 14.6e-3), random.uniform(26.7e-3, 49.8e-3)
        peak = random.uniform(1.0, 10.0)
        force = 2.0 + peak * twitch(lag - latency, constant, order)
        force += noise * peak * random.standard_normal(len(lag))
        usable = (lag < 0) | (lag > 4e-3)
        found.append(Response(np.zeros(1), lag, force, usable, 1.0, np.nan, 0))
        truth.append((latency, constant, peak))
    return found, np.array(truth)


@pytest.mark.parametrize('order', ORDERS)
def test_each_twitch_alone_tells_its_order_at_one_per_cent_noise(order):
    draws, _ = responses(order, 40)
    choices = [choose_order(fit_twitches([draw], ORDERS)).order for draw in draws]
    # beforehand: 200 of 200; the aim is 95 of 100
    assert choices.count(order) >= 38


def test_twitches_are_found_within_their_own_deviations():
    draws, truth = responses(3, 60)
    fits = fit_twitches(draws, ORDERS)
    onset = (fits.column(ONSET, 3) - truth[:, 0]) / fits.column(ONSET_SD, 3)
    constant = (fits.column(CONSTANT, 3) - truth[:, 1]) / fits.column(CONSTANT_SD, 3)
    # the spread of 60 standard normal values lies within 0.7 and 1.3 in all but 1 of 1000 draws
    assert 0.7 < np.std(onset) < 1.3
    assert 0.7 < np.std(constant) < 1.3
    assert np.abs(fits.column(CONSTANT, 3) / truth[:, 1] - 1).max() < 0.02
    assert fits.column(PEAK, 3) == pytest.approx(truth[:, 2], rel=0.02)


def test_the_evidence_says_what_the_choice_rests_on():
    draws, truth = responses(3, 10)
    choice = choose_order(fit_twitches(draws, ORDERS))
    assert (choice.order, choice.held_out_order) == (3, 3)
    second, third, fourth = choice.evidence
    assert third.information == 0.0
    assert min(second.information, fourth.information) > 100
    assert third.wins == 10
    # the noise is 1 % of the peak, and unseen samples cannot be told better than that
    assert third.held_out == pytest.approx(0.01, rel=0.05)
    assert third.time_constant == pytest.approx(truth[:, 1].mean(), rel=0.01)
    assert choice.free_order == pytest.approx(3.0, abs=0.1)


def test_one_twitch_has_no_spread():
    draws, _ = responses(3, 1)
    assert np.isnan(choose_order(fit_twitches(draws, ORDERS)).free_order_spread)


def test_a_higher_order_that_explains_no_more_is_not_taken():
    draws, _ = responses(3, 5, noise=3.0)
    choice = choose_order(fit_twitches(draws, (3, 4)))
    assert choice.order == 3


def test_progress_reaches_the_end():
    draws, _ = responses(3, 60)
    seen = []
    fit_twitches(draws, ORDERS, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (60, 60)
    assert seen == sorted(seen)
