# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force put in order, pulses in groups, artifacts and the clocks."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import (
    Kind,
    clean,
    find_artifacts,
    groups_of,
    without_artifacts,
)
from rpms_ros.muscle import average_subject
from rpms_ros.muscle.simulation import simulated_force
from rpms_ros.pulses import ForceTrace, PulseTrain

COUNT = 20
MILLISECOND = 1_000_000


def trace(force):
    stamps = np.arange(len(force), dtype=np.int64) * MILLISECOND
    return ForceTrace(stamps, np.asarray(force, float))


def noise(count, size=1.0):
    return size * np.random.default_rng(0).standard_normal(count)


def test_samples_come_in_order_and_once():
    force = noise(200)
    stamps = np.arange(200, dtype=np.int64) * MILLISECOND
    twice = np.append(np.random.default_rng(1).permutation(200), 5)
    found = clean(ForceTrace(stamps[twice], force[twice]))
    assert np.array_equal(found.stamp_ns, stamps)
    assert np.array_equal(found.force, force)
    assert any('1 force samples have the stamp of another' in line for line in found.findings)


@pytest.mark.parametrize(
    ('value', 'sentence'), [(np.nan, 'are NaN or infinite'), (2e4, 'are beyond 10000')]
)
def test_what_cannot_be_a_force_is_left_out_and_said_without_a_unit(value, sentence):
    force = noise(300)
    force[[3, 70]] = value
    found = clean(trace(force))
    assert len(found.force) == 298
    assert found.findings == (f'2 force samples {sentence}; they are not used',)


def test_a_sensor_at_its_end_is_saturated_only_there():
    force = noise(1000)
    force[400:420] = 50.0
    force[700] = 50.0
    found = clean(trace(force))
    # a single sample at the end is no run of equal values
    assert np.array_equal(np.flatnonzero(found.saturated), np.arange(400, 420))
    # without a unit: the samples may be torques
    assert '(at 50)' in found.findings[0]
    assert not clean(trace(np.zeros(200))).saturated.any()


@pytest.mark.parametrize('place', [430, 500, 999])
def test_a_change_of_the_rate_is_said_once(place):
    stamps = np.cumsum(np.where(np.arange(2000) < place, 1, 2) * MILLISECOND).astype(np.int64)
    (sentence,) = clean(ForceTrace(stamps, noise(2000))).findings
    assert 'from 1000 to 500 Hz' in sentence


def test_a_gap_is_no_change_of_the_rate():
    stamps = np.arange(2000, dtype=np.int64) * MILLISECOND
    stamps[1000:] += 500 * MILLISECOND
    assert clean(ForceTrace(stamps, noise(2000))).findings == ()


def test_too_few_samples_are_refused():
    with pytest.raises(IdentificationError, match='at least 100 samples, got 99'):
        clean(trace(noise(99)))


def pulses(onset_s, intensity=1.0):
    onset = np.rint(np.asarray(onset_s, float) * 1e9).astype(np.int64)
    return PulseTrain.numbered(onset, intensity)


def train(start, count, rate, jitter=0.0):
    random = np.random.default_rng(0).uniform(-jitter, jitter, count)
    return start + np.arange(count) / rate + random


@pytest.mark.parametrize(
    ('onset', 'intensity', 'kinds'),
    [
        ([], 1.0, []),
        ([0, 1, 2], 1.0, [Kind.SINGLE] * 3),
        ([*train(0, 4, 100), *train(1, 7, 100), 3.0], 1.0, [Kind.TRAIN, Kind.TRAIN, Kind.SINGLE]),
        (train(0, 100, 20), np.random.default_rng(0).uniform(0, 1, 100), [Kind.MODULATED]),
        ([*train(0, 10, 50.0), *train(0.45, 10, 50.0)], 1.0, [Kind.OVERLAPPING]),
        (train(0, 10, 20.0), np.nan, [Kind.TRAIN]),
    ],
    ids=['none', 'single', 'trains', 'modulated', 'overlapping', 'unknown intensity'],
)
def test_kinds_of_groups(onset, intensity, kinds):
    assert [group.kind for group in groups_of(pulses(onset, intensity))] == kinds


@pytest.mark.parametrize('rate', [5.0, 20.0, 100.0])
def test_the_rate_of_a_train_survives_jitter(rate):
    (group,) = groups_of(pulses(train(0, 20, rate, jitter=0.005 / rate), 0.7))
    (level,) = group.levels
    # the median of jittered intervals is off by less than their jitter
    assert level.rate_hz == pytest.approx(rate, rel=0.01)
    assert level.intensity == 0.7


def test_a_staircase_has_its_levels_even_if_steps_are_no_whole_periods():
    steps = [train(1.21 * k, 24, 20.0) for k in range(5)]
    intensity = np.repeat([0.0, 0.25, 0.5, 0.75, 1.0], 24)
    (group,) = groups_of(pulses(np.concatenate(steps), intensity))
    assert group.kind is Kind.STAIRCASE
    assert [level.intensity for level in group.levels] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [level.last - level.first for level in group.levels] == [24] * 5


@given(gaps=st.lists(st.floats(0.002, 2.0), max_size=30), seed=st.integers(0, 100))
def test_every_pulse_belongs_to_one_group_and_one_level(gaps, seed):
    onset = np.concatenate(([0.0], np.cumsum(gaps)))
    intensity = np.random.default_rng(seed).choice([0.5, 1.0], len(onset))
    groups = groups_of(pulses(onset, intensity))
    assert [group.first for group in groups] == [0, *(group.last for group in groups[:-1])]
    assert groups[-1].last == len(onset)
    for group in groups:
        edges = [level.first for level in group.levels]
        assert edges == [group.first, *(level.last for level in group.levels[:-1])]
        assert group.levels[-1].last == group.last


def session(artifact=1.0, offset=0.0):
    """Return the trace of pulses off the grid, and stamps that lag by `offset` [s]."""
    random = np.random.default_rng(0)
    given_ns = (np.arange(COUNT) + 1) * 1_000_000_000 + random.integers(0, 1_000_000, COUNT)
    force = simulated_force(
        average_subject(), pulses(given_ns / 1e9), COUNT + 2.0, artifact=artifact
    )
    return clean(force), given_ns - round(offset * 1e9)


def test_artifacts_lie_at_the_first_sample_after_the_pulse():
    trace, onset = session()
    found = find_artifacts(trace, onset)
    assert found.found
    assert found.count == COUNT
    assert (found.offset >= 0).all()
    assert (found.offset <= 1e-3).all()
    assert found.clock_offset == 0.0
    # one alone proves nothing
    assert not find_artifacts(trace, onset[:1]).found


@pytest.mark.parametrize('offset', [-8e-3, -3e-3, 3e-3, 12e-3])
def test_clocks_that_differ_are_found_out(offset):
    trace, onset = session(offset=offset)
    # the first sample after a pulse is known to a period of 1 ms, its mean over 20 to less
    assert find_artifacts(trace, onset).clock_offset == pytest.approx(offset, abs=4e-4)


def test_straight_lines_take_the_place_of_artifacts():
    trace, onset = session()
    bare, _ = session(artifact=0.0)
    cleaned = without_artifacts(trace, onset)
    # what is left: noise, and 0.03 % of the artifact after 4 ms
    assert np.abs(cleaned.force - bare.force).max() < 8 * bare.noise
    assert np.abs(trace.force - bare.force).max() > 20 * bare.noise
