# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Packets between a driver and its guard, over a local socket that keeps their boundaries."""

import struct
from typing import NamedTuple

_HEAD = struct.Struct('<cIq')
MAXIMUM_PAYLOAD = 200
MAXIMUM_PACKET = _HEAD.size + MAXIMUM_PAYLOAD
FOREVER_NS = 2**63 - 1
"""A deadline that never comes."""

# driver to guard
EXCHANGE = b'E'
"""Relay a frame: ``time_ns`` is when it has to be written at the latest; a byte, how long the
answer is, then the frame."""
BEAT = b'B'
SILENCE = b'S'
LISTEN = b'L'
"""Forget what the line has said, take commands again; answered by the same kind."""
LEAVE = b'X'
"""Disarm, give back remote control, release the port."""

# guard to driver
HELLO = b'H'
ANSWER = b'A'
"""``time_ns`` is when the command was written."""
LATE = b'T'
"""An exchange that came too late and was not written."""
REFUSED = b'R'
PONG = b'P'
DISARMED = b'D'
"""The guard has disarmed by itself; the reason."""

FROM_DRIVER = frozenset({EXCHANGE, BEAT, SILENCE, LISTEN, LEAVE})
FROM_GUARD = frozenset({HELLO, ANSWER, LATE, REFUSED, PONG, LISTEN, DISARMED})


class Packet(NamedTuple):
    """One packet.

    Attributes
    ----------
    kind : bytes
        One of the letters above.
    sequence : int
        Number of the request; the answer has the same.
    time_ns : int
        A moment on the machine's monotonic clock, which all its processes share [ns].
    payload : bytes
        At most 200 bytes.
    """

    kind: bytes
    sequence: int = 0
    time_ns: int = 0
    payload: bytes = b''


def packed(packet: Packet) -> bytes:
    """Return the bytes of a packet; a longer payload is cut."""
    head = _HEAD.pack(packet.kind, packet.sequence & 0xFFFFFFFF, packet.time_ns)
    return head + packet.payload[:MAXIMUM_PAYLOAD]


def unpacked(raw: bytes, kinds: frozenset[bytes]) -> Packet:
    """Return the packet in these bytes.

    Raises
    ------
    ValueError
        If it is none, or none of these kinds.
    """
    if not _HEAD.size <= len(raw) <= MAXIMUM_PACKET:
        fault = f'expected a packet of {_HEAD.size} to {MAXIMUM_PACKET} bytes, got {len(raw)}'
        raise ValueError(fault)
    kind, sequence, time_ns = _HEAD.unpack_from(raw)
    if kind not in kinds:
        raise ValueError(f'expected a packet of a known kind, got {kind!r}')
    return Packet(kind, sequence, time_ns, raw[_HEAD.size :])
