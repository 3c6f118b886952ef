# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.identification.analysis.responses import Kind, groups_of, in_order
from rpms_ros.pulses import PulseTrain

REST = 0.4


def pulses(onset_s, intensity):
    onset = np.rint(np.asarray(onset_s, float) * 1e9).astype(np.int64)
    values = np.broadcast_to(np.asarray(intensity, float), onset.shape)
    return PulseTrain(onset, values, np.arange(len(onset)), np.full(len(onset), 1e-4))


def train(start, count, rate, jitter=0.0):
    random = np.random.default_rng(0).uniform(-jitter, jitter, count)
    return start + np.arange(count) / rate + random


def kinds(onset_s, intensity=1.0):
    return [group.kind for group in groups_of(pulses(onset_s, intensity), REST)]


def test_no_pulses_are_no_groups():
    assert groups_of(pulses([], 1.0), REST) == ()


def test_a_pulse_a_second_is_single_each():
    assert kinds([0, 1, 2]) == [Kind.SINGLE] * 3


def test_trains_are_told_apart_by_a_rest():
    onset = np.concatenate((train(0, 4, 100), train(1, 7, 100), [3.0]))
    assert kinds(onset) == [Kind.TRAIN, Kind.TRAIN, Kind.SINGLE]


@pytest.mark.parametrize('rate', [5.0, 20.0, 100.0])
def test_the_rate_of_a_train_survives_jitter(rate):
    (group,) = groups_of(pulses(train(0, 20, rate, jitter=0.005 / rate), 0.7), REST)
    (level,) = group.levels
    # the median of jittered intervals is off by less than their jitter
    assert level.rate_hz == pytest.approx(rate, rel=0.01)
    assert level.intensity == 0.7


def test_a_staircase_has_its_levels_even_if_steps_are_no_whole_periods():
    steps = [train(1.21 * k, 24, 20.0) for k in range(5)]
    intensity = np.repeat([0.0, 0.25, 0.5, 0.75, 1.0], 24)
    (group,) = groups_of(pulses(np.concatenate(steps), intensity), REST)
    assert group.kind is Kind.STAIRCASE
    assert [level.intensity for level in group.levels] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [level.last - level.first for level in group.levels] == [24] * 5


def test_rates_in_a_row_are_a_staircase_of_rates():
    onset = np.concatenate((train(0, 20, 20.0), train(1.0, 40, 40.0)))
    (group,) = groups_of(pulses(onset, 1.0), REST)
    assert group.kind is Kind.STAIRCASE
    assert [round(level.rate_hz) for level in group.levels] == [20, 40]


def test_intensities_that_change_with_every_pulse_are_modulated():
    onset = train(0, 100, 20.0)
    assert kinds(onset, np.random.default_rng(0).uniform(0, 1, 100)) == [Kind.MODULATED]


def test_a_train_that_begins_before_the_next_could_rest_overlaps():
    onset = np.concatenate((train(0, 10, 50.0), train(0.45, 10, 50.0)))
    assert kinds(onset) == [Kind.OVERLAPPING]


def test_intensities_that_are_not_recorded_are_one_level():
    (group,) = groups_of(pulses(train(0, 10, 20.0), np.nan), REST)
    assert group.kind is Kind.TRAIN
    assert np.isnan(group.levels[0].intensity)


@given(
    gaps=st.lists(st.floats(0.002, 2.0), min_size=0, max_size=30),
    seed=st.integers(0, 100),
)
def test_every_pulse_belongs_to_one_group_and_one_level(gaps, seed):
    onset = np.concatenate(([0.0], np.cumsum(gaps)))
    intensity = np.random.default_rng(seed).choice([0.5, 1.0], len(onset))
    groups = groups_of(pulses(onset, intensity), REST)
    assert [group.first for group in groups] == [0, *(group.last for group in groups[:-1])]
    assert groups[-1].last == len(onset)
    for group in groups:
        edges = [level.first for level in group.levels]
        assert edges == [group.first, *(level.last for level in group.levels[:-1])]
        assert group.levels[-1].last == group.last


def test_pulses_are_put_in_order_once():
    given_twice = pulses([1.0, 0.0, 1.0], [0.5, 0.6, 0.7])
    ordered = in_order(given_twice)
    assert ordered.onset_ns.tolist() == [0, 1_000_000_000]
    assert ordered.intensity.tolist() == [0.6, 0.5]
