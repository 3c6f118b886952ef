# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses that are read from the bytes of a message are those of the message."""

import pytest
from rclpy.serialization import serialize_message

from rpms_ros import messages
from rpms_ros.errors import MessageError
from rpms_ros.live.serialized import pulse_in
from rpms_ros.nodes.common.interfaces import MESSAGE_TYPES
from rpms_ros.pulses import Pulse

PULSE = Pulse(-5_000_000_123, 1.0 / 3.0, 2**32 - 1, 1e-4, 21)


def message(frame_id):
    return messages.pulse_message(PULSE, MESSAGE_TYPES, frame_id)


@pytest.mark.parametrize('frame_id', ['', 'a', 'ab', 'abc', 'abcd', 'coil', 'left_coil', 'é' * 7])
def test_the_pulse_is_that_of_the_message(frame_id):
    sent = message(frame_id)
    assert pulse_in(serialize_message(sent)) == messages.pulse_of(sent) == PULSE


def test_too_few_bytes_are_refused():
    data = serialize_message(message('coil'))
    # the serialisation may end with bytes that fill up
    for length in range(len(data) - 8):
        with pytest.raises(MessageError, match=f'expected a serialised Pulse, got {length} bytes'):
            pulse_in(data[:length])


def test_a_frame_that_claims_to_be_longer_than_the_message_is_refused():
    data = bytearray(serialize_message(message('coil')))
    data[12:16] = b'\xff\xff\xff\xff'
    with pytest.raises(MessageError, match='expected a serialised Pulse, got'):
        pulse_in(bytes(data))


def test_the_other_order_of_bytes_is_read_too():
    swapped = bytearray(b'\0\0\0\0' + (7).to_bytes(4, 'big') + (8).to_bytes(4, 'big'))
    swapped += (1).to_bytes(4, 'big') + b'\0' + b'\0' * 3 + (9).to_bytes(4, 'big')
    swapped += b'\0' * 4 + b'\x3f\xe0' + b'\0' * 6 + b'\0' * 8 + b'\3'
    assert pulse_in(bytes(swapped)) == Pulse(7_000_000_008, 0.5, 9, 0.0, 3)
