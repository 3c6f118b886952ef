# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages without an executor, and discovery among the processes of a laboratory."""

import contextlib
import fcntl
import os
import tempfile
import time
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import NamedTuple

from rclpy.subscription import Subscription

from rpms_ros.errors import NodeError

# Most messages taken at once: more than a queue holds.
_MOST = 20_000


class Taken(NamedTuple):
    """One message, serialised; its number, counted by its publisher, if known; reception [ns]."""

    data: bytes
    sequence: int | None
    received_ns: int


def drained(subscription: Subscription | None) -> list[Taken]:
    """Return the waiting messages of a subscription that no executor serves; none for None."""
    found: list[Taken] = []
    if subscription is None:
        return found
    handle = subscription.handle
    with handle:
        while len(found) < _MOST:
            taken = handle.take_message(subscription.msg_type, True)
            if taken is None:
                break
            data, about = taken
            found.append(
                Taken(data, about['publication_sequence_number'], about['received_timestamp'])
            )
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
