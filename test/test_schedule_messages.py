# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules as messages and back: every kind, and what is refused with its place."""

import math
import re

import pytest
from hypothesis import given, strategies as st

from rpms_msgs.msg import Schedule as ScheduleMessage, ScheduleSegment
from rpms_ros.errors import StimulationError
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.schedule_messages import KINDS, schedule_message, schedule_of
from rpms_ros.stimulation import Schedule, schedule_from_text, schedule_to_text
from rpms_ros.stimulation.schedule.description import SEGMENT_KINDS

EVERY_KIND = """
name: every kind
seed: 7
width_s: 0.0002
segments:
  - {kind: constant, rate_hz: 20.0, duration_s: 1.0, final_rate_hz: 30.0, intensity: 0.5}
  - {kind: ramp, rate_hz: 20.0, duration_s: 1.0, start: 0.2, end: 0.4}
  - {kind: staircase, rate_hz: 20.0, duration_s: 1.0, levels: [0.1, 0.2]}
  - {kind: sinusoid, rate_hz: 20.0, duration_s: 1.0, high: 0.6, period_s: 0.5, catch_share: 0.2}
  - kind: repeat
    times: 3
    segments:
      - {kind: uniform_random, rate_hz: 20.0, duration_s: 1.0, high: 0.7, seed: 0}
      - kind: repeat
        times: 2
        segments:
          - {kind: single, intensity: 0.4}
          - {kind: doublet, intensity: 0.3, interval_s: 0.02}
      - {kind: uniform_random, rate_hz: 20.0, duration_s: 1.0}
  - {kind: uniform_random, rate_hz: 20.0, duration_s: 1.0, low: 0.2, seed: 9}
  - {kind: n_let, intensity: 0.7, count: 4, interval_s: 0.02}
  - {kind: pause, duration_s: 2.0}
"""


def train(**changes):
    values = {'kind': ScheduleSegment.CONSTANT, 'rate_hz': 20.0, 'duration_s': 1.0}
    return ScheduleSegment(**{**values, 'intensity': 0.5, **changes})


def repeat(times, length):
    return ScheduleSegment(kind=ScheduleSegment.REPEAT, times=times, length=length)


def test_the_numbers_of_the_kinds_are_those_of_the_message():
    assert {*KINDS} - {'multilevel_prbs'} == {*SEGMENT_KINDS, 'repeat'}
    for number, kind in enumerate(KINDS, 1):
        assert getattr(ScheduleSegment, kind.upper()) == number


def test_every_kind_goes_into_a_message_and_back():
    schedule = schedule_from_text(EVERY_KIND)
    message = schedule_message(schedule, MESSAGE_TYPES)
    assert schedule_of(message) == schedule
    # two repetitions, one in the other
    assert [segment.length for segment in message.segments if segment.length] == [5, 2]
    assert len(message.segments) == 13


@given(depth=st.integers(0, 8), times=st.integers(1, 3), seed=st.none() | st.integers(0, 2**53))
def test_any_nesting_that_a_file_may_have_goes_there_and_back(depth, times, seed):
    own = '' if seed is None else f', seed: {seed}'
    text = f'{{kind: uniform_random, rate_hz: 5.0, duration_s: 1.0{own}}}'
    for _ in range(depth):
        text = (
            f'{{kind: repeat, times: {times}, segments: [{{kind: single, intensity: 1}}, {text}]}}'
        )
    schedule = schedule_from_text(f'segments: [{text}]')
    assert schedule_of(schedule_message(schedule, MESSAGE_TYPES)) == schedule


def test_what_is_left_empty_takes_what_a_file_takes():
    schedule = schedule_of(ScheduleMessage(segments=[train()]))
    expected = schedule_from_text(
        'segments: [{kind: constant, rate_hz: 20.0, duration_s: 1.0, intensity: 0.5}]'
    )
    assert schedule == expected
    assert isinstance(schedule, Schedule)


