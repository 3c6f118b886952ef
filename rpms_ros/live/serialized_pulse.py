# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A pulse from the bytes of its message: to make a message of them takes longer.

A serialised rpms_msgs/Pulse is four bytes that tell the order of the others, the stamp as two
integers of four, the frame as its length and its text, and then, each at a multiple of its size
behind the first four bytes, sequence, intensity, width and what is unverified.
"""

import struct

from rpms_ros.errors import MessageError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import Pulse

_ENCAPSULATION = 4


def pulse_in(message: bytes) -> Pulse:
    """Return the pulse in a serialised rpms_msgs/Pulse: that of `rpms_ros.messages.pulse_of`.

    Raises
    ------
    MessageError
        If the bytes are too few for this message.
    """
    order = '<' if message[1:2] and message[1] & 1 else '>'
    try:
        seconds, rest, frame = struct.unpack_from(f'{order}iII', message, _ENCAPSULATION)
        place = _multiple(12 + frame, 4)
        (sequence,) = struct.unpack_from(f'{order}I', message, _ENCAPSULATION + place)
        place = _multiple(place + 4, 8)
        intensity, width, unverified = struct.unpack_from(
            f'{order}ddB', message, _ENCAPSULATION + place
        )
    except struct.error as error:
        raise MessageError(
            f'expected a serialised Pulse, got {len(message)} bytes, too few for one'
        ) from error
    onset_ns = seconds * NANOSECONDS_PER_SECOND + rest
    return Pulse(onset_ns, intensity, sequence, width, unverified)


def _multiple(place: int, size: int) -> int:
    return -(-place // size) * size
