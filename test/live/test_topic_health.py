# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether messages of a topic are received, and why not; numbers of anybody are valid JSON."""

import json

import hypothesis.strategies as st
import pytest
from hypothesis import given

from rpms_ros.live.topic_health import Publisher, Topic, numbers

PULSE = 'rpms_msgs/msg/Pulse'


@pytest.fixture
def topic():
    return Topic('/pulses', PULSE, 0.5)


def test_a_topic_that_nobody_publishes_or_of_another_type(topic):
    topic.publishers = []
    view = topic.view(1.0)
    assert view['state'] == 'never'
    assert view['text'] == f'nobody publishes it; expected type {PULSE}'
    topic.publishers = [Publisher('/mine', 'std_msgs/msg/Float64')]
    assert topic.view(1.0)['text'] == f'expected type {PULSE}, got std_msgs/msg/Float64'


def test_a_topic_that_falls_silent(topic):
    for step in range(100):
        topic.heard(10, 0.1 * step)
    view = topic.view(10.0)
    assert (view['state'], view['count']) == ('ok', 1000)
    # three seconds are counted, to a tenth of a second
    assert view['rate'] == pytest.approx(100.0, rel=0.05)
    assert topic.view(10.6)['state'] == 'silent'
    assert topic.view(15.2)['text'] == 'silent for 5 s'
    topic.publishers = []
    assert topic.view(15.2)['text'].endswith('nobody publishes it any more')


def test_what_comes_seldom_is_silent_later():
    """An identifier with an estimate every ten seconds was said to be silent most of the time."""
    for seldom, state in ((True, 'quiet'), (False, 'silent')):
        topic = Topic('/estimate', PULSE, 2.0, seldom)
        for step in range(4):
            topic.heard(1, 10.0 * step)
        assert topic.view(45.0)['state'] == state
        assert topic.view(61.0)['state'] == 'silent'


def test_silence_of_pulses_is_no_fault():
    topic = Topic('/pulses', PULSE, float('inf'))
    topic.heard(1, 0.0)
    topic.heard(0, 60.0)
    assert topic.view(60.0)['state'] == 'quiet'
    assert topic.view(60.0)['rate'] == 0.0


def test_a_rate_is_counted_by_the_stamps(topic):
    """Looks at a topic are not evenly apart, its samples are: 1000 Hz is not shown as 1131."""
    sent = 0
    for step in range(1, 60):
        now = 0.1 * step + 0.03 * (step % 3)
        count = round(1000 * now) - sent
        sent += count
        topic.heard(count, now, 1_000_000 * sent)
        if step > 1:
            # exact, but for the arithmetic
            assert topic.rate(now) == pytest.approx(1000.0, rel=1e-9)
    # stamps that stand still say nothing: the looks are counted
    constant = Topic('/pulses', PULSE, 0.5)
    for step in range(20):
        constant.heard(10, 0.1 * step, 7)
    assert constant.rate(1.9) == pytest.approx(100.0)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True)))
def test_any_numbers_are_valid_json(values):
    found = numbers(values)
    json.dumps(found, allow_nan=False)
    for value, said in zip(values, found, strict=True):
        # five digits; below 1e-295 there is no power of ten for all of them
        assert said is None or said == pytest.approx(value, rel=1e-4, abs=1e-295)
