# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile texts on the real node: none ends it, each is answered by an error code and a reason."""

import os
from random import Random

import pytest
from rclpy.action import ActionClient
from rclpy.node import Node

from rpms_msgs.action import RunSchedule
from rpms_ros.nodes.common import topics
from rpms_ros.nodes.stimulator_driver import StimulatorDriver

# bench/hostile_goals.py asks for ten thousand
COUNT = int(os.environ.get('RPMS_HOSTILE_GOALS', '200'))
CODES = RunSchedule.Result
# a service holds ten requests
TOGETHER = 8


@pytest.mark.long
def test_every_hostile_text_is_answered_with_a_reason(graph, hostile_texts):
    driver = graph.add(
        StimulatorDriver,
        require_operator=False,
        require_stop_button=False,
        executor_timeout=10.0,
        watch_timeout=10.0,
        lateness_limit=0.1,
    )
    other = graph.add(lambda **options: Node('other', **options))
    client = ActionClient(other, RunSchedule, topics.RUN_SCHEDULE)
    graph.wait_for(client.server_is_ready)
    some = (*hostile_texts.KNOWN, *hostile_texts.hostile_texts(COUNT, 3))
    texts = [text for text in some if hostile_texts.sendable(text)]
    Random(3).shuffle(texts)
    answered = 0
    for begin in range(0, len(texts), TOGETHER):
        batch = texts[begin : begin + TOGETHER]
        sent = [client.send_goal_async(RunSchedule.Goal(schedule=text)) for text in batch]
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
    assert answered == len(texts)
    assert driver.controller.fault_counts() == {}
    client.destroy()
    print(f'{answered} hostile goals, each answered with an error code and a reason')
