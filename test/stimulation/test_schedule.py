# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules: what segments in a row add up to, and what their text says."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import (
    SEGMENT_KINDS,
    Constant,
    DescriptionError,
    Pause,
    Repeat,
    Schedule,
    Single,
    UniformRandom,
    load_schedule,
    paper_random,
    paper_sinusoid,
    schedule_from_text,
    schedule_to_text,
)

SIMPLE = st.one_of(
    st.builds(
        Constant,
        rate_hz=st.floats(1.0, 50.0),
        duration_s=st.floats(0.1, 3.0),
        final_rate_hz=st.none() | st.floats(1.0, 50.0),
        intensity=st.floats(0.0, 1.0),
    ),
    st.builds(UniformRandom, rate_hz=st.floats(1.0, 50.0), duration_s=st.floats(0.1, 3.0)),
    st.builds(Pause, duration_s=st.floats(0.1, 3.0)),
    st.builds(Single, intensity=st.floats(0.0, 1.0)),
)
ITEMS = st.recursive(
    SIMPLE,
    lambda inner: st.builds(
        Repeat,
        segments=st.lists(inner, min_size=1, max_size=3).map(tuple),
        times=st.integers(1, 3),
    ),
    max_leaves=6,
)
SCHEDULES = st.builds(
    Schedule, segments=st.lists(ITEMS, min_size=1, max_size=4).map(tuple), seed=st.integers(0, 99)
)


@given(SCHEDULES)
def test_text_and_back_is_the_same_schedule(schedule):
    assert schedule_from_text(schedule_to_text(schedule)) == schedule


@given(SCHEDULES)
def test_totals_are_known_before_the_pulses(schedule):
    plan = schedule.plan
    pieces = sum(item.pieces if isinstance(item, Repeat) else 1 for item in schedule.segments)
    assert len(plan) == schedule.pulse_count == schedule.totals.pulses
    # every piece is rounded to a whole nanosecond
    assert plan.duration_ns == pytest.approx(schedule.length_s * 1e9, abs=pieces + 1)
    assert np.all(np.diff(plan.onset_ns) >= 0)
    assert np.all(np.diff(plan.segment) >= 0)
    assert np.all((plan.intensity >= 0.0) & (plan.intensity <= 1.0))


def test_segments_follow_one_another_to_the_nanosecond():
    schedule = Schedule(
        (
            Constant(rate_hz=30.0, duration_s=0.1, intensity=0.5),
            Pause(duration_s=0.25),
            Repeat((Single(intensity=0.7, duration_s=0.5),), times=2),
        )
    )
    train = schedule.pulses(start_ns=1_000)
    assert train.onset_ns.tolist() == [
        1_000, 33_334_333, 66_667_667, 350_001_000, 850_001_000,
    ]  # fmt: skip
    assert train.intensity.tolist() == [0.5, 0.5, 0.5, 0.7, 0.7]
    assert train.sequence.tolist() == [0, 1, 2, 3, 4]
    assert train.width.tolist() == [100e-6] * 5
    assert schedule.plan.segment.tolist() == [0, 0, 0, 2, 2]
    assert schedule.totals.highest_rate_hz == pytest.approx(30.0, rel=1e-6)


def test_random_segments_differ_from_one_repetition_to_the_next():
    draws = Repeat((UniformRandom(rate_hz=20.0, duration_s=1.0),), times=2)
    values = Schedule((draws,)).plan.intensity.reshape(2, 20)
    assert not np.array_equal(values[0], values[1])


def test_the_paper_excitations():
    random, sinusoid = paper_random(seed=3), paper_sinusoid()
    assert np.array_equal(random.plan.intensity, np.random.default_rng(3).uniform(0, 1, 1800))
    assert (random.length_s, sinusoid.length_s) == (90.0, 90.0)
    assert sinusoid.totals.highest_intensity == 1.0
    assert np.mean(sinusoid.plan.intensity**2) == pytest.approx(3 / 8, abs=1e-12)


def nested(depth):
    inner = '{kind: single}'
    for _ in range(depth):
        inner = f'{{kind: repeat, times: 1, segments: [{inner}]}}'
    return f'segments: [{inner}]'


