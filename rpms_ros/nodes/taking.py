# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Take messages from a subscription without an executor, each with the identity of its publisher.

rclpy of Jazzy does not tell the publisher of a message, and is too slow to empty a queue that a
publisher floods.  rcl, which is loaded anyway, does both.
"""

import ctypes
from typing import NamedTuple

from rclpy.subscription import Subscription

from rpms_ros.errors import NodeError

_OK, _NOTHING = 0, 401
_IDENTITY_BYTES = 16
_FIRST_BYTES = 256
# Most messages taken at once: more than a queue holds.
_MOST = 20_000


class _Bytes(ctypes.Structure):
    """rcutils_uint8_array_t."""

    _fields_ = (
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', ctypes.c_void_p * 5),
    )


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t."""

    _fields_ = (('functions', ctypes.c_void_p * 5),)


class _Information(ctypes.Structure):
    """rmw_message_info_t."""

    _fields_ = (
        ('sent_ns', ctypes.c_int64),
        ('received_ns', ctypes.c_int64),
        ('sequence', ctypes.c_uint64),
        ('reception', ctypes.c_uint64),
        ('implementation', ctypes.c_char_p),
        ('identity', ctypes.c_uint8 * _IDENTITY_BYTES),
        ('within_process', ctypes.c_bool),
    )


class Taken(NamedTuple):
    """One message.

    Attributes
    ----------
    data : bytes
        The message, serialised.
    identity : bytes
        Identity of its publisher.
    sequence : int
        Number of the message, counted by its publisher.
    received_ns : int
        Time of reception by the clock of the computer [ns].
    """

    data: bytes
    identity: bytes
    sequence: int
    received_ns: int = 0


class Taker:
    """Takes from one subscription, which must not be served by an executor.

    Parameters
    ----------
    subscription : Subscription
        Subscription of a node that is in no executor.

    Raises
    ------
    NodeError
        If rcl is missing, or is not that of Jazzy.
    """

    def __init__(self, subscription: Subscription) -> None:
        self._subscription = subscription
        try:
            rcl, rcutils = ctypes.CDLL('librcl.so'), ctypes.CDLL('librcutils.so')
            self._take = rcl.rcl_take_serialized_message
            self._forget_error = rcutils.rcutils_reset_error
            allocator = rcutils.rcutils_get_default_allocator
            allocate = rcutils.rcutils_uint8_array_init
            self._free = rcutils.rcutils_uint8_array_fini
        except (OSError, AttributeError) as error:
            raise NodeError(f'expected rcl of ROS 2 Jazzy, got {error}') from error
        # addresses as numbers: a look at a sensor takes a thousand messages, one call each
        self._take.argtypes = (ctypes.c_void_p,) * 4
        allocator.restype = _Allocator
        allocate.argtypes = (ctypes.POINTER(_Bytes), ctypes.c_size_t, ctypes.POINTER(_Allocator))
        self._free.argtypes = (ctypes.POINTER(_Bytes),)
        self._bytes, self._information = _Bytes(), _Information()
        self._to_bytes = ctypes.byref(self._bytes)
        self._places = ctypes.addressof(self._bytes), ctypes.addressof(self._information)
        functions = allocator()
        if allocate(self._to_bytes, _FIRST_BYTES, ctypes.byref(functions)) != _OK:
            raise NodeError('expected memory for a message, got none')

    def take(self) -> Taken | None:
        """Return the next message, None if there is none."""
        handle = self._subscription.handle
        with handle:
            if not self._came(handle.pointer):
                return None
        return Taken(
            ctypes.string_at(self._bytes.buffer, self._bytes.length),
            bytes(self._information.identity),
            int(self._information.sequence),
            int(self._information.received_ns),
        )

    def take_data(self, most: int) -> list[bytes]:
        """Return up to `most` next messages, serialised, without their publishers."""
        found: list[bytes] = []
        handle, content = self._subscription.handle, self._bytes
        with handle:
            pointer = handle.pointer
            while len(found) < most and self._came(pointer):
                found.append(ctypes.string_at(content.buffer, content.length))
        return found

    def _came(self, pointer: int) -> bool:
        """Take the next message into the buffer; return whether there was one."""
        answer = self._take(pointer, *self._places, None)
        if answer == _NOTHING:
            return False
        if answer != _OK:
            self._forget_error()
            topic = self._subscription.topic
            raise NodeError(f'expected a message of {topic}, got error {answer}')
        return True

    def close(self) -> None:
        """Free the memory."""
        self._free(self._to_bytes)


def drained(taker: Taker | None) -> list[Taken]:
    """Return the waiting messages of a subscription; none if there is no subscription."""
    found: list[Taken] = []
    while taker is not None and len(found) < _MOST and (taken := taker.take()) is not None:
        found.append(taken)
    return found
