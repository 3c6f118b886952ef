# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile goals on the real node: none ends it, each is answered by an error code and a reason."""

import math
import os
from random import Random

import pytest
from rclpy.action import ActionClient
from rclpy.node import Node

from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import Schedule, ScheduleSegment
from rpms_ros.nodes.common import topics
from rpms_ros.nodes.stimulator_driver import StimulatorDriver

# bench/hostile_goals.py asks for ten thousand
COUNT = int(os.environ.get('RPMS_HOSTILE_GOALS', '200'))
CODES = RunSchedule.Result
# a service holds ten requests
TOGETHER = 8


NUMBERS = (0.0, 0.0, 0.1, 0.5, 1.0, 1.5, 20.0, 60.0, -1.0, 1e-320, 1e300, math.inf, math.nan)
WHOLE = (0, 0, 1, 2, 3, 7, 1000, 2**31, 2**32 - 1)
NAMES = ('', 'x', 'x' * 3000, 'a\x07b', '../../etc', '\u202e', '${HOME}', '\n')
FIELDS = ScheduleSegment.get_fields_and_field_types()


def hostile_segment(random):
    """Return a segment of which most fields are as a kind may have them."""
    segment = ScheduleSegment(kind=random.choice([*range(13), 255]), duration_s=1.0)
    for name in random.sample(sorted(FIELDS), random.randrange(6)):
        kind = FIELDS[name]
        if kind == 'double':
            setattr(segment, name, random.choice(NUMBERS))
        elif kind in ('uint32', 'uint64'):
            setattr(segment, name, random.choice(WHOLE))
        elif kind == 'boolean':
            segment.own_seed = True
        elif name == 'levels':
            segment.levels = [random.choice(NUMBERS)] * random.choice([1, 3, 20_000])
    return segment


def hostile_schedule(random):
    count = random.choice([0, 1, 1, 2, 3, 10, 10_001])
    segments = [hostile_segment(random) for _ in range(min(count, 10))]
    return Schedule(
        name=random.choice(NAMES),
        seed=random.choice([0, 1, 2**53 + 1, 2**64 - 1]),
        width_s=random.choice(NUMBERS),
        segments=segments if count <= 10 else segments * 1001,
    )


@pytest.mark.long
def test_every_hostile_goal_is_answered_with_a_reason(graph):
    driver = graph.add(
        StimulatorDriver,
        require_operator=False,
        require_stop_button=False,
        lateness_limit=0.1,
    )
    other = graph.add(lambda **options: Node('other', **options))
    client = ActionClient(other, RunSchedule, topics.RUN_SCHEDULE)
    graph.wait_for(client.server_is_ready)
    random = Random(3)
    answered = 0
    for begin in range(0, COUNT, TOGETHER):
        batch = [hostile_schedule(random) for _ in range(min(TOGETHER, COUNT - begin))]
        sent = [client.send_goal_async(RunSchedule.Goal(typed_schedule=one)) for one in batch]
        graph.wait_for(lambda: all(future.done() for future in sent), timeout=60.0)  # noqa: B023
        handles = [future.result() for future in sent]
        assert all(handle.accepted for handle in handles)
        results = [handle.get_result_async() for handle in handles]
        graph.wait_for(lambda: all(each.done() for each in results), timeout=60.0)  # noqa: B023
        for future in results:
            result = future.result().result
            assert result.reason
            assert result.error_code in (CODES.BAD_SCHEDULE, CODES.OVER_LIMIT, CODES.WRONG_STATE)
            answered += 1
    assert answered == COUNT
    assert driver.controller.fault_counts() == {}
    client.destroy()
    print(f'{answered} hostile goals, each answered with an error code and a reason')