def test_an_intensity_that_is_not_given_is_zero():
    """A file takes 1.0 there; a message cannot tell whether somebody wrote its zero."""
    schedule = schedule_of(ScheduleMessage(segments=[train(intensity=0.0)]))
    assert schedule.plan.intensity.max(initial=0.0) == 0.0


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        ({'name': 'x' * 65}, 'name: expected a text of 1 to 64 printable characters'),
        ({'name': 'a\x07b'}, 'name: expected a text of 1 to 64 printable characters'),
        ({'seed': 2**54}, 'seed: expected a whole number'),
        ({'width_s': 0.02}, 'width_s: expected a number in [1e-06, 0.01] s'),
        ({'width_s': math.nan}, 'width_s: expected a number'),
        ([], 'segments: expected at least one segment, got none'),
        ([ScheduleSegment()], 'segments[0].kind: expected a number from 1 to 11, got 0'),
        ([train(kind=12)], 'segments[0].kind: expected a number from 1 to 11, got 12'),
        ([train(kind=6)], 'segments[0].kind: expected a number from 1 to 11, got 6 multil'),
        ([train(order=1)], 'segments[0].order: expected nothing here'),
        ([train(), train(rate_hz=0.0)], 'segments[1].rate_hz: expected a number in [0.001, 1000]'),
        ([train(rate_hz=math.nan)], 'segments[0].rate_hz: expected a number'),
        ([train(final_rate_hz=math.nan)], 'segments[0].final_rate_hz: expected a number'),
        ([train(final_rate_hz=-1.0)], 'segments[0].final_rate_hz: expected a number'),
        ([train(intensity=1.1)], 'segments[0].intensity: expected a number in [0, 1]'),
        ([train(high=0.3)], 'segments[0].high: expected nothing here, which a constant does not'),
        ([train(high=math.nan)], 'segments[0].high: expected nothing here'),
        ([train(levels=[0.1])], 'segments[0].levels: expected nothing here'),
        ([train(seed=3)], 'segments[0].seed: expected nothing here'),
        ([train(own_seed=True)], 'segments[0].own_seed: expected nothing here'),
        ([train(kind=3, intensity=0.0)], 'segments[0].levels: expected a list'),
        (
            [train(kind=5, intensity=0.0, seed=3)],
            'segments[0].seed: expected own_seed with a seed, got 3 without',
        ),
        ([train(kind=4, intensity=0.0)], 'segments[0].period_s: expected a number'),
        ([repeat(2, 0)], 'segments[0].length: expected a whole number from 1 to the 0 entries'),
        ([repeat(2, 2), train()], 'segments[0].length: expected a whole number from 1 to the 1'),
        (
            [repeat(2, 2), repeat(2, 2), train(), train()],
            'segments[1].length: expected a whole number from 1 to the 1',
        ),
        ([repeat(0, 1), train()], 'segments[0].times: expected a whole number in [1, 100000]'),
        (
            [*(repeat(1, 9 - i) for i in range(9)), train()],
            'segments[8]: expected at most 8 repeats in one another',
        ),
        ([train()] * 10_001, 'segments: expected at most 10000 values, got'),
        (
            [train(kind=3, intensity=0.0, levels=[0.1] * 10_001)],
            'segments: expected at most 10000 values, got',
        ),
    ],
)
def test_a_fault_is_named_by_its_place(message, said):
    if isinstance(message, list):
        message = {'segments': message}
    with pytest.raises(StimulationError, match=f'^{re.escape(said)}'):
        schedule_of(ScheduleMessage(**{'segments': [train()], **message}))


NUMBERS = st.floats(width=64) | st.sampled_from([0.0, 0.5, 1.0, 20.0])
SMALL = st.integers(0, 2**32 - 1) | st.integers(0, 3)
ANY_SEGMENT = st.builds(
    ScheduleSegment,
    kind=st.integers(0, 255) | st.integers(1, 11),
    rate_hz=NUMBERS,
    final_rate_hz=NUMBERS,
    duration_s=NUMBERS,
    intensity=NUMBERS,
    high=NUMBERS,
    low=st.just(0.0) | NUMBERS,
    levels=st.lists(NUMBERS, max_size=3),
    times=SMALL,
    length=SMALL,
    seed=st.integers(0, 2**64 - 1) | st.just(0),
    own_seed=st.booleans(),
)


@given(segments=st.lists(ANY_SEGMENT, max_size=6), name=st.text(max_size=70))
def test_any_message_is_a_schedule_or_refused(segments, name):
    message = ScheduleMessage(segments=segments, name=name)
    try:
        schedule = schedule_of(message)
    except StimulationError:
        return
    # what is accepted is what a file could have said
    assert schedule_from_text(schedule_to_text(schedule)) == schedule
