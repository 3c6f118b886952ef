# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces that are read from the bytes of many messages are those of the messages."""

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message

from rpms_ros import messages
from rpms_ros.axis import unit_vector
from rpms_ros.live.force_course import forces_of

AXIS = unit_vector('0.6,0,0.8')


def wrench(frame_id, index=0):
    """A message with a NaN across the axis, and a force that is none of a short decimal."""
    message = WrenchStamped()
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = 5 - index, 6 + index
    force = message.wrench.force
    force.x, force.y, force.z = 1.25 + index / 3.0, float('nan'), -2.5
    message.wrench.torque.x = 2.5
    return message


@pytest.mark.parametrize('quantity', ['force', 'torque'])
@pytest.mark.parametrize('frame_id', ['', 'a', 'sensor', 'force_sensor', 'é' * 7])
def test_the_forces_of_many_messages_are_those_of_each(frame_id, quantity):
    sent = [wrench(frame_id, index) for index in range(20)]
    stamps, forces = forces_of([serialize_message(one) for one in sent], AXIS, quantity)
    expected = [messages.force_of(one, AXIS, quantity) for one in sent]
    assert list(zip(stamps.tolist(), forces.tolist(), strict=True)) == expected


def test_too_few_bytes_and_a_frame_that_claims_to_be_longer_are_left_out():
    data = serialize_message(wrench('sensor'))
    cut = [data[:length] for length in range(len(data) - 24)]
    longer = data[:12] + b'\xff\xff\xff\x7f' + data[16:]
    stamps, _ = forces_of([*cut, data, longer], AXIS)
    assert len(stamps) == 1


def test_a_sum_that_is_too_large_is_infinite():
    message = wrench('sensor')
    message.wrench.force.x = message.wrench.force.z = 1.7e308
    _, forces = forces_of([serialize_message(message)], (1.0, 0.0, 1.0))
    assert forces.tolist() == [float('inf')]
