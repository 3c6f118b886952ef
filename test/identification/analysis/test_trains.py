# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trains: equal pulses, a gain a pulse, the history law; made up and of a rat."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.trains import (
    TrainLaw,
    analyze_trains,
    fit_equal,
    fit_gains,
    fit_history,
    fit_with_law,
)
from rpms_ros.muscle import twitch

LATENCY, CONSTANT = 0.0105, 0.030


def response(count, rate=50.0, gains=None, law=None, noise=0.0, step=2e-3):
    onset = np.arange(count) / rate
    lag = np.arange(-0.05, onset[-1] + 0.5, step)
    usable = np.ones(len(lag), dtype=np.bool_)
    empty = Response(onset, lag, np.zeros(len(lag)), usable, 1.0, np.nan)
    if law is not None:
        force = 2.0 * law.force(empty, 3, LATENCY, CONSTANT)
    else:
        columns = twitch(lag[:, None] - onset - LATENCY, CONSTANT)
        force = columns @ (np.ones(count) if gains is None else np.asarray(gains))
    force = force + 1.0 + noise * np.random.default_rng(count).standard_normal(len(lag))
    return Response(onset, lag, force, usable, 1.0, np.nan)


def test_equal_pulses_are_explained_by_one_twitch():
    fit = fit_equal(response(6), 3)
    assert fit.fit > 99.99
    assert fit.latency == pytest.approx(LATENCY, abs=1e-5)
    assert fit.time_constant == pytest.approx(CONSTANT, rel=1e-3)
    assert fit.gains == pytest.approx([1.0], rel=1e-3)
    assert fit.baseline == pytest.approx(1.0, abs=1e-3)


def test_unequal_pulses_need_a_gain_each():
    gains = [1.0, 2.5, 1.5, 0.5]
    train = response(4, gains=gains)
    equal = fit_equal(train, 3)
    each = fit_gains(train, 3, equal)
    assert equal.fit < 95
    assert each.fit > 99.9
    assert each.gains == pytest.approx(gains, rel=0.02)


def test_no_gain_is_negative():
    train = response(4, gains=[1.0, -0.5, 1.0, 1.0])
    assert (fit_gains(train, 3, fit_equal(train, 3)).gains >= 0).all()


@given(facilitation=st.floats(0.0, 2.0), decay=st.floats(0.01, 1.0), rate=st.floats(1.0, 100.0))
def test_facilitation_only_grows_in_a_regular_train_and_starts_at_one(facilitation, decay, rate):
    law = TrainLaw(facilitation=facilitation, facilitation_decay=decay)
    gains = law.gains(np.arange(10) / rate)
    assert gains[0] == 1.0
    # up to the rounding of a sum that no longer grows
    assert (np.diff(gains) >= -4.0 * np.finfo(np.float64).eps * gains[1:]).all()
    # the geometric series of a sum e^(-k / (f tau))
    limit = 1.0 + facilitation / np.expm1(1.0 / (rate * decay))
    assert (gains <= limit * (1 + 1e-12)).all()


def test_a_law_without_history_is_the_linear_sum():
    train = response(5)
    law = TrainLaw(1e6, 1.0, 0.0, 0.1, 1e-6)
    linear = twitch(train.lag[:, None] - train.onset - LATENCY, CONSTANT).sum(axis=1)
    # saturation takes x / 1e6 of x, the lag a microsecond
    assert law.force(train, 3, LATENCY, CONSTANT) == pytest.approx(linear, abs=2e-4)


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        *((name, 0.0, f'expected a {name} above 0, got 0') for name in TrainLaw.POSITIVE),
        ('facilitation', -1.0, 'facilitation of at least 0, got -1'),
    ],
)
def test_numbers_of_a_law_that_cannot_be(name, value, message):
    with pytest.raises(IdentificationError, match=message):
        TrainLaw(**{name: value})


def test_a_law_learned_on_short_trains_tells_longer_ones():
    law = TrainLaw(2.5, 1.8, 0.6, 0.08, 0.008)
    taught = [response(count, 50.0, law=law, noise=5e-3) for count in (2, 4, 6)]
    longer = response(9, 50.0, law=law, noise=5e-3)
    found = fit_history(taught, [fit_equal(train, 3) for train in taught], 3)
    judged = fit_with_law(found, longer, 3)
    assert fit_equal(longer, 3).fit < 95
    assert judged.fit > 98


def test_trains_of_two_pulses_teach_no_law():
    train = response(2)
    with pytest.raises(IdentificationError, match='a train of at least 3 pulses, got none'):
        fit_history([train], [fit_equal(train, 3)], 3)


def test_the_longest_trains_judge_the_law():
    law = TrainLaw(2.5, 1.8, 0.6, 0.08, 0.008)
    trains = [response(count, law=law, noise=5e-3) for count in (3, 6, 6, 4)]
    found = analyze_trains(trains, 3, {'sensor saturated': 1})
    assert [train.held_out for train in found.trains] == [False, True, True, False]
    assert found.mean_fit('law', held_out=True) > found.mean_fit('equal', held_out=True)
    assert found.rejected == {'sensor saturated': 1}
    assert found.trains[0].rate_hz == pytest.approx(50.0)


@pytest.mark.parametrize('count', [2, 4])
def test_trains_of_one_length_have_no_judge_and_doublets_no_law(count):
    found = analyze_trains([response(count), response(count)], 3)
    assert not any(train.held_out for train in found.trains)
    assert np.isnan(found.mean_fit('law', held_out=True))
    assert (found.law is not None) == (count == 4)
    assert (found.trains[0].law is not None) == (count == 4)


FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[3] / '../shared/data'))
TRIALS = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))
GATE_VOLTS = 4.0


def rat_response(path):
    time, _, gate, force = np.loadtxt(path, delimiter=',', skiprows=1, usecols=range(4)).T
    high = gate > GATE_VOLTS
    onset = time[1:][high[1:] & ~high[:-1]]
    part = (time >= onset[0] - 0.05) & (time < onset[-1] + 0.5)
    lag = time[part] - onset[0]
    usable = np.ones(len(lag), dtype=np.bool_)
    return Response(onset - onset[0], lag, force[part], usable, np.nan, np.nan)


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
def test_trains_of_a_rat_are_explained():
    found = analyze_trains([rat_response(path) for path in TRIALS], 3)
    counts = [len(train.response.onset) for train in found.trains]
    assert sorted(counts) == [4] * 8 + [7] * 8 + [10] * 8
    assert found.mean_fit('equal') >= 90.0
    assert found.mean_fit('gains') >= 95.0
    judged = [train for train in found.trains if train.held_out]
    assert [len(train.response.onset) for train in judged] == [10] * 8
    assert found.mean_fit('law', held_out=True) >= 94.0
    assert found.mean_fit('law', held_out=True) > found.mean_fit('equal', held_out=True) + 3.0
    # about 11 ms and 8 ms were found beforehand, over more trials
    assert 9e-3 < found.latency < 13e-3
    assert 7e-3 < found.time_constant < 11e-3
    assert found.latency_spread > 0
    assert found.time_constant_spread > 0
