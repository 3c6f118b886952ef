# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Take messages from a subscription without an executor, each with the identity of its publisher.

rclpy of Jazzy does not tell the publisher of a message, and is too slow to empty a queue that a
publisher floods.  rcl, which is loaded anyway, does both.

Discovery among the processes of one laboratory.
"""

import contextlib
import ctypes
import fcntl
import os
import tempfile
import time
from collections.abc import Iterator, MutableMapping
from pathlib import Path
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


PROFILE = Path(__file__).with_name('fast_discovery.xml')

# Jazzy's Fast DDS reads the first name, later releases the second.
_PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')

# Domains above 100 use ports that Linux hands out to others; people choose the first ten.
_DOMAINS = range(10, 101)


def use_fast_discovery(environment: MutableMapping[str, str] = os.environ) -> None:
    """Make participants of this process find others quickly, unless the user chose a profile."""
    if not any(name in environment for name in _PROFILE_VARIABLES):
        for name in _PROFILE_VARIABLES:
            environment[name] = str(PROFILE)


def stay_on_this_machine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Make participants of this process find those of this machine only, unless told otherwise."""
    environment.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a DDS domain among the processes that use this function; yield its number.

    It is the one that was taken or left the longest time ago: what a process that was killed had
    there is found until its lease ends (Fast DDS: 20 s).

    Raises
    ------
    NodeError
        If every domain is taken.
    """
    folder = Path(tempfile.gettempdir()) / f'rpms_ros_domains_{os.getuid()}'
    folder.mkdir(mode=0o700, exist_ok=True)
    for domain in sorted(_DOMAINS, key=lambda number: _used_ns(folder / str(number))):
        # appending does not change when it was used
        with (folder / str(domain)).open('a') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            # a process that is killed does not come to its end below
            _note_use(lock.fileno())
            try:
                yield domain
            finally:
                _note_use(lock.fileno())
            return
    raise NodeError(f'expected a free DDS domain of {_DOMAINS}, got none')


def _note_use(lock: int) -> None:
    # the file system's own clock is too coarse to tell two tests apart
    now_ns = time.time_ns()
    os.utime(lock, ns=(now_ns, now_ns))


def _used_ns(lock: Path) -> int:
    try:
        return lock.stat().st_mtime_ns
    except FileNotFoundError:
        return 0