def many(segment):
    inner = f'{{kind: repeat, times: 100000, segments: [{segment}]}}'
    return f'segments: [{{kind: repeat, times: 100000, segments: [{inner}]}}]'


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('', 'expected a YAML document, got an empty one'),
        ('[1, 2]', 'expected a mapping of names to values, got'),
        ('name: x', r'line 1, segments: expected a list of segments, got None'),
        ('segments: []', r'line 1, segments: expected a list of segments, got \[\]'),
        (
            'name: 3\nsegments: [{kind: single}]',
            r'line 1, name: expected a text of 1 to 64 printable characters, got 3',
        ),
        ('segments: [{kind: single}]\nspeed: 3', r'line 2, speed: expected one of .*, got'),
        ('segments: [{kind: blast}]', r'segments\[0\]\.kind: expected one of .* got .blast'),
        ('segments:\n- {kind: pause}', r'line 2, segments\[0\]\.duration_s: expected .* nothing'),
        (
            'segments:\n- {kind: single}\n- kind: constant\n  rate_hz: 0\n  duration_s: 1.0',
            r'line 4, segments\[1\]\.rate_hz: expected a number in \[0\.001, 1000\] Hz, got 0',
        ),
        (
            'segments:\n- kind: repeat\n  segments:\n  - {kind: pause, duration_s: -1.0}',
            r'line 4, segments\[0\]\.segments\[0\]\.duration_s: expected .* got -1',
        ),
        (
            'segments:\n- {kind: staircase, rate_hz: 20.0, duration_s: 1.0, levels: [0.5, 2.0]}',
            r'line 2, segments\[0\]\.levels\[1\]: expected a number in \[0, 1\], got 2',
        ),
        (
            'segments:\n- {kind: single, intensity: 0.1, intensty: 0.1}',
            r'line 2, segments\[0\]\.intensty: expected one of',
        ),
        (
            'segments:\n- {kind: sinusoid, rate_hz: 20.0, duration_s: 9.0, low: 0.5, high: 0.1}',
            r'line 2, segments\[0\]: expected low <= high',
        ),
        ('seed: -1\nsegments: [{kind: single}]', r'line 1, seed: expected a whole number'),
        (nested(9), 'expected at most 8 repeats in one another'),
        (many('{kind: single}'), 'expected at most 500000 pulses'),
        (
            many('{kind: pause, duration_s: 1.0e-6}'),
            'expected at most 500000 segments after unrolling',
        ),
        (
            'segments: [{kind: repeat, times: 3, segments: [{kind: pause, duration_s: 86400.0}]}]',
            'expected at most 86400 seconds',
        ),
    ],
)
def test_malformed_text_is_refused_with_its_place(text, fault):
    with pytest.raises(StimulationError, match=fault):
        schedule_from_text(text)


def test_every_kind_can_be_described():
    assert set(SEGMENT_KINDS) == {
        'constant', 'ramp', 'staircase', 'sinusoid', 'uniform_random', 'multilevel_prbs',
        'single', 'doublet', 'n_let', 'pause',
    }  # fmt: skip


def test_file_is_named_in_its_fault(tmp_path):
    path = tmp_path / 'schedule.yaml'
    path.write_text('segments:\n- {kind: pause}\n')
    with pytest.raises(StimulationError, match=r'schedule\.yaml: line 2, segments\[0\]'):
        load_schedule(path)
    with pytest.raises(StimulationError, match=r'expected a readable schedule file, got .*absent'):
        load_schedule(tmp_path / 'absent.yaml')
    path.write_text(schedule_to_text(paper_random()))
    assert load_schedule(path) == paper_random()


def test_fault_knows_its_place():
    with pytest.raises(DescriptionError, match='rate_hz') as caught:
        schedule_from_text('segments:\n- {kind: constant, rate_hz: -1, duration_s: 1}')
    assert caught.value.place == 'line 2, segments[0].rate_hz'
    with pytest.raises(StimulationError, match='expected at least one segment, got none'):
        Schedule(())
    with pytest.raises(StimulationError, match='at least one segment to repeat, got none'):
        Repeat(())
