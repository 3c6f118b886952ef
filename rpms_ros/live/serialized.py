# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many force samples at once, from the bytes of their messages.

A serialised geometry_msgs/WrenchStamped is four bytes that tell the order of the others, the stamp
as two integers of four, the frame as its length and its text, and then, at a multiple of eight
bytes behind the first four, three numbers of the force and three of the torque.  Messages of one
sensor differ in their numbers only, so that NumPy reads a thousand of them as one array.

A pulse from the bytes of its message: to make a message of them takes longer.

A serialised rpms_msgs/Pulse is four bytes that tell the order of the others, the stamp as two
integers of four, the frame as its length and its text, and then, each at a multiple of its size
behind the first four bytes, sequence, intensity, width and what is unverified.
"""

import struct
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import groupby

import numpy as np
import numpy.typing as npt

from rpms_ros.axis import FORCE, Axis
from rpms_ros.errors import MessageError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Pulse

_ORDER, _FRAME = slice(1, 2), slice(12, 16)
_SHORTEST = 16
_VECTOR_BYTES = 24


def alike(messages: Sequence[bytes]) -> Iterator[list[bytes]]:
    """Yield messages, in their order, in runs of one length, byte order and frame length."""
    for _, run in groupby(messages, key=_layout):
        yield list(run)


def forces_of(
    messages: Sequence[bytes], axis: Axis, quantity: str = FORCE
) -> tuple[IntArray, FloatArray]:
    """Return stamps [ns] and forces along `axis` [N], each (n,), of messages that are `alike`.

    Of a sensor of `TORQUE` it is the torque about the axis [N m].  Each is what
    `rpms_ros.messages.force_of` makes of the message, in every bit.

    Raises
    ------
    MessageError
        If the bytes are too few for this message.
    """
    read = np.frombuffer(b''.join(messages), _type_of(_layout(messages[0]), quantity))
    stamp_ns = read['seconds'].astype(np.int64) * NANOSECONDS_PER_SECOND + read['rest']
    shares = [(share, part) for share, part in zip(axis, 'xyz', strict=True) if share]
    # numbers of anybody may be infinite or too large for a sum
    with np.errstate(all='ignore'):
        total = shares[0][0] * read[shares[0][1]]
        for share, part in shares[1:]:
            total = total + share * read[part]
    return stamp_ns, total.astype(np.float64, copy=False)


def _layout(message: bytes) -> tuple[int, bytes, bytes]:
    return len(message), message[_ORDER], message[_FRAME]


@lru_cache(maxsize=16)
def _type_of(layout: tuple[int, bytes, bytes], quantity: str) -> npt.DTypeLike:
    length, order_byte, frame = layout
    if length < _SHORTEST:
        raise MessageError(
            f'expected a serialised WrenchStamped of at least {_SHORTEST} bytes, got {length}'
        )
    order = '<' if order_byte[0] & 1 else '>'
    (frame_length,) = struct.unpack(f'{order}I', frame)
    start = 4 + -(-(12 + frame_length) // 8) * 8 + (0 if quantity == FORCE else _VECTOR_BYTES)
    if start + _VECTOR_BYTES > length:
        raise MessageError(
            f'expected a serialised WrenchStamped of at least {start + _VECTOR_BYTES} bytes, '
            f'got {length}'
        )
    return np.dtype(
        {
            'names': ['seconds', 'rest', 'x', 'y', 'z'],
            'formats': [f'{order}i4', f'{order}u4', *[f'{order}f8'] * 3],
            'offsets': [4, 8, start, start + 8, start + 16],
            'itemsize': length,
        }
    )


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
